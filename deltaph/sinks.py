"""The sinks of a cell: what one of them fails at is said, and costs nothing of what the others can still do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self, TypeVar

from rich.console import Console

from deltaph.errors import DeltaphError
from deltaph.frame import Frame, Sink
from deltaph.telemetry import SinkProcess

LOOK_PERIOD_MS = 1000
"""Simulation time between two looks whether the processes live, which are system calls [ms]."""

S = TypeVar("S", bound=Sink)
T = TypeVar("T")


class Sinks:
    """All sinks of a cell. At the end they are closed, the one that was added first last.

    Where that end is an error, what the sinks failed at is said before it.

    Attributes:
        errors: what they failed at, each once, in order; who ends the cell raises the first and says the others.

    Args:
        log: for what is said at once: that a process has died.
        communication_step_ms: between two frames [ms].
        missed: is called once with a sink whose process has died; says what comes of that.
    """

    def __init__(self, log: Console, communication_step_ms: int, missed: Callable[[SinkProcess[Any]], str]) -> None:
        self._errors: dict[str, DeltaphError] = {}  # by what they say: a sink that has failed says it whenever it is asked
        self._log = log
        self._period = self._until_look = max(1, LOOK_PERIOD_MS // communication_step_ms)  # [frames]
        self._missed = missed
        self._sinks: list[SinkProcess[Any]] = []
        self._living: list[SinkProcess[Any]] = []
        self._stack = ExitStack()
        self._stack.push(self._say)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stack.__exit__(kind, error, trace)

    @property
    def errors(self) -> tuple[DeltaphError, ...]:
        """What the sinks failed at."""
        return tuple(self._errors.values())

    @property
    def dropped(self) -> int:
        """Frames that a sink did not get, of all sinks."""
        return sum(sink.dropped for sink in self._sinks)

    def add(self, sink: SinkProcess[S], close: Callable[[], None] | None = None) -> SinkProcess[S]:
        """Have a sink; `close` is how it is closed, where that is not all."""
        self._sinks.append(sink)
        self._living.append(sink)
        self._stack.callback(self.attempt, close or sink.close)
        return sink

    def await_open(self) -> None:
        """Wait until all are open, and their processes take no time away from the step loop.

        Raises:
            DeltaphError: one cannot be opened.
        """
        with self._log.status("opening the outputs"):
            for sink in self._sinks:
                sink.await_open()

    def take(self, frame: Frame) -> None:
        """Hand a frame to all; once a second also see whether they live."""
        for sink in self._sinks:
            sink.take(frame)
        self._until_look -= 1
        if not self._until_look:
            self._look()

    def attempt(self, what: Callable[[], T]) -> T | None:
        """Do what a sink may fail at; None where it does, which is kept."""
        try:
            return what()
        except DeltaphError as error:
            self._errors.setdefault(str(error), error)
            return None

    def _look(self) -> None:
        self._until_look = self._period
        for sink in tuple(self._living):
            death = sink.death()
            if death is not None:
                self._living.remove(sink)
                self._errors.setdefault(str(death), death)
                self._log.print(f"{death}: {self._missed(sink)}", markup=False, soft_wrap=True)

    def _say(self, _kind: type[BaseException] | None, error: BaseException | None, _trace: TracebackType | None) -> None:
        if error is not None:
            say(self.errors, self._log)


def say(errors: Sequence[DeltaphError], log: Console) -> None:
    """A line for each."""
    for error in errors:
        log.print(f"deltaph: error: {error}", markup=False, highlight=False, soft_wrap=True)
