"""A sink in a process of its own: neither its work nor its threads share an interpreter with the step loop."""

from __future__ import annotations

import contextlib
import os
import select
import signal
from collections import deque
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from multiprocessing.util import Finalize
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from deltaph.errors import DeltaphError, EnvironmentProblem
from deltaph.frame import Frame, Sink
from deltaph.telemetry.ring import CONTEXT, FrameRing

POLL = 5e-4
"""Between two looks of an idle process [s]. To wake it would cost the step loop a system call a frame."""

NICENESS = 5
"""Where processors are short, the step loop comes first."""

_PATIENCE = 2.0  # with a process that ends, or was interrupted in what it does [s]

S = TypeVar("S", bound=Sink)
T = TypeVar("T")


class SinkProcess(Generic[S]):
    """Hands frames to a sink in another process, over a ring of limited length. It is a sink itself.

    The process has its own life: Ctrl-C and the wish to terminate are for the one that has started it. Should that one be gone,
    the sink is closed.

    Args:
        name: of the process, for people.
        open_sink: opens the sink, over there; can be pickled. What it raises comes out of `await_open`.
        capacity: frames that may wait.
        poll: between two looks of the idle process [s].
    """

    def __init__(self, name: str, open_sink: Callable[[], S], capacity: int, poll: float = POLL) -> None:
        self._ring = FrameRing(capacity)
        self._taken, self._lost = (CONTEXT.RawValue("q") for _ in range(2))  # written over there
        self._death: EnvironmentProblem | None = None
        self._refused = self._put = 0
        self._line, theirs = CONTEXT.Pipe()
        arguments = open_sink, self._ring, self._taken, self._lost, theirs, poll
        self._process = CONTEXT.Process(target=_work, args=arguments, name=name, daemon=True)
        with _signals_for_this_process():
            self._process.start()
        theirs.close()
        self._closed = self._failed = self._interrupted = False
        Finalize(self, self._line.close, exitpriority=1)  # of one that was never closed, before Python waits for its end

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def dropped(self) -> int:
        """Frames that the sink did not get: there was no room, it had failed, or its process has died and it is known."""
        if self._death is not None:
            return self._refused + self._put - self.taken
        return self._refused + int(self._lost.value)

    @property
    def taken(self) -> int:
        """Frames that the sink has taken so far."""
        return int(self._taken.value)

    @property
    def failed(self) -> bool:
        """Something that was asked, or to close it, has raised."""
        return self._failed

    def death(self) -> EnvironmentProblem | None:
        """What is to be said of a process that has died; None while it lives, or was closed. To look is a system call."""
        if self._death is None and not self._closed and self._process.exitcode is not None:
            self._die()
        return self._death

    def await_open(self) -> None:
        """Wait until the sink is open.

        Raises:
            DeltaphError: what opening it has raised.
        """
        self.ask(bool)

    def take(self, frame: Frame) -> None:
        """Hand a frame over, or count it as dropped. Never waits."""
        if self._ring.put(frame):
            self._put += 1
        else:
            self._refused += 1

    def tell(self, what: Callable[[S], object]) -> None:
        """Have something done with the sink once it has taken all that was handed over. An error comes out of the next `ask`.

        Args:
            what: is called with the sink, over there; can be pickled.
        """
        with contextlib.suppress(OSError):  # a process that has died is one of those errors
            self._line.send((self._put, what, False))

    def ask(self, what: Callable[[S], T]) -> T:
        """Have something done with the sink, as `tell`, and wait for what comes of it.

        Raises:
            DeltaphError: what opening the sink, a frame, `tell` or this has raised.
            EnvironmentProblem: the process has died.
        """
        return self._answer_to(what)  # type: ignore[no-any-return]

    def close(self) -> None:
        """Close the sink once it has taken all that was handed over, and end the process. A second call does nothing.

        Raises:
            DeltaphError: as `ask`, unless that has raised it already.
        """
        if self._closed:
            return
        self._closed = True
        heard = self._failed
        try:
            if not self._interrupted:
                self._answer_to(None)
        except DeltaphError:
            if not heard:
                raise
        finally:
            self._line.close()
            self._process.join(_PATIENCE)
            if self._process.exitcode is None:
                self._process.kill()
                self._process.join()

    def _answer_to(self, what: Callable[[S], object] | None) -> Any:
        self._interrupted = True
        try:
            self._line.send((self._put, what, True))
            answer = self._line.recv()
        except (EOFError, OSError) as error:
            raise self._died() from error
        self._interrupted = False
        if isinstance(answer, DeltaphError):
            self._failed = True
            raise answer
        return answer

    def _died(self) -> EnvironmentProblem:
        self._failed = True
        self._process.join(_PATIENCE)
        return self._die()

    def _die(self) -> EnvironmentProblem:
        if self._death is None:
            code = self._process.exitcode
            self._death = EnvironmentProblem(f"the process of the {self._process.name} has died, exit code {code}")
        return self._death


