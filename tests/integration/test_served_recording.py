"""What the recording of a cell that served shows: what was commanded, not the scenario's own task, which never ran."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from integration.read_back import Recording
from integration.serving_cell import CELL, DELTAPH, following, serving
from integration.test_following import process
from integration.waiting import DEADLINE

from deltaph.compare import compare
from deltaph.errors import EnvironmentProblem
from deltaph.scenario import template
from deltaph.telemetry import PpoRequest
from deltaph.telemetry.session import free_endpoint
from deltaph.telemetry.viewer import rerun_binary

PLACES = ((0.1, 0.1, -0.8), (-0.15, 0.05, -0.8))
DEVIATIONS = (0.006, 0.004)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Of the cell's own process, and of one that followed it."""
    folder = tmp_path_factory.mktemp("served")
    own, followed, endpoint = folder / "own.rrd", folder / "followed.rrd", free_endpoint()
    with process(DELTAPH, "record", "--cell", CELL, "--connect", endpoint, "-o", followed) as follower:
        serve = serving(folder, template(), "--record", str(own), "--wait-subscribers", "1", endpoint=endpoint)
        with serve as cell, cell.client() as client, following(cell) as found:
            for place, deviation in zip(PLACES, DEVIATIONS, strict=True):
                reply = client.ppo(PpoRequest(place=place, corner_deviation=deviation))
                assert reply.accepted, reply
                found.wait_for_arrival(reply)
            assert not client.ppo(PpoRequest(place=(0.9, 0.0, -0.8))).accepted
            assert cell.end() == 0
            _, words = follower.communicate(timeout=DEADLINE)
            assert follower.returncode == 0 and "no messages lost" in words and "without the cell's end" not in words, words
    return own, followed


def test_both_are_equal(files: tuple[Path, Path]) -> None:
    """Chunk by chunk, as Rerun compares."""
    command = [str(rerun_binary()), "rrd", "compare", *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert done.returncode == 0, done.stderr[:2000]


def test_the_plans_that_were_run_are_drawn(files: tuple[Path, Path]) -> None:
    static = Recording(files[0]).static
    planned = static["/world/path/planned"]["LineStrips3D:strips"]
    assert [np.allclose(strip[-1], place, atol=1e-6) for strip, place in zip(planned, PLACES, strict=True)] == [True, True]
    for side in ("pick", "place"):
        approaches = np.array(static[f"/corner/{side}/approaches"]["Points2D:positions"])
        np.testing.assert_allclose(np.linalg.norm(approaches, axis=1), 1e3 * np.array(DEVIATIONS), atol=0.05)
        radii = np.array(static[f"/world/corner/{side}/ball"]["Ellipsoids3D:half_sizes"])[:, 0]
        np.testing.assert_allclose(radii, DEVIATIONS, rtol=1e-6)
    text = static["/summary"]["TextDocument:text"][0]
    assert "| plan 2, pick | 4.000 | 4.000 |" in text
    assert "ppo: 2 accepted, 1 infeasible" in text


def test_deviation_of_each_pass_and_nothing_beside_vertices_that_were_none(files: tuple[Path, Path]) -> None:
    rows = Recording(files[0]).rows
    np.testing.assert_allclose(np.ravel(rows["/plot/corner/deviation/prescribed"]["Scalars:scalars"].tolist()), [6, 6, 4, 4])
    excess = np.ravel(rows["/plot/corner/excess/planned"]["Scalars:scalars"].tolist())
    np.testing.assert_allclose(excess, 0.0, atol=1e-6)
    for entity in ("/path/deviation/actual", "/path/deviation/limit", "/corner/pick/executed"):
        assert entity not in rows


def test_commanded_path_is_that_of_the_setpoints(files: tuple[Path, Path]) -> None:
    rows = Recording(files[0]).rows
    setpoints = np.array(rows["/tcp/position/setpoint"]["Scalars:scalars"].tolist())
    strips = rows["/world/path/commanded"]["LineStrips3D:strips"]
    joined = np.concatenate([np.array(strip[0] if len(strip) == 1 else strip).reshape(-1, 3)[:-1] for strip in strips])
    np.testing.assert_allclose(joined, setpoints[: len(joined)], atol=1e-6)
    assert len(setpoints) - len(joined) == 1


def test_there_is_nothing_to_compare_it_by(files: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(EnvironmentProblem, match="is of a cell that served"):
        compare(*files, tmp_path / "both.rrd")
    assert not (tmp_path / "both.rrd").exists()


def test_a_cell_that_was_told_nothing_leaves_a_recording(tmp_path: Path) -> None:
    with serving(tmp_path, template(), "--record", "idle.rrd") as cell, following(cell) as found:
        found.wait_for_time(0.1)
        assert cell.end() == 0, cell.said
    assert Recording(tmp_path / "idle.rrd").static["/summary"]["TextDocument:text"]
