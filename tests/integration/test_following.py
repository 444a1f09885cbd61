"""A real cell, followed from other processes at the same time: into a file, and into viewers."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
from integration.read_back import Recording, assert_same_rows
from integration.waiting import DEADLINE, wait_until
from rerun.experimental import ViewerClient

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.destination import RunningViewer
from deltaph.telemetry.footer import repair
from deltaph.telemetry.session import free_endpoint, free_port
from deltaph.telemetry.viewer import StartedViewer, rerun_binary, start_viewer

PAPER = Path(__file__).parents[2] / "scenarios" / "paper.toml"
DELTAPH = Path(sys.executable).with_name("deltaph")
CYCLES = 8  # longer than one chunk
STEPS = CYCLES * 2 * 303 + 50

needs_vulkan = pytest.mark.skipif(
    not any(Path(folder).glob("vulkan/icd.d/*.json") for folder in ("/usr/share", "/etc", "/usr/local/share")),
    reason="there is no Vulkan driver, which a viewer draws with: install Debian's mesa-vulkan-drivers",
)


@contextmanager
def process(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """A command, ended at the end of the test if it has not ended by itself."""
    command = [str(argument) for argument in arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as started:
        try:
            yield started
        finally:
            started.kill()


@contextmanager
def saving_viewer(path: Path) -> Iterator[str]:
    """What a viewer is for those who send: it writes what comes into a file, and needs no graphics."""
    port = free_port()
    with process(rerun_binary(), "--bind", "127.0.0.1", "--port", port, "--save", path):
        url = f"rerun+http://127.0.0.1:{port}/proxy"

        def answers() -> bool:
            try:
                RunningViewer(url)
            except EnvironmentProblem:
                return False
            return True

        wait_until(answers)
        yield url


@contextmanager
def headless_viewer() -> Iterator[StartedViewer]:
    viewer = start_viewer(["--headless"])
    try:
        yield viewer
    finally:
        viewer.process.kill()
        viewer.process.wait()


def finished(followers: list[subprocess.Popen[str]], endpoint: str, *options: object) -> list[str]:
    """Run the cell, with its followers there, to its end and theirs: what the followers say."""
    run = [DELTAPH, "run", PAPER, "--realtime", "--cycles", CYCLES, "--listen", endpoint, "--wait-subscribers", len(followers)]
    done = subprocess.run([*map(str, run), *map(str, options)], capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert done.returncode == 0, done.stderr
    said = [follower.communicate(timeout=DEADLINE)[1] for follower in followers]
    assert [follower.returncode for follower in followers] == [0] * len(followers), said
    return said


class Followed(NamedTuple):
    """The same run: as it was recorded by itself, over Zenoh, and as a viewer was sent it."""

    run: Path
    recorded: Path
    shown: Path


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Followed]:
    folder = tmp_path_factory.mktemp("followed")
    files = Followed(folder / "run.rrd", folder / "recorded.rrd", folder / "shown.rrd")
    unfinished = folder / "unfinished.rrd"
    endpoint = free_endpoint()
    with ExitStack() as stack:
        url = stack.enter_context(saving_viewer(unfinished))
        record = stack.enter_context(process(DELTAPH, "record", "--connect", endpoint, "-o", files.recorded))
        view = stack.enter_context(process(DELTAPH, "view", "--live", "--url", url, "--connect", endpoint))
        said = finished([record, view], endpoint, "--record", files.run)
        assert all("no messages lost" in words and "without the cell's end" not in words for words in said), said

        def complete() -> bool:
            repair(unfinished, files.shown)  # it has no end: a viewer may be sent more
            return "/corner/place/nearest/distance" in Recording(files.shown).static  # the last of it

        wait_until(complete)
        yield files


def test_recording_over_zenoh_equals_that_of_the_run(followed: Followed) -> None:
    """Chunk by chunk, as Rerun compares."""
    compare = [str(rerun_binary()), "rrd", "compare", str(followed.run), str(followed.recorded)]
    done = subprocess.run(compare, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert done.returncode == 0, done.stderr[:2000]


def test_a_viewer_is_sent_what_is_recorded(followed: Followed) -> None:
    shown, recorded = Recording(followed.shown), Recording(followed.run)
    assert len(shown.rows["/joint/position/actual"]["step"]) == STEPS + 1
    assert_same_rows(recorded, shown)
    for entity, components in recorded.static.items():
        for name in components.keys() - {"rerun.controls.RowId", "RecordingInfo:start_time"}:
            assert shown.static[entity][name] == components[name], (entity, name)
    assert len(shown.blueprints) == 1


@needs_vulkan
def test_viewer_follows_the_cell_and_stays() -> None:
    endpoint = free_endpoint()
    with headless_viewer() as viewer:
        with process(DELTAPH, "view", "--live", "--url", viewer.url, "--connect", endpoint) as view:
            finished([view], endpoint)
        client = ViewerClient.connect(viewer.url)

        def seen() -> bool:
            (recording,) = client.get_state().recordings
            ends = {timeline.name: timeline.end for timeline in recording.timelines}
            return ends == {"sim_time": STEPS * 1_000_000, "step": STEPS} and recording.current_time == STEPS * 1_000_000

        wait_until(seen)
        state = client.get_state()
        assert {"Verdict", "Cell", "Pick corner [mm]", "Place corner [mm]"} <= {view.name for view in state.views}
        assert not [report for view in state.views for report in view.reports]
        assert viewer.process.poll() is None


@needs_vulkan
def test_a_viewer_that_is_closed_ends_the_view_and_not_the_cell() -> None:
    endpoint = free_endpoint()
    run = [DELTAPH, "run", PAPER, "--realtime", "--cycles", "1000", "--listen", endpoint, "--wait-subscribers", "1"]
    with (
        headless_viewer() as viewer,
        process(DELTAPH, "view", "--live", "--url", viewer.url, "--connect", endpoint) as view,
        process(*run) as cell,
    ):
        client = ViewerClient.connect(viewer.url)
        wait_until(lambda: bool(client.get_state().recordings))
        viewer.process.kill()
        _, words = view.communicate(timeout=DEADLINE)
        assert view.returncode == 0, words
        assert f"the viewer on {viewer.url} does not answer any more" in words
        assert cell.poll() is None


def test_without_a_screen_there_is_one_clear_line() -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [str(DELTAPH), "view", "--live", "--connect", free_endpoint()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False, env=environment)
    assert done.returncode == 2
    assert done.stderr.startswith("deltaph: error: the Rerun viewer did not start: ")
    assert "DISPLAY" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("url", "words"),
    [("http://127.0.0.1:1/proxy", "it is not of the form"), ("rerun+http://127.0.0.1:1/proxy", "Connection refused")],
)
def test_a_viewer_that_is_not_there_is_said(url: str, words: str) -> None:
    with pytest.raises(EnvironmentProblem, match=words):
        RunningViewer(url)
