"""The footer of a recording: appended at the end, or in a copy where the recorder was killed."""

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from integration.waiting import sink_processes, size, wait_until
from rerun.chunk import RrdReader

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.footer import add_footer, has_footer, repair
from deltaph.telemetry.reading import Reading
from deltaph.telemetry.viewer import rerun_binary

PAPER = Path(__file__).parents[2] / "scenarios" / "paper.toml"
DELTAPH = Path(sys.executable).with_name("deltaph")


@pytest.fixture
def without(tmp_path: Path) -> Path:
    """A recording that was written to its end, without a footer."""
    path = tmp_path / "without.rrd"
    with rr.RecordingStream("deltaph") as stream:
        stream.save(path, write_footer=False)
        for step in range(0, 100_000, 1000):
            steps = np.arange(step, step + 1000)
            stream.send_columns("sine", [rr.TimeColumn("step", sequence=steps)], rr.Scalars.columns(scalars=np.sin(steps)))
    return path


def rerun(*arguments: object) -> None:
    command = [str(rerun_binary()), "rrd", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr[:2000]


def test_footer_is_appended_and_nothing_else_changed(without: Path, tmp_path: Path) -> None:
    before = without.read_bytes()
    assert not has_footer(without)
    add_footer(without)
    assert has_footer(without)
    assert without.read_bytes()[: len(before)] == before
    rerun("verify", without)
    store = RrdReader(without).store()
    assert sum(chunk.num_rows for chunk in store.stream() if chunk.entity_path == "/sine") == 100_000
    (tmp_path / "before.rrd").write_bytes(before)
    rerun("compare", without, tmp_path / "before.rrd")


def test_damaged_recording_gets_no_footer(without: Path) -> None:
    whole = without.read_bytes()
    half = len(whole) // 2
    for damaged in (whole[:-100], whole[:half] + bytes(100) + whole[half + 100 :]):
        without.write_bytes(damaged)
        with pytest.raises(EnvironmentProblem, match="is recorded, but without its index"):
            add_footer(without)
        assert without.read_bytes() == damaged


def test_recording_stays_whole_where_there_is_no_room_for_the_footer(without: Path, tmp_path: Path) -> None:
    before = without.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 1000, limits[1]))  # stands for a disk that is full
    try:
        with pytest.raises(EnvironmentProblem, match="without its index: File too large; `deltaph view"):
            add_footer(without)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert without.read_bytes() == before
    repair(without, tmp_path / "repaired.rrd")
    assert has_footer(tmp_path / "repaired.rrd")


def recorder_of(run: subprocess.Popen[Any]) -> int:
    """The process in which a run without telemetry records."""
    return sink_processes(run, 1)[0]


def recorded(path: Path, room: int | None = None) -> subprocess.CompletedProcess[str]:
    """A run that records, with so much room for the recording [bytes]."""
    command = [str(DELTAPH), "run", str(PAPER), "--no-telemetry", "--cycles", "5", "--record", str(path)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            if room is not None:
                resource.prlimit(recorder_of(process), resource.RLIMIT_FSIZE, (room, room))
            _, words = process.communicate(timeout=60)
        finally:
            process.kill()
    return subprocess.CompletedProcess(command, process.returncode, stderr=words)


@pytest.fixture(scope="module")
def indexed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with room enough."""
    path = tmp_path_factory.mktemp("room") / "indexed.rrd"
    done = recorded(path)
    assert done.returncode == 0
    assert done.stderr.splitlines() == [f"recorded {path}: open it with `deltaph view {path}`"]
    assert has_footer(path)
    return path


@pytest.fixture(scope="module")
def kept(indexed: Path) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A recording without room for the footer, and what was said of it."""
    path = indexed.with_name("kept.rrd")
    return path, recorded(path, indexed.stat().st_size - 200_000)  # sizes differ by some kilobytes, as timing does


def test_recording_without_room_for_the_footer_is_kept(kept: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    path, done = kept
    assert done.stderr.startswith(f"deltaph: error: {path} is recorded, but without its index: File too large; ")
    assert done.stderr.count("\n") == 1
    assert done.returncode == 2
    step = Reading(path).rows["joint/position/setpoint"].step
    assert np.array_equal(step, np.arange(5 * 2 * 303 + 51))
    assert "Deviation" in Reading(path).headlines[0]


@pytest.mark.parametrize("missing", [0.9, 0.5, 0.2, 60_000])
def test_recording_without_room_is_one_error_and_no_file(
    kept: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path, missing: float
) -> None:
    """Wherever it ends: in a chunk, or in what comes last; a part of the recording is missing, or some bytes."""
    size = kept[0].stat().st_size
    done = recorded(tmp_path / "run.rrd", int(size - (missing * size if missing < 1.0 else missing)))
    assert done.stderr == f"deltaph: error: cannot write {tmp_path / 'run.rrd'}: File too large\n"
    assert done.returncode == 2
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a recorder that was killed."""
    path = tmp_path_factory.mktemp("killed") / "run.rrd"
    command = [DELTAPH, "run", PAPER, "--no-telemetry", "--cycles", "1000", "--record", path]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        wait_until(lambda: size(path) > 1_000_000, process)
        os.kill(recorder_of(process), signal.SIGKILL)
        process.kill()
    return path


def test_recording_of_a_run_that_was_killed_has_its_footer(tmp_path: Path) -> None:
    """The recorder finishes it."""
    path = tmp_path / "run.rrd"
    command = [DELTAPH, "run", PAPER, "--no-telemetry", "--realtime", "--cycles", "1000", "--record", path]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        wait_until(lambda: size(path) > 0, process)
        process.kill()
    wait_until(lambda: has_footer(path))


@pytest.mark.parametrize("torn", [0, 1000])
def test_repaired_copy_has_footer_and_holds_what_was_written(killed: Path, tmp_path: Path, torn: int) -> None:
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(killed.read_bytes()[: killed.stat().st_size - torn])  # a crash may also tear the last message
    assert not has_footer(cut)
    repair(cut, tmp_path / "repaired.rrd")
    assert has_footer(tmp_path / "repaired.rrd")
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
    assert has_footer(tmp_path / "run.repaired.rrd")
    assert cut.read_bytes() == killed.read_bytes()


def test_what_is_no_recording_cannot_be_repaired(tmp_path: Path) -> None:
    (tmp_path / "text.rrd").write_text("not a recording")
    with pytest.raises(EnvironmentProblem, match="nothing of it can be read"):
        repair(tmp_path / "text.rrd", tmp_path / "repaired.rrd")
    assert not (tmp_path / "repaired.rrd").exists()
