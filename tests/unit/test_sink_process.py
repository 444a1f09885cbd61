"""Sinks in another process; they tell what they have seen when they are asked."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import TypeVar

import pytest
from integration.sinks import Broken, Gate, Steps, none_of_it
from integration.synthetic_cell import random_frame
from integration.waiting import wait_until

from deltaph.errors import EnvironmentProblem
from deltaph.frame import Sink
from deltaph.telemetry import SinkProcess

FRAMES = [random_frame(step) for step in range(50)]

S = TypeVar("S", bound=Sink)


def is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@contextmanager
def sink_process(open_sink: Callable[[], S], capacity: int = 100) -> Iterator[SinkProcess[S]]:
    sink = SinkProcess("sink", open_sink, capacity)
    try:
        yield sink
    finally:
        sink.close()


def test_all_frames_arrive_in_order_in_another_process(tmp_path: Path) -> None:
    with sink_process(partial(Steps, tmp_path / "closed")) as sink:
        for frame in FRAMES:
            sink.take(frame)
        assert sink.ask(Steps.steps) == list(range(50))
        pid = sink.ask(Steps.pid)
        assert pid != os.getpid()
        assert sink.dropped == 0
    assert (tmp_path / "closed").read_text(encoding="ascii") == "50"
    assert not is_there(pid)
    sink.close()


def test_a_full_ring_never_blocks_and_is_counted(tmp_path: Path) -> None:
    with sink_process(partial(Gate, tmp_path), capacity=10) as sink:
        sink.take(FRAMES[0])
        wait_until((tmp_path / "waiting").exists)  # one is at work, the ring is empty
        for frame in FRAMES[1:]:
            sink.take(frame)
        assert sink.dropped == len(FRAMES) - 11
        (tmp_path / "open").touch()
        assert sink.ask(Steps.steps) == list(range(11))


def test_what_is_told_is_done_between_the_frames_before_and_behind() -> None:
    with sink_process(Steps) as sink:
        for frame in FRAMES[:3]:
            sink.take(frame)
        sink.tell(methodcaller("take", FRAMES[40]))
        for frame in FRAMES[3:5]:
            sink.take(frame)
        assert sink.ask(Steps.steps) == [0, 1, 2, 40, 3, 4]


def test_an_error_comes_out_of_close_and_the_frames_behind_it_are_counted() -> None:
    sink = SinkProcess("sink", Broken, 100)
    for frame in FRAMES:
        sink.take(frame)
    with pytest.raises(EnvironmentProblem, match="the disk is full"):
        sink.close()
    assert sink.dropped == len(FRAMES) - 2


def test_an_error_that_was_heard_is_not_raised_again() -> None:
    with sink_process(Broken) as sink:
        for frame in FRAMES:
            sink.take(frame)
        with pytest.raises(EnvironmentProblem, match="the disk is full"):
            sink.ask(Steps.steps)


def test_a_question_that_fails_does_not_end_the_sink() -> None:
    with sink_process(Steps) as sink:
        with pytest.raises(EnvironmentProblem, match="not that"):
            sink.ask(Steps.refuse)
        sink.take(FRAMES[0])
        assert sink.ask(Steps.steps) == [0]


def test_a_sink_that_cannot_be_opened_says_so_when_asked() -> None:
    with sink_process(none_of_it) as sink, pytest.raises(EnvironmentProblem, match="it cannot be opened"):
        sink.await_open()


def test_a_process_that_was_killed_is_told() -> None:
    with sink_process(Steps) as sink:
        os.kill(sink.ask(Steps.pid), signal.SIGKILL)
        for _ in range(2):
            sink.tell(Steps.refuse)  # does not throw: it is called in step loops
        with pytest.raises(EnvironmentProblem, match="the process of the sink has died, exit code -9"):
            sink.ask(Steps.steps)
        for frame in FRAMES:
            sink.take(frame)


def test_frames_of_a_process_that_has_died_are_dropped_once_it_is_known(tmp_path: Path) -> None:
    sink = SinkProcess("sink", partial(Gate, tmp_path), 100)
    (tmp_path / "open").touch()
    for frame in FRAMES[:10]:
        sink.take(frame)
    pid = sink.ask(Steps.pid)
    assert sink.death() is None
    assert (sink.taken, sink.dropped) == (10, 0)
    (tmp_path / "waiting").unlink()
    (tmp_path / "open").unlink()
    for frame in FRAMES[10:30]:
        sink.take(frame)
    wait_until((tmp_path / "waiting").exists)  # one is at work, and has not been taken
    os.kill(pid, signal.SIGKILL)
    wait_until(sink.death)
    assert "the process of the sink has died, exit code -9" in str(sink.death())
    assert (sink.taken, sink.dropped) == (10, 20)
    for frame in FRAMES[30:]:
        sink.take(frame)
    assert sink.dropped == 40
    with pytest.raises(EnvironmentProblem, match="the process of the sink has died, exit code -9"):
        sink.close()
    assert sink.dropped == 40


def test_frames_are_counted_where_a_question_finds_the_process_dead() -> None:
    with sink_process(Steps) as sink:
        os.kill(sink.ask(Steps.pid), signal.SIGKILL)
        for frame in FRAMES:
            sink.take(frame)
        with pytest.raises(EnvironmentProblem, match="has died"):
            sink.ask(Steps.steps)
        assert sink.dropped == len(FRAMES)


def test_process_that_was_closed_has_not_died() -> None:
    with sink_process(Steps) as sink:
        for frame in FRAMES:
            sink.take(frame)
    assert sink.death() is None
    assert (sink.taken, sink.dropped) == (len(FRAMES), 0)


def test_signals_are_for_the_process_that_started_it() -> None:
    with sink_process(Steps) as sink:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(sink.ask(Steps.pid), number)
        assert sink.ask(Steps.steps) == []


LEFT_ALONE = """
import sys, time
from functools import partial
from pathlib import Path
from deltaph.telemetry import SinkProcess
from integration.sinks import Steps
from integration.synthetic_cell import random_frame
sink = SinkProcess("sink", partial(Steps, Path(sys.argv[1])), 100)
sink.await_open()
for step in range(50):
    sink.take(random_frame(step))
print("taken", flush=True)
sys.stdin.read()
"""


def test_a_sink_is_closed_when_the_process_that_started_it_is_killed(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-c", LEFT_ALONE, str(tmp_path / "closed")]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"taken\n"
        process.kill()
        wait_until((tmp_path / "closed").exists)
    wait_until(lambda: (tmp_path / "closed").read_text(encoding="ascii") == "50")
