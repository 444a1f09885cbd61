"""The two sides of a cell that serves, each without the other."""

import os
import signal
import threading
from pathlib import Path

import pytest

from deltaph.scenario import parse_scenario, template
from deltaph.serve import Attendant, _ending, _Journal
from deltaph.tally import Tally
from deltaph.telemetry import PpoRequest

SCENARIO = parse_scenario(template(), Path("paper.toml"))
REQUEST = PpoRequest(place=SCENARIO.task.place)


def test_planner_that_does_not_decide_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deltaph.serve.VERDICT_TIMEOUT", 0.05)
    attendant = Attendant(SCENARIO, Tally(0.0))
    for _ in range(2):  # the first one is still there when the second one comes
        reply = attendant.ppo(REQUEST)
        assert (reply.outcome, reply.reason) == ("failed", "the planner has not decided within 0.05 s: it may yet")


def test_end_of_the_cell_is_an_answer() -> None:
    attendant = Attendant(SCENARIO, Tally(0.0))
    threading.Timer(0.05, attendant.end).start()
    reply = attendant.ppo(REQUEST)
    assert (reply.outcome, reply.reason) == ("failed", "the cell ends")


def test_override_keeps_the_feed_apart_from_the_hold() -> None:
    attendant = Attendant(SCENARIO, Tally(0.0))
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
        feed = attendant.override(command, value)
        states.append((feed.value, feed.held, feed.stopped))
    assert states == [
        (0.5, False, False),
        (0.5, True, False),
        (0.0, True, False),
        (0.0, False, False),
        (0.0, True, True),
        (0.0, True, True),
        (0.0, False, False),
    ]


def test_journal_says_all_that_is_accepted_and_one_refusal_a_second(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    journal = _Journal(lambda: now)
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
