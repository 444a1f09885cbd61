"""Real time: absolute deadlines on the monotonic clock, an account of every one of them, and a process that leaves the loop alone.

What is missed: a communication point reached later than its deadline by more than `TOLERANCE` of a step. What follows: a drive must
never see setpoints closer together than it expects, so that nothing is caught up. Late by less than a step, the next deadline
stays where it is; late by one or more whole steps, all later deadlines move by those whole steps, which are counted as slipped:
simulated time then lags the clock by them for good, and the phase on the clock is kept, as a fieldbus skips cycles.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from deltaph.errors import EnvironmentProblem

TOLERANCE = 0.1
"""Of a step: the jitter a cell is allowed before a deadline counts as missed."""

CAUSES = ("planner", "plant", "publish", "exchange", "system")
"""Why a deadline is missed: the longest part of a step that took too long (`exchange`: all that is none of the other three), or
woken late by the system."""

HISTOGRAM_US = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 100_000)
"""Upper bounds of the lateness histogram's bins [us]; one more bin takes what is later."""

SPIN_NS = 60_000
"""The end of a wait, spent looking at the clock: a sleeper wakes some tens of microseconds late [ns]."""

PRIORITY = 50
"""Of a loop for which none was chosen, where the system permits one: above all that is not real time, below the system's own."""

_PR_SET_TIMERSLACK = 29  # linux/prctl.h
_MCL_CURRENT = 1
_SWITCH_INTERVAL = 5e-5  # a progress bar's thread gives the interpreter back within this [s]; Python's own 5 ms are five steps


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def _absolute_sleep() -> Callable[[int], None]:
    """Sleep until a time of the monotonic clock [ns]: absolute, so that who is preempted before the call wakes in time."""
    try:
        call = ctypes.CDLL(None).clock_nanosleep
    except (AttributeError, OSError, TypeError):  # not every system has it
        return lambda until: time.sleep(max(until - time.monotonic_ns(), 0) * 1e-9)
    until_time = _Timespec()
    arguments = (time.CLOCK_MONOTONIC, 1, ctypes.byref(until_time), None)  # 1 is TIMER_ABSTIME

    def sleep(until: int) -> None:
        until_time.seconds, until_time.nanoseconds = divmod(until, 1_000_000_000)
        call(*arguments)

    return sleep


@dataclass
class Account:
    """What became of the deadlines so far.

    Attributes:
        deadlines: all.
        missed: by cause, in the order of CAUSES.
        slipped: whole steps by which the deadlines have moved.
        histogram: number of deadlines by lateness, in the bins of HISTOGRAM_US.
    """

    deadlines: int = 0
    missed: list[int] = field(default_factory=lambda: [0] * len(CAUSES))
    slipped: int = 0
    histogram: list[int] = field(default_factory=lambda: [0] * (len(HISTOGRAM_US) + 1))


def histogram(lateness_us: Sequence[float]) -> list[int]:
    """Number of values in each bin of HISTOGRAM_US, upper bounds included."""
    counts = [0] * (len(HISTOGRAM_US) + 1)
    for value in lateness_us:
        counts[_bin(value)] += 1
    return counts


def _bin(lateness_us: float) -> int:
    for k, bound in enumerate(HISTOGRAM_US):
        if lateness_us <= bound:
            return k
    return len(HISTOGRAM_US)


