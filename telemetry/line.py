"""Questions to a process that must never wait: its step loop looks whether there is one, and answers when it can."""

from __future__ import annotations

import contextlib
import time
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Semaphore
from typing import Any

from deltaph.telemetry.ring import CONTEXT


class LineClosedError(Exception):
    """The other end is closed: no answer will come."""


class Asking:
    """The end that asks; it is handed over to the process that does when that one is started."""

    def __init__(self, connection: Connection, waiting: Semaphore) -> None:
        self._connection = connection
        self._waiting = waiting
        self._asked = 0

    def ask(self, question: object, deadline: float) -> Any:
        """Ask, and wait for the answer. One question at a time.

        Args:
            question: whatever can be pickled, but None.
            deadline: on the monotonic clock [s].

        Raises:
            LineClosedError: the other end is closed.
            TimeoutError: no answer came in time; should it come later, it is discarded.
        """
        self._asked += 1
        try:
            self._connection.send((self._asked, question))
            self._waiting.release()
            while self._connection.poll(max(deadline - time.monotonic(), 0.0)):
                number, answer = self._connection.recv()
                if number == self._asked:
                    return answer
        except (EOFError, OSError) as error:
            raise LineClosedError from error
        raise TimeoutError

    def close(self) -> None:
        """Of this process."""
        self._connection.close()


class Answering:
    """The end that answers. To look costs less than a microsecond: the semaphore says without a system call whether one waits."""

    def __init__(self, connection: Connection, waiting: Semaphore) -> None:
        self._connection = connection
        self._waiting = waiting
        self._number = 0

    def question(self) -> Any:
        """The next question, or None. To be answered before the next one is looked for."""
        if not self._waiting.acquire(block=False):
            return None
        self._number, question = self._connection.recv()
        return question

    def answer(self, answer: object) -> None:
        """Answer the question."""
        with contextlib.suppress(OSError):  # who asked has gone: the sink's process is missed elsewhere
            self._connection.send((self._number, answer))

    def close(self) -> None:
        """Answer no more; who waits is told."""
        self._connection.close()


def line() -> tuple[Asking, Answering]:
    """Both ends of a line."""
    ours, theirs = CONTEXT.Pipe()
    waiting = CONTEXT.Semaphore(0)
    return Asking(theirs, waiting), Answering(ours, waiting)
