"""Source FMUs: two tools compile them, and what comes out exports the interface, needs libc alone and computes the same."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.model_description import read_build_description
from integration.cell_process import compile_host, run_cell
from integration.importers import TOOLS, signals

from deltaph.errors import EnvironmentProblem
from deltaph.fmu import FMI_VERSIONS
from deltaph.fmu.compile import compiler, fmi_headers
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.package import archive, file_name
from deltaph.fmu.platforms import host
from deltaph.variables import MODELS, Model, variable_table

COMPILERS = {
    "fmpy": ("fmpy", "compile", "{fmu}"),
    "fmutool": ("fmutool", "-input", "{bare}", "-compile-sources", "-output", "{fmu}"),
}


@pytest.fixture(scope="module", params=COMPILERS)
def compiled(request: pytest.FixtureRequest, dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with the FMUs, their libraries made from their own sources by a tool."""
    directory = tmp_path_factory.mktemp(request.param)
    scripts = Path(sys.executable).parent
    for name in (file_name(model, version) for model in MODELS for version in FMI_VERSIONS):
        with zipfile.ZipFile(dist / name) as container:
            files = {entry: container.read(entry) for entry in container.namelist() if not entry.startswith("binaries/")}
        bare = directory / f"bare-{name}"
        bare.write_bytes(archive(files))
        (directory / name).write_bytes(bare.read_bytes())
        tool, *arguments = (part.format(bare=bare, fmu=directory / name) for part in COMPILERS[request.param])
        environment = {"PATH": f"{scripts}:/usr/local/bin:/usr/bin:/bin"}
        run = subprocess.run([str(scripts / tool), *arguments], env=environment, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr
    return directory


def library(directory: Path, model: Model, version: FmiVersion, to: Path) -> Path:
    """The shared library of an FMU, unpacked."""
    with zipfile.ZipFile(directory / file_name(model, version)) as container:
        member = f"binaries/{host().folder(version)}/{variable_table(model).model}{host().extension}"
        return Path(container.extract(member, to))


@pytest.mark.parametrize("version", FMI_VERSIONS)
def test_compiled_sources_compute_the_same(compiled: Path, dist: Path, version: FmiVersion) -> None:
    expected = np.array(list(TOOLS["fmpy"](dist, version, "fmu")))
    found = np.array(list(TOOLS["fmpy"](compiled, version, "fmu")))
    scale = np.maximum(np.abs(expected).max(axis=0), 1e-9)
    planner = np.array([model == "planner" for model, _ in signals()])
    # Other elementary functions, each within a few units in the last place; the plant's loops amplify them.
    assert (np.abs(found - expected)[:, planner] <= 1e-14 * scale[planner]).all()
    assert (np.abs(found - expected)[:, ~planner] <= 1e-9 * np.maximum(scale[~planner], 1.0)).all()


def test_compiled_sources_load_where_there_is_no_libm(compiled: Path, tmp_path: Path) -> None:
    try:
        compile_host(compiler(), tmp_path / "host")
    except EnvironmentProblem as reason:
        pytest.skip(str(reason))
    libraries = {model: library(compiled, model, 3, tmp_path) for model in MODELS}
    assert (run_cell([str(tmp_path / "host")], libraries) == list(TOOLS["fmpy"](compiled, 3, "fmu"))).all()


def test_compiled_sources_export_the_interface_alone(compiled: Path, model: Model, version: FmiVersion, tmp_path: Path) -> None:
    nm = shutil.which("nm")
    if nm is None or host().extension != ".so":
        pytest.skip("needs nm and an ELF library")
    path = library(compiled, model, version, tmp_path)
    defined = subprocess.run([nm, "-D", "--defined-only", str(path)], capture_output=True, text=True, check=True).stdout
    names = {line.split()[-1] for line in defined.splitlines()}
    assert len(names) == {2: 44, 3: 75}[version]
    assert all(name.startswith(f"fmi{version}") for name in names)
    missing = subprocess.run([nm, "-D", "--undefined-only", str(path)], capture_output=True, text=True, check=True).stdout
    needed = {re.sub("@.*", "", line.split()[-1]) for line in missing.splitlines() if line.split()[-2] == "U"}
    assert needed <= {"calloc", "free", "memcpy", "memset", "snprintf", "vsnprintf", "strcmp", "strlen", "strspn"} | {
        name for name in needed if name.startswith("__")
    }


def test_sources_are_complete_in_themselves(dist: Path, model: Model, version: FmiVersion, tmp_path: Path) -> None:
    """With the headers that lie beside it, one call of a compiler is enough, and there is nothing to warn of."""
    try:
        command = compiler()
    except EnvironmentProblem as reason:
        pytest.skip(str(reason))
    with zipfile.ZipFile(dist / file_name(model, version)) as container:
        container.extractall(tmp_path, [name for name in container.namelist() if name.startswith("sources/")])
    source = f"{variable_table(model).model}.c"
    options = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared", "-isystem", ".", source, "-o", "library"]
    run = subprocess.run([*command, *options], cwd=tmp_path / "sources", capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    for header in (tmp_path / "sources").glob("*.h"):
        assert header.read_bytes() == (fmi_headers() / header.name).read_bytes()


def test_descriptions_name_the_source(dist: Path, model: Model) -> None:
    identifier = variable_table(model).model
    (configuration,) = read_build_description(str(dist / file_name(model, 3)))
    (sources,) = configuration.sourceFileSets
    assert (configuration.modelIdentifier, sources.sourceFiles) == (identifier, [f"{identifier}.c"])
    with zipfile.ZipFile(dist / file_name(model, 2)) as container:
        assert f'<File name="{identifier}.c" />'.encode() in container.read("modelDescription.xml")
        assert f"sources/{identifier}.c" in container.namelist()