class Pacer:
    """Keeps communication points on the clock.

    Attributes:
        account: of the deadlines so far.

    Args:
        step_ns: communication step [ns].
        clock: [ns].
        sleep_until: sleeps until a time of the clock.
    """

    def __init__(
        self,
        step_ns: int,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep_until: Callable[[int], None] | None = None,
    ) -> None:
        self.account = Account()
        self._step = step_ns
        self._tolerance = int(TOLERANCE * step_ns)
        self._clock = clock
        self._sleep_until = sleep_until or _absolute_sleep()
        self._deadline = self._reached = 0
        self._cause: int | None = None

    def begin(self) -> None:
        """The first communication point is now."""
        self._deadline = self._reached = self._clock()

    def wait(self, planner: float, plant: float, publish: float) -> float:
        """Wait for the next communication point.

        Args:
            planner: duration of the planner's step before it [s].
            plant: of the plant's [s].
            publish: of handing the last frame to the sinks [s].

        Returns:
            lateness [s].
        """
        clock, account = self._clock, self.account
        self._deadline = deadline = self._deadline + self._step
        done = now = clock()
        if now < deadline - SPIN_NS:
            self._sleep_until(deadline - SPIN_NS)
            now = clock()
        while now < deadline:
            now = clock()
        late = now - deadline
        account.deadlines += 1
        account.histogram[_bin(late / 1000)] += 1
        if late > self._tolerance:
            parts = planner, plant, publish
            cause = CAUSES.index("system") if done <= deadline else self._work(done - self._reached, parts)
            self._cause = cause
            account.missed[cause] += 1
            lost = late // self._step
            account.slipped += lost
            self._deadline += lost * self._step
        else:
            self._cause = None
        self._reached = now
        return late * 1e-9

    def _work(self, duration: int, parts: tuple[float, ...]) -> int:
        """The cause where the work ended after the deadline: work of less than a step began late, and inherits."""
        if duration <= self._step and self._cause is not None:
            return self._cause
        exchange = duration * 1e-9 - sum(parts)
        costs = (*parts, exchange)
        return costs.index(max(costs))


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """What is asked of the system for the loop.

    Attributes:
        priority: of SCHED_FIFO, 1 to 99; 0 leaves the scheduling as it is. Memory is then locked too, where that is permitted.
        cpu: the processor the loop's thread stays on; None leaves that to the system.
    """

    priority: int = 0
    cpu: int | None = None

    def __post_init__(self) -> None:
        if self.cpu is not None and hasattr(os, "sched_getaffinity") and self.cpu not in os.sched_getaffinity(0):
            available = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
            raise EnvironmentProblem(f"processor {self.cpu} is not ours: choose one of {available}")
        if (self.priority or self.cpu is not None) and not hasattr(os, "sched_setscheduler"):
            raise EnvironmentProblem("this system offers neither real-time priority nor processors to choose: leave both out")


@contextlib.contextmanager
def undisturbed(asked: Undisturbed) -> Iterator[None]:
    """Garbage collection off, sleeping exact, threads quick to yield, priority and processor as asked; undone at the end.

    Only the calling thread is changed; the sinks' processes keep what they have.

    Raises:
        EnvironmentProblem: the system refuses what was asked for.
    """
    with contextlib.ExitStack() as stack:
        if gc.isenabled():
            gc.collect()
            gc.freeze()
            gc.disable()
            stack.callback(gc.unfreeze)
            stack.callback(gc.enable)
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(_SWITCH_INTERVAL)
        if sys.platform == "linux":
            libc = ctypes.CDLL(None)
            libc.prctl(_PR_SET_TIMERSLACK, 1)  # Linux lets a sleeper wake 50 us late to save power
            stack.callback(libc.prctl, _PR_SET_TIMERSLACK, 0)  # 0 is the default again
            if asked.cpu is not None:
                stack.callback(os.sched_setaffinity, 0, os.sched_getaffinity(0))
                os.sched_setaffinity(0, {asked.cpu})
            if asked.priority:
                stack.enter_context(_first_in_first_out(asked.priority))
                if libc.mlockall(_MCL_CURRENT) == 0:
                    stack.callback(libc.munlockall)
        yield


def permitted_priority() -> int:
    """PRIORITY where the system permits it, else 0."""
    if sys.platform != "linux":
        return 0
    try:
        with _first_in_first_out(PRIORITY):
            return PRIORITY
    except EnvironmentProblem:
        return 0


@contextlib.contextmanager
def _first_in_first_out(priority: int) -> Iterator[None]:
    """Real-time scheduling of the calling thread; on Linux."""
    assert sys.platform == "linux"
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        # RESET_ON_FORK: no thread or process started meanwhile inherits the priority
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError as error:
        raise EnvironmentProblem(
            f"real-time priority {priority} is not permitted: raise the limit (`ulimit -r {priority}`) or leave it out"
        ) from error
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)
