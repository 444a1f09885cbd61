"""What `build` makes: right names, legal for two validators, the same bytes every time, one clear sentence when it cannot."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from fmpy import read_model_description
from fmpy.ssp import ssd
from fmpy.validation import validate_fmu
from integration.fmi_slave import FmiSlave
from lxml import etree  # type: ignore[import-untyped]

from deltaph.errors import DeltaphError, EnvironmentProblem
from deltaph.fmu import FMI_VERSIONS, build, cached_fmus
from deltaph.fmu.compile import fmi_headers
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.package import file_name
from deltaph.fmu.platforms import host
from deltaph.fmu.sources import token
from deltaph.variables import MODELS, Model, variable_table

NAMES = {
    3: ["DeltaCell.ssp", "DeltaPlanner.fmu", "DeltaPlant.fmu"],
    2: ["DeltaCell-fmi2.ssp", "DeltaPlanner-fmi2.fmu", "DeltaPlant-fmi2.fmu"],
}


def test_files_bear_the_names_others_rely_on(dist: Path) -> None:
    assert sorted(path.name for path in dist.iterdir()) == sorted(NAMES[2] + NAMES[3])


def test_returns_what_it_wrote_and_builds_one_version_alone(tmp_path: Path) -> None:
    written = build(tmp_path, [3])
    assert sorted(written) == sorted(tmp_path.iterdir())
    assert sorted(path.name for path in written) == NAMES[3]


def test_the_same_sources_give_the_same_bytes(dist: Path, tmp_path: Path) -> None:
    for path in build(tmp_path):
        assert path.read_bytes() == (dist / path.name).read_bytes(), path.name


def test_zip_has_no_dates_and_is_sorted(dist: Path) -> None:
    for path in dist.iterdir():
        with zipfile.ZipFile(path) as container:
            entries = container.infolist()
        assert [entry.filename for entry in entries] == sorted(entry.filename for entry in entries)
        assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}


def test_fmu_holds_library_documentation_and_licence(dist: Path, model: Model, version: FmiVersion) -> None:
    identifier = variable_table(model).model
    with zipfile.ZipFile(dist / file_name(model, version)) as container:
        names = container.namelist()
        page = container.read("documentation/index.html").decode()
    assert f"binaries/{host().folder(version)}/{identifier}{host().extension}" in names
    assert "documentation/licenses/license.txt" in names
    for variable in variable_table(model):
        assert f"<td>{variable.name}</td>" in page


def test_fmpy_finds_no_problem(dist: Path, model: Model, version: FmiVersion) -> None:
    assert validate_fmu(str(dist / file_name(model, version))) == []


def test_fmutool_finds_no_problem(dist: Path, model: Model, version: FmiVersion) -> None:
    tool = shutil.which("fmutool", path=str(Path(sys.executable).parent)) or shutil.which("fmutool")
    if tool is None:
        pytest.skip("fmutool is not installed")
    command = [tool, "-input", str(dist / file_name(model, version)), "-check"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_attributes_of_the_interface_are_spelt_as_in_the_schema(dist: Path, model: Model, version: FmiVersion) -> None:
    """The schemas let any attribute pass there, so that a misspelt capability would be none."""
    schema = next((fmi_headers().parent / "schema" / f"fmi{version}").glob("fmi?ModelDescription.xsd"))
    known = set()
    for file in schema.parent.glob("*.xsd"):
        known |= {element.get("name") for element in etree.parse(file).iter("{http://www.w3.org/2001/XMLSchema}attribute")}
    with zipfile.ZipFile(dist / file_name(model, version)) as container:
        root = etree.fromstring(container.read("modelDescription.xml"))
    for element in root.iter("CoSimulation", "DefaultExperiment", "fmiModelDescription"):
        assert set(element.attrib) <= known


def test_exports_the_whole_interface_and_nothing_else(dist: Path, model: Model, version: FmiVersion, tmp_path: Path) -> None:
    nm = shutil.which("nm")
    if nm is None or host().extension != ".so":
        pytest.skip("needs nm and an ELF library")
    with zipfile.ZipFile(dist / file_name(model, version)) as container:
        library = container.extract(f"binaries/{host().folder(version)}/{variable_table(model).model}.so", tmp_path)
    output = subprocess.run([nm, "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    header = (fmi_headers() / f"fmi{version}Functions.h").read_text()
    declared = set(re.findall(rf"Export\s+fmi{version}\w+TYPE\s+(fmi{version}\w+);", header))
    assert {line.split()[-1] for line in output.splitlines()} == declared
    assert len(declared) == {2: 44, 3: 75}[version]


def test_description_and_library_have_the_same_token(dist: Path, model: Model, version: FmiVersion, tmp_path: Path) -> None:
    description = read_model_description(str(dist / file_name(model, version)))
    assert description.guid == token(model, version)
    assert re.fullmatch(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", description.guid)
    slave = FmiSlave(dist, model, version, tmp_path, guid=description.guid)
    assert slave.component is not None
    slave.free()


def test_tokens_differ() -> None:
    assert len({token(model, version) for model in MODELS for version in FMI_VERSIONS}) == 4


def test_description_is_the_table(dist: Path, model: Model, version: FmiVersion) -> None:
    table = variable_table(model)
    description = read_model_description(str(dist / file_name(model, version)))
    assert description.variableNamingConvention == "structured"
    assert (description.defaultExperiment.startTime, description.defaultExperiment.stopTime) == ("0.0", "0.353")
    described = {v.name: v for v in description.modelVariables}
    assert ("time" in described) == (version == 3)
    assert set(described) - {"time"} == {v.name for v in table}
    for variable in table:
        other = described[variable.name]
        assert other.valueReference == variable.value_reference
        assert (other.causality, other.variability) == (variable.causality, variable.variability)
        assert other.unit == variable.unit
        assert other.initial == ("calculated" if variable.causality == "output" else "exact")
        if variable.causality == "output":
            assert other.start is None
        else:
            assert {"true": 1.0, "false": 0.0}.get(other.start) == variable.start or float(other.start) == variable.start
        for bound in ("min", "max"):
            if getattr(variable, bound) is not None:
                assert float(getattr(other, bound)) == getattr(variable, bound)
        if variable.type in table.enumerations:
            assert [item.name for item in other.declaredType.items] == list(table.items(variable.type))
            assert [int(item.value) for item in other.declaredType.items] == list(range(len(other.declaredType.items)))


@pytest.mark.parametrize(("name", "version"), [("DeltaCell.ssp", 3), ("DeltaCell-fmi2.ssp", 2)])
def test_system_description_connects_what_there_is(dist: Path, name: str, version: FmiVersion, tmp_path: Path) -> None:
    system = ssd.read_ssd(str(dist / name)).system
    connectors = {(element.name, connector.name): connector.kind for element in system.elements for connector in element.connectors}
    assert [element.name for element in system.elements] == ["planner", "plant"]
    assert not system.connectors
    assert len(system.connections) == 12
    for connection in system.connections:
        assert connectors[connection.startElement, connection.startConnector] == "output"
        assert connectors[connection.endElement, connection.endConnector] == "input"
        assert connection.startConnector.split(".")[0] == connection.endConnector.split(".")[0]
    with zipfile.ZipFile(dist / name) as container:
        container.extractall(tmp_path)
    for element in system.elements:
        assert (tmp_path / element.source).read_bytes() == (dist / file_name(element.name, version)).read_bytes()
    schema = etree.XMLSchema(etree.parse(fmi_headers().parent / "ssp" / "schema" / "SystemStructureDescription.xsd"))
    schema.assertValid(etree.parse(tmp_path / "SystemStructure.ssd"))


def test_unknown_platforms_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DeltaphError, match="'win64': choose host, all, x86_64-linux, "):
        build(tmp_path / "dist", platform="win64")
    with pytest.raises(DeltaphError, match=r"FMI 2\.0 has no name for aarch64-linux: build it with --fmi 3"):
        build(tmp_path / "dist", [2], platform="aarch64-linux")
    assert not (tmp_path / "dist").exists()


def test_a_file_in_the_way_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(EnvironmentProblem, match="cannot create the directory"):
        build(tmp_path / "file" / "dist")


@pytest.mark.parametrize(
    ("compiler", "sentence"),
    [
        ("no-such-compiler", "named by .CC is not there"),
        ("false", "cannot compile the planner: no message"),
        ("cc -include no-such-header.h", "cannot compile the planner: .*error: no-such-header.h"),
    ],
)
def test_a_compiler_that_does_not_work_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiler: str, sentence: str
) -> None:
    monkeypatch.setenv("CC", compiler)
    with pytest.raises(EnvironmentProblem, match=sentence) as caught:
        build(tmp_path)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_no_compiler_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("deltaph.fmu.compile._package_folder", lambda _: None)
    with pytest.raises(EnvironmentProblem, match="install gcc or clang"):
        build(tmp_path / "dist")
    with pytest.raises(EnvironmentProblem, match="building for x86_64-linux takes the package ziglang"):
        build(tmp_path / "dist", platform="all")
    assert not (tmp_path / "dist").exists()


def test_cache_builds_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dist: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = cached_fmus()
    times = [path.stat().st_mtime_ns for path in first.values()]
    assert cached_fmus() == first
    assert [path.stat().st_mtime_ns for path in first.values()] == times
    for model, path in first.items():
        assert path.is_relative_to(tmp_path / "deltaph")
        assert path.read_bytes() == (dist / path.name).read_bytes(), model


def test_cache_is_made_whole_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cached_fmus()["plant"].unlink()
    assert cached_fmus()["plant"].is_file()
