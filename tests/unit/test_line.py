"""A line, both ends in one process."""

import threading
import time
from typing import Any

import pytest

from deltaph.telemetry import Asking, LineClosedError, line

DEADLINE = 10.0


def in_a_thread(asking: Asking, question: object, found: list[Any]) -> threading.Thread:
    thread = threading.Thread(target=lambda: found.append(asking.ask(question, time.monotonic() + DEADLINE)))
    thread.start()
    return thread


def test_who_asks_waits_for_the_answer_and_who_answers_only_looks() -> None:
    asking, answering = line()
    assert answering.question() is None
    for number in range(3):
        found: list[Any] = []
        thread = in_a_thread(asking, number, found)
        while (question := answering.question()) is None:
            time.sleep(0.001)
        assert question == number
        assert answering.question() is None
        answering.answer(("to", number))
        thread.join(DEADLINE)
        assert found == [("to", number)]


def test_an_answer_that_comes_too_late_is_not_that_to_the_next_question() -> None:
    asking, answering = line()
    with pytest.raises(TimeoutError):
        asking.ask("first", time.monotonic())
    assert answering.question() == "first"
    answering.answer("late")
    found: list[Any] = []
    thread = in_a_thread(asking, "second", found)
    while (question := answering.question()) is None:
        time.sleep(0.001)
    answering.answer(f"to {question}")
    thread.join(DEADLINE)
    assert found == ["to second"]


def test_end_of_the_other_side_is_told() -> None:
    asking, answering = line()
    threading.Timer(0.05, answering.close).start()
    for _ in range(2):
        with pytest.raises(LineClosedError):
            asking.ask("anybody?", time.monotonic() + DEADLINE)


def test_an_asker_who_has_gone_does_not_hold_up_the_answer() -> None:
    asking, answering = line()
    with pytest.raises(TimeoutError):
        asking.ask("quick", time.monotonic())
    asking.close()
    assert answering.question() == "quick"
    answering.answer("nobody hears it")
