"""Other tools import the unedited files and find the trajectory that the product's own importer finds."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from integration.compatibility import RUNS, markdown, readme_table
from integration.importers import STEPS, Table, signals, table

from deltaph.fmu import ssp
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.package import archive, file_name
from deltaph.importer import cosimulate
from deltaph.scenario import load_scenario
from deltaph.schedule import schedule
from deltaph.variables import MODELS

PLANNER = np.array([model == "planner" for model, _ in signals()])


@pytest.fixture(scope="module")
def expected(dist: Path) -> Table:
    """What `deltaph run` computes of the paper's case, which is that of the start values."""
    scenario = load_scenario(Path(__file__).parents[2] / "scenarios" / "paper.toml")
    frames = list(cosimulate(scenario, schedule(scenario), {model: dist / file_name(model, 3) for model in MODELS}))
    return np.array([[*frame.planner_floats, *frame.plant_floats] for frame in frames[1:]])


@pytest.mark.parametrize(("tool", "version", "kind"), RUNS)
def test_trajectory_is_that_of_the_product(
    tool: str, version: FmiVersion, kind: str, dist: Path, expected: Table, tmp_path: Path
) -> None:
    found = table(tool, version, kind, dist, tmp_path)
    assert found.shape == expected.shape == (STEPS, len(signals()))
    assert (found[:, PLANNER] == expected[:, PLANNER]).all()
    # The plant's first inputs may come from its start values or from the planner, which differ by rounding.
    assert np.abs(found - expected).max() < 1e-9


@pytest.mark.parametrize(("tool", "version"), [("ecospy", 2), ("ecospy", 3), ("libcosimpy", 2)])
def test_parameters_of_the_system_description_are_applied(tool: str, version: FmiVersion, dist: Path, tmp_path: Path) -> None:
    name = ssp.file_name(version)
    with zipfile.ZipFile(dist / name) as container:
        files = {entry: container.read(entry) for entry in container.namelist()}
    line = b'<ssv:Parameter name="speed.traverse">'
    before, after = files["SystemStructure.ssd"].split(line)
    files["SystemStructure.ssd"] = before + line + after.replace(b'value="2.4"', b'value="2.0"', 1)
    (tmp_path / name).write_bytes(archive(files))
    column = signals().index(("planner", "tcp.velocity.x"))
    assert table(tool, version, "ssp", tmp_path, tmp_path)[:, column].max() == pytest.approx(2.0, rel=1e-2)
    assert table(tool, version, "ssp", dist, tmp_path)[:, column].max() == pytest.approx(2.4, rel=1e-2)


def test_the_readme_says_what_runs_here() -> None:
    """`python tests/integration/compatibility.py` writes it."""
    assert readme_table() == markdown()
