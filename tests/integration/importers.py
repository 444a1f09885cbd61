"""The cell in other tools: each steps both FMUs for the default experiment, wired by name, and gives the same table.

    python importers.py TOOL VERSION fmu|ssp DIRECTORY RESULT.npy   (the directory is one that `deltaph build` wrote)

A process of its own per run: these tools bring shared libraries that need an environment, and some end the process when they fail.
Rows are communication points from the first step on; columns are `signals()`. Nothing is set: what runs are the unedited files.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from deltaph.fmu.model_description import STEP_SIZE, STOP_TIME, FmiVersion
from deltaph.fmu.package import file_name
from deltaph.importer import CONNECTIONS
from deltaph.variables import MODELS, Model, variable_table

STEPS = round(STOP_TIME / STEP_SIZE)

Table = np.ndarray[Any, np.dtype[np.float64]]


def signals() -> list[tuple[Model, str]]:
    """Every Float64 output of both models."""
    return [(model, v.name) for model in MODELS for v in variable_table(model).of("output") if v.is_float]


def reference(model: Model, name: str) -> int:
    """Value reference."""
    return variable_table(model)[name].value_reference


def _fmpy(dist: Path, version: FmiVersion, kind: str) -> Iterator[list[float]]:
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    assert kind == "fmu"
    slaves: dict[Model, Any] = {}
    for model in MODELS:
        folder = extract(str(dist / file_name(model, version)))
        description = read_model_description(folder)
        identifier = description.coSimulation.modelIdentifier
        make = FMU2Slave if version == 2 else FMU3Slave
        slaves[model] = make(guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName=model)
        slaves[model].instantiate()
        if version == 2:
            slaves[model].setupExperiment(startTime=0.0)
            slaves[model].enterInitializationMode()
        else:
            slaves[model].enterInitializationMode(startTime=0.0)
        slaves[model].exitInitializationMode()
    get, put = ("getReal", "setReal") if version == 2 else ("getFloat64", "setFloat64")
    sources = [reference("planner", output) for output, _ in CONNECTIONS]
    targets = [reference("plant", name) for _, name in CONNECTIONS]
    columns = {model: [reference(m, name) for m, name in signals() if m == model] for model in MODELS}
    for n in range(STEPS):
        getattr(slaves["plant"], put)(targets, getattr(slaves["planner"], get)(sources))
        for model in MODELS:
            slaves[model].doStep(n * STEP_SIZE, STEP_SIZE)
        yield [value for model in MODELS for value in getattr(slaves[model], get)(columns[model])]


def _ecos(dist: Path, version: FmiVersion, kind: str) -> Iterator[list[float]]:
    from ecospy import EcosSimulation, EcosSimulationStructure

    from deltaph.fmu import ssp

    def rows(simulation: Any) -> Iterator[list[float]]:
        for _ in range(STEPS):
            simulation.step(1)
            yield [simulation.get_real(f"{model}::{name}") for model, name in signals()]
        simulation.terminate()

    if kind == "ssp":
        with EcosSimulation(ssp_path=str(dist / ssp.file_name(version)), step_size=STEP_SIZE) as simulation:
            simulation.init(parameter_set=ssp.PARAMETER_SET)
            yield from rows(simulation)
        return
    with EcosSimulationStructure() as structure:
        for model in MODELS:
            structure.add_model(model, str(dist / file_name(model, version)))
        for output, name in CONNECTIONS:
            structure.make_real_connection(f"planner::{output}", f"plant::{name}")
        with EcosSimulation(structure=structure, step_size=STEP_SIZE) as simulation:
            simulation.init()
            yield from rows(simulation)


def _libcosim(dist: Path, version: FmiVersion, kind: str) -> Iterator[list[float]]:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    from deltaph.fmu import ssp

    step_ns = round(1e9 * STEP_SIZE)
    if kind == "ssp":
        execution = CosimExecution.from_ssp_file(str(dist / ssp.file_name(version)), step_size=step_ns)
        index = {info.name.decode(): info.index for info in execution.slave_infos()}
    else:
        execution = CosimExecution.from_step_size(step_ns)
        index = {}
        for model in MODELS:
            slave = CosimLocalSlave(fmu_path=str(dist / file_name(model, version)), instance_name=model)
            index[model] = execution.add_local_slave(slave)
        for output, name in CONNECTIONS:
            planner, plant = reference("planner", output), reference("plant", name)
            execution.connect_real_variables(index["planner"], planner, index["plant"], plant)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    columns = {model: [reference(m, name) for m, name in signals() if m == model] for model in MODELS}
    for _ in range(STEPS):
        assert execution.step()
        yield [value for model in MODELS for value in observer.last_real_values(index[model], columns[model])]


def _fmucontainer(dist: Path, version: FmiVersion, kind: str) -> Iterator[list[float]]:
    """Packed into one FMU, which runs in fmpy."""
    from fmpy import simulate_fmu

    assert kind == "fmu"
    files = {model: file_name(model, version) for model in MODELS}
    recipe = {
        "name": "cell.fmu",
        "fmu": list(files.values()),
        "link": [[files["planner"], output, files["plant"], name] for output, name in CONNECTIONS],
        "output": [[files[model], name, f"{model}.{name}"] for model, name in signals()],
        "auto_link": False,
        "auto_output": False,
        "auto_input": False,
        "step_size": STEP_SIZE,
    }
    with tempfile.TemporaryDirectory() as temporary:
        for name in files.values():
            (Path(temporary) / name).write_bytes((dist / name).read_bytes())
        (Path(temporary) / "cell.json").write_text(json.dumps(recipe))
        tool = Path(sys.executable).parent / "fmucontainer"
        command = [str(tool), "-fmu-directory", temporary, "-container", "cell.json", "-fmi", str(version)]
        subprocess.run(command, check=True)
        names = [f"{model}.{name}" for model, name in signals()]
        result = simulate_fmu(
            str(Path(temporary) / "cell.fmu"), stop_time=STOP_TIME, step_size=STEP_SIZE, output_interval=STEP_SIZE, output=names
        )
        yield from ([row[name] for name in names] for row in result[1:])


TOOLS: dict[str, Callable[[Path, FmiVersion, str], Iterator[list[float]]]] = {
    "fmpy": _fmpy,
    "ecospy": _ecos,
    "libcosimpy": _libcosim,
    "fmucontainer": _fmucontainer,
}


def table(tool: str, version: FmiVersion, kind: str, dist: Path, directory: Path) -> Table:
    """Run one tool in a process of its own.

    Args:
        tool: its name in TOOLS.
        version: of the FMUs.
        kind: `fmu`, wired by the tool, or `ssp`, wired by the system description.
        dist: what `deltaph build` wrote.
        directory: for the result.
    """
    result = directory / f"{tool}{version}{kind}.npy"
    # ecospy needs the libraries of the package tbb, which lie where the loader does not look.
    environment = os.environ | {"LD_LIBRARY_PATH": f"{sys.prefix}/lib"}
    command = [sys.executable, __file__, tool, str(version), kind, str(dist), str(result)]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    loaded: Table = np.load(result)
    return loaded


def main() -> None:
    """Run one tool and save its table (STEPS, number of signals)."""
    tool, version, kind, dist, result = sys.argv[1:]
    rows = list(TOOLS[tool](Path(dist), 2 if version == "2" else 3, kind))
    np.save(result, np.array(rows))


if __name__ == "__main__":
    main()
