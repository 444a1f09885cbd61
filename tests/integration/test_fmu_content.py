"""What lies in an FMU beside its description and libraries: terminals, icon, equations, licences, expected result."""

from __future__ import annotations

import csv
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from integration.fmi_slave import FmiSlave
from lxml import etree

from deltaph.fmu.compile import fmi_headers
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.package import file_name
from deltaph.importer import CONNECTIONS
from deltaph.sources import FMU_SRC
from deltaph.variables import MODELS, Model, variable_table

RESULT = "extra/org.fmi-standard.fmi-ls-ref"


def read(dist: Path, model: Model, version: FmiVersion, name: str) -> bytes:
    with zipfile.ZipFile(dist / file_name(model, version)) as container:
        return container.read(name)


def terminals(dist: Path, model: Model) -> dict[str, dict[str, str]]:
    """Terminal -> member -> variable."""
    root = etree.fromstring(read(dist, model, 3, "terminalsAndIcons/terminalsAndIcons.xml"))
    schema = etree.XMLSchema(etree.parse(fmi_headers().parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"))
    schema.assertValid(root)
    return {t.get("name"): {m.get("memberName"): m.get("variableName") for m in t} for t in root.iter("Terminal")}


def test_terminals_plug_what_the_importer_wires(dist: Path) -> None:
    planner, plant = (terminals(dist, model) for model in MODELS)
    pairs = {(planner[name][member], plant[name][member]) for name in planner for member in planner[name]}
    assert pairs == set(CONNECTIONS)
    assert all(variable_table("planner")[name].causality == "output" for name, _ in pairs)
    assert all(variable_table("plant")[name].causality == "input" for _, name in pairs)


def test_icon_is_a_picture(dist: Path, model: Model, version: FmiVersion) -> None:
    content = read(dist, model, version, "model.png" if version == 2 else "terminalsAndIcons/icon.png")
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack_from(">II", content, 16)
    (size,) = struct.unpack_from(">I", content, 33)
    rows = np.frombuffer(zlib.decompress(content[41 : 41 + size]), np.uint8).reshape(height, 1 + 3 * width)
    assert (width, height) == (200, 200)
    assert 0.5 < (rows[:, 1:] == 255).mean() < 0.98


def test_documentation_has_the_equations(dist: Path, model: Model, version: FmiVersion) -> None:
    page = read(dist, model, version, "documentation/index.html").decode()
    readme = (FMU_SRC / model / "README.md").read_text(encoding="utf-8")
    headings = [line.removeprefix("## ") for line in readme.splitlines() if line.startswith("## ")]
    assert len(headings) > 4
    for heading in headings[:-1]:
        assert f"<h2>{heading}</h2>" in page
    assert "<pre><code>" in page
    assert "<table>" in page


def test_licences_are_there(dist: Path, model: Model, version: FmiVersion) -> None:
    assert b"BSD 3-Clause" in read(dist, model, version, "documentation/licenses/license.txt")


def test_the_expected_result_is_the_result(dist: Path, model: Model, version: FmiVersion) -> None:
    """`python tests/make_reference.py` writes it."""
    manifest = etree.fromstring(read(dist, model, version, f"{RESULT}/fmi-ls-manifest.xml"))
    (related,) = manifest.iter("Related")
    lines = read(dist, model, version, f"{RESULT}/{related.get('source')}").decode().splitlines()
    names = next(csv.reader(lines))
    expected = np.array([[float(value) for value in row] for row in csv.reader(lines[1:])])
    assert names == ["time", *(v.name for v in variable_table(model).of("output"))]
    result = simulate_fmu(str(dist / file_name(model, version)), output=names[1:], step_size=1e-3, output_interval=1e-3)
    found = np.column_stack([result[name] for name in names])[::10]
    assert found.shape == expected.shape
    assert (np.abs(found - expected) <= 1e-8 * np.maximum(1.0, np.abs(expected))).all()  # nine digits are written


@pytest.mark.parametrize("attribute", ["min", "max", "start"])
def test_bounds_stand_in_the_description(dist: Path, model: Model, version: FmiVersion, attribute: str) -> None:
    root = etree.fromstring(read(dist, model, version, "modelDescription.xml"))
    elements = {e.get("name"): e if version == 3 else e[0] for e in root.find("ModelVariables")}
    for variable in variable_table(model):
        value = getattr(variable, attribute)
        if value is not None and variable.causality != "output":
            text = elements[variable.name].get(attribute)
            assert ({"false": 0, "true": 1}[text] if variable.type == "Boolean" else float(text)) == value


def test_capabilities_promise_only_what_is_there(dist: Path, model: Model, version: FmiVersion, tmp_path: Path) -> None:
    root = etree.fromstring(read(dist, model, version, "modelDescription.xml"))
    (interface,) = root.iter("CoSimulation")
    promised = {name for name, value in interface.attrib.items() if value == "true"}
    state = {2: "FMUstate", 3: "FMUState"}[version]
    expected = {"canHandleVariableCommunicationStepSize", f"canGetAndSet{state}", f"canSerialize{state}"}
    assert promised == expected | ({"canNotUseMemoryManagementFunctions"} if version == 2 else set())
    slave = FmiSlave(dist, model, version, tmp_path)
    slave.initialize()
    assert slave.step(0.0, 2e-3) == slave.step(2e-3, 5e-3) == 0
    assert slave.restore(slave.deserialize(slave.serialize(slave.save()))[1]) == 0
    slave.free()
