"""A recorder that is killed leaves a file that opens."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.reading import Reading
from deltaph.telemetry.repair import is_whole, repair

PAPER = Path(__file__).parents[2] / "scenarios" / "paper.toml"
DELTAPH = Path(sys.executable).with_name("deltaph")


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a run that was killed."""
    path = tmp_path_factory.mktemp("killed") / "run.rrd"
    command = [DELTAPH, "run", PAPER, "--no-telemetry", "--cycles", "1000", "--record", path]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 60.0
        while not (path.exists() and path.stat().st_size > 1_000_000):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.kill()
    return path


@pytest.mark.parametrize("torn", [0, 1000])
def test_repaired_copy_is_whole_and_holds_what_was_written(killed: Path, tmp_path: Path, torn: int) -> None:
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(killed.read_bytes()[: killed.stat().st_size - torn])  # a crash may also tear the last message
    assert not is_whole(cut)
    repair(cut, tmp_path / "repaired.rrd")
    assert is_whole(tmp_path / "repaired.rrd")
    assert len(RrdReader(tmp_path / "repaired.rrd").blueprints()) == 1
    step = Reading(tmp_path / "repaired.rrd").rows["joint/position/setpoint"].step
    assert len(step) >= 1000
    assert np.array_equal(step, np.arange(len(step)))


def test_view_opens_a_repaired_copy_and_leaves_the_original(killed: Path, tmp_path: Path) -> None:
    """The viewer itself cannot open a window here; it is given the repaired file all the same."""
    cut = tmp_path / "run.rrd"
    cut.write_bytes(killed.read_bytes())
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run([DELTAPH, "view", cut], capture_output=True, text=True, timeout=60, check=False, env=environment)
    assert "was not finished" in done.stderr.splitlines()[0]
    assert is_whole(tmp_path / "run.repaired.rrd")
    assert cut.read_bytes() == killed.read_bytes()


def test_what_is_no_recording_cannot_be_repaired(tmp_path: Path) -> None:
    (tmp_path / "text.rrd").write_text("not a recording")
    with pytest.raises(EnvironmentProblem, match="nothing of it can be read"):
        repair(tmp_path / "text.rrd", tmp_path / "repaired.rrd")
    assert not (tmp_path / "repaired.rrd").exists()