@contextlib.contextmanager
def _signals_for_this_process() -> Iterator[None]:
    """What is started meanwhile hears none of the signals that ask a program to end, from its first moment on."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(open_sink: Callable[[], Sink], ring: FrameRing, taken: Any, lost: Any, line: Connection, poll: float) -> None:
    """What the process does."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    _Worker(open_sink, ring, taken, lost, line).work(poll)


class _Worker:
    """The other side of a `SinkProcess`; what is raised and no DeltaphError ends the process."""

    def __init__(self, open_sink: Callable[[], Sink], ring: FrameRing, taken: Any, lost: Any, line: Connection) -> None:
        self._ring = ring
        self._taken = taken
        self._lost = lost
        self._line = line
        self._told: deque[tuple[int, Callable[[Sink], object] | None, bool]] = deque()
        self._passed = 0  # frames out of the ring, taken or lost
        self._sink: Sink | None = None
        self._error: DeltaphError | None = None
        try:
            self._sink = open_sink()
        except DeltaphError as error:
            self._error = error

    def work(self, poll: float) -> None:
        """Take frames and do what is told, each in its place, until the line is closed."""
        while True:
            frames = self._ring.take()
            # what was said before a frame was put is on the line once the frame is here
            heard = self._listen(0.0 if frames else poll)
            for frame in frames:
                self._do_what_is_due()
                self._take(frame)
            self._do_what_is_due()
            if not heard and not frames:
                break
        self._close()

    def _listen(self, timeout: float) -> bool:
        """Hear all that is said; False where the line is closed."""
        while select.select([self._line], [], [], timeout)[0]:
            try:
                self._told.append(self._line.recv())
            except (EOFError, ConnectionResetError):
                return False
            timeout = 0.0
        return True

    def _take(self, frame: Frame) -> None:
        self._passed += 1
        if self._sink is not None and self._error is None:
            try:
                self._sink.take(frame)
            except DeltaphError as error:
                self._error = error
        if self._error is None:
            self._taken.value += 1
        else:
            self._lost.value += 1

    def _do_what_is_due(self) -> None:
        while self._told and self._told[0][0] <= self._passed:
            _, what, wants_answer = self._told.popleft()
            answer = self._close() if what is None else self._do(what, keep=not wants_answer)
            if wants_answer:
                with contextlib.suppress(OSError):  # who asked has gone: that is heard next
                    self._line.send(answer)

    def _do(self, what: Callable[[Sink], object], *, keep: bool) -> object:
        """What comes of it, an error included; one that nobody waits for is kept."""
        if self._sink is None or self._error is not None:
            return self._error
        try:
            return what(self._sink)
        except DeltaphError as error:
            if keep:
                self._error = error
            return error

    def _close(self) -> DeltaphError | None:
        sink, self._sink = self._sink, None
        if sink is not None:
            try:
                sink.close()
            except DeltaphError as error:
                self._error = self._error or error
        return self._error
