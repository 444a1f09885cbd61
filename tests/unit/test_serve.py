"""The two sides of a cell that serves, each without the other."""

import io
import os
import signal
import sys
import threading
from pathlib import Path

import pytest

from deltaph.attendant import Override
from deltaph.desk import Desk, Journal
from deltaph.scenario import parse_scenario, template
from deltaph.serve import _ending
from deltaph.telemetry import Answering, PpoRequest, line

SCENARIO = parse_scenario(template(), Path("paper.toml"))
REQUEST = PpoRequest(place=SCENARIO.task.place)


def desk() -> tuple[Desk, tuple[Answering, Answering]]:
    """A desk, and what a step loop has of it."""
    (ask_override, overrides), (ask_task, tasks) = line(), line()
    return Desk(SCENARIO, ask_override, ask_task), (overrides, tasks)


def test_loop_that_does_not_answer_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deltaph.desk.VERDICT_TIMEOUT", 0.05)
    asking, answering = desk()
    for reply in (asking.ppo(REQUEST), asking.ppo(REQUEST), asking.override("hold", None)):
        assert (reply.outcome, reply.reason) == ("failed", "the cell has not decided within 0.05 s: it may yet")
    assert [answering[1].question() for _ in range(3)] == ["standing", "standing", None]


def test_end_of_the_cell_is_an_answer() -> None:
    asking, answering = desk()
    for end in answering:
        threading.Timer(0.05, end.close).start()
    for reply in (asking.ppo(REQUEST), asking.override("stop", None)):
        assert (reply.outcome, reply.reason) == ("failed", "the cell ends")


def test_override_keeps_the_feed_apart_from_the_hold() -> None:
    override = Override()
    states = []
    for command, value in (
        ("feed", 0.5),
        ("hold", None),
        ("feed", 0.0),
        ("resume", None),
        ("stop", None),
        ("hold", None),
        ("resume", None),
    ):
        override = override.after(command, value)
        states.append((override.value, override.held, override.stopped, override.stops))
    assert states == [
        (0.5, False, False, 0),
        (0.5, True, False, 0),
        (0.0, True, False, 0),
        (0.0, False, False, 0),
        (0.0, True, True, 1),
        (0.0, True, True, 1),
        (0.0, False, False, 1),
    ]


def test_journal_says_all_that_is_accepted_and_one_refusal_a_second(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    journal = Journal(lambda: now)
    for k in range(5):
        journal(f"command ppo refused (busy): {k}")
    journal("command hold accepted: held")
    now = 1.5
    journal("command ppo refused (busy): 5")
    assert capsys.readouterr().err.splitlines() == [
        "command ppo refused (busy): 0",
        "command hold accepted: held (and 4 refused since the last line)",
        "command ppo refused (busy): 5",
    ]


def test_first_signal_ends_and_the_second_one_is_what_it_was() -> None:
    ended = threading.Event()
    before = signal.getsignal(signal.SIGTERM)
    with _ending(ended.set):
        os.kill(os.getpid(), signal.SIGTERM)
        assert ended.wait(5.0)
        assert signal.getsignal(signal.SIGTERM) is before
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_journal_that_nobody_reads_any_more_does_not_keep_a_command_from_its_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    class Gone(io.StringIO):
        def write(self, _: str) -> int:
            raise BrokenPipeError

    monkeypatch.setattr(sys, "stderr", Gone())
    Journal()("command hold accepted: held")
