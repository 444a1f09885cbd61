"""The step loop's side of a cell that serves: sets the inputs that commands ask for, and tells what the planner makes of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltaph.frame import Command
from deltaph.scenario import Scenario, Task
from deltaph.slave import Slave
from deltaph.tally import Begun
from deltaph.telemetry import Answering
from deltaph.variables import variable_table

FEED_SETTLED = 1.0
"""Twice the time after which the planner's filter of the feed counts as settled, see feed.c [s]."""

TASK_INPUTS: tuple[str, ...] = tuple(
    v.name for v in variable_table("planner").of("input") if v.is_float and v.name.startswith(("task.", "payload."))
)
"""Planner inputs that a PPO sets before its trigger."""


class Override(NamedTuple):
    """The feed as people want it, and how often they have said stop."""

    value: float = 1.0
    held: bool = False
    stopped: bool = False
    stops: int = 0

    @property
    def input(self) -> float:
        """The planner's input."""
        return 0.0 if self.held else self.value

    def after(self, command: Command, value: float | None) -> Override:
        """What hold, stop, resume or feed makes of it."""
        match command:
            case "hold":
                return self._replace(held=True)
            case "stop":
                return self._replace(held=True, stopped=True, stops=self.stops + 1)
            case "resume":
                return self._replace(held=False, stopped=False)
            case _:
                return self._replace(value=float(value or 0.0))


class Overridden(NamedTuple):
    """The answer to a command of the feed.

    Attributes:
        override: as it is now.
        time: from when on [s].
        discarded: by a stop: requests that waited or were being planned, and never run; else None.
    """

    override: Override
    time: float
    discarded: int | None


class Standing(NamedTuple):
    """The answer to who is about to ask for a PPO.

    Attributes:
        rest: where the robot is when it has done all it was told (3,) [m].
        stops: how often the cell was stopped.
    """

    rest: tuple[float, float, float]
    stops: int


class Job(NamedTuple):
    """A PPO that is asked for.

    Attributes:
        task: what to do.
        inputs: of the planner, in the order of TASK_INPUTS (k,).
        dwell: [s].
        declared: what the plan is made for [kg].
        payload: what the gripper then really carries [kg].
        stops: how often the cell had been stopped when it was asked for: a later stop discards it.
    """

    task: Task
    inputs: NDArray[np.float64]
    dwell: float
    declared: float
    payload: float
    stops: int


class Verdict(NamedTuple):
    """What the planner made of a job.

    Attributes:
        time: of the communication point that shows it [s].
        outputs: the planner's `plan.*` there.
        waits: another plan runs before it.
        start_time: when it begins [s]; None where that depends.
    """

    time: float
    outputs: dict[str, float]
    waits: bool
    start_time: float | None


class Unasked(NamedTuple):
    """Why the planner was not asked for a job or to go on, or is not any more: `stopped`, `cancelled` by a stop, or `tripped`."""

    why: str
    time: float


class Attendant:
    """What a cell does that has no schedule; see `Operator`. It never waits.

    Args:
        scenario: where the robot rests first, and the communication step.
        overrides: questions (command, value), answered with `Overridden` or `Unasked`.
        tasks: a `Job` is answered with `Verdict` or `Unasked`; what is none asks for the `Standing`.
        begin: is told which plan begins when.
    """

    def __init__(self, scenario: Scenario, overrides: Answering, tasks: Answering, begin: Callable[[Begun], None]) -> None:
        self._overrides = overrides
        self._tasks = tasks
        self._tell_begun = begin
        self._step_ms = scenario.communication_step_ms
        self._size = scenario.communication_step_ms / 1000.0
        self._rest = scenario.task.pick
        self._override = Override()
        self._cancelling: tuple[float, int] | None = None  # when the planner was told of a stop, and plan.cancelled before it
        self._job: Job | None = None
        self._posted = False  # the job, to the planner
        self._trigger = 1
        self._before = (0, 0)
        self._place = scenario.task.pick  # where the plan that runs, or ran last, ends
        self._waiting: tuple[Job, Begun] | None = None
        self._arc = 0.0
        self._end: float | None = None
        self._nominal_from = -FEED_SETTLED  # since when the feed is 1
        self.ended = False

    def end(self) -> None:
        """End with the step that runs."""
        self.ended = True

    def attach(self, planner: Slave, plant: Slave) -> None:
        """Find the columns."""
        self._planner, self._plant = planner, plant
        inputs = [v.name for v in planner.table.of("input") if v.is_float]
        self._task_columns = np.array([inputs.index(name) for name in TASK_INPUTS])
        self._feed = inputs.index("feed")
        floats = [v.name for v in planner.table.of("output") if v.is_float]
        others = [v.name for v in planner.table.of("output") if not v.is_float]
        self._plan_floats = {name: column for column, name in enumerate(floats) if name.startswith("plan.")}
        self._arc_column = floats.index("path.arc_length")
        self._count, self._refused, self._cancelled, self._status, self._phase = (
            others.index(name) for name in ("plan.count", "plan.refused", "plan.cancelled", "plan.status", "path.phase")
        )
        self._trip = [v.name for v in plant.table.of("output") if not v.is_float].index("trip")

    def post(self, step: int) -> None:
        """See what the last step brought, and set the inputs of the next one."""
        if self._cancelling is not None:
            self._discard(*self._cancelling)
        elif (order := self._overrides.question()) is not None:
            command, value = order
            self._apply(command, value, step)
        if self._waiting is not None:
            self._watch(step)
        if self._job is None and (asked := self._tasks.question()) is not None:
            if isinstance(asked, Job):
                self._job = asked
            else:
                self._tasks.answer(Standing(self._rest, self._override.stops))
        if self._job is not None:
            self._attend(self._job, step)

    def _apply(self, command: Command, value: float | None, step: int) -> None:
        if command in ("resume", "feed") and self._plant.integers[self._trip]:
            self._overrides.answer(Unasked("tripped", step * self._size))
            return
        before, override = self._override, self._override.after(command, value)
        self._override = override
        self._planner.inputs[self._feed] = override.input
        self._planner.write()
        if override.input != before.input:
            self._end = None
            self._nominal_from = step * self._size if override.input == 1.0 else np.inf
        if override.stops != before.stops:
            self._planner.set({"task.cancel": override.stops})
            self._cancelling = step * self._size, int(self._planner.integers[self._cancelled])
        else:
            self._overrides.answer(Overridden(override, step * self._size, None))

    def _discard(self, since: float, before: int) -> None:
        """See what a stop has cancelled: what waited, else what was being planned. Of a hold, `_end` is unknown."""
        self._cancelling = None
        count = int(self._planner.integers[self._cancelled]) - before
        if count and self._waiting is not None:
            self._waiting = None
            self._rest = self._place
        elif count and self._job is not None:
            self._done(Unasked("cancelled", since))
        self._overrides.answer(Overridden(self._override, since, count))

    def _watch(self, step: int) -> None:
        """Whether the plan that waited has begun: the arc length never falls on a path."""
        before, self._arc = self._arc, float(self._planner.outputs[self._arc_column])
        if self._arc < before and self._waiting is not None:
            job, begun = self._waiting
            self._waiting = None
            self._begin(job, begun._replace(step=step))

    def _attend(self, job: Job, step: int) -> None:
        planner = self._planner
        decided = int(planner.integers[self._count]), int(planner.integers[self._refused])
        if self._posted and decided != self._before:
            self._done(self._decided(job, step))
            return
        self._before = decided
        self._moving = bool(planner.integers[self._phase])
        self._arc = float(planner.outputs[self._arc_column])
        if self._posted:
            return
        override = self._override
        late = job.stops < override.stops
        if override.stopped or late or self._plant.integers[self._trip]:
            self._done(Unasked("stopped" if override.stopped else "cancelled" if late else "tripped", step * self._size))
            return
        planner.inputs[self._task_columns] = job.inputs
        planner.write()
        self._trigger = 3 - self._trigger  # 1 and 2 by turns: any value but the last one asks
        planner.set({"task.trigger": self._trigger})
        self._posted = True

    def _done(self, answer: Verdict | Unasked) -> None:
        self._job, self._posted = None, False
        self._tasks.answer(answer)

    def _decided(self, job: Job, step: int) -> Verdict:
        planner = self._planner
        status, count = int(planner.integers[self._status]), int(planner.integers[self._count])
        outputs = {name: float(planner.outputs[column]) for name, column in self._plan_floats.items()}
        outputs |= {"plan.status": status, "plan.count": count}
        if count == self._before[0]:
            return Verdict(step * self._size, outputs, waits=False, start_time=None)
        self._rest = job.task.place
        waits = self._moving
        start = self._end if waits else (step - 1) * self._size
        nominal = (step - 1) * self._size - self._nominal_from >= FEED_SETTLED
        if not nominal or self._step_ms > 1:  # a longer step may be over before it begins
            start = None
        self._end = None if start is None else start + _whole_ms(job.dwell) + outputs["plan.duration"]
        planned = outputs["plan.corner_deviation_pick"], outputs["plan.corner_deviation_place"]
        begun = Begun(step, count, job.task, job.declared, planned)
        if waits:
            self._waiting = job, begun
            self._watch(step)
        else:
            self._begin(job, begun)
        return Verdict(step * self._size, outputs, waits, start)

    def _begin(self, job: Job, begun: Begun) -> None:
        """A plan runs, and its load is in the gripper: from this exchange on the torque that the planner gives counts on it."""
        self._place = job.task.place
        self._tell_begun(begun)
        self._plant.set({"payload.mass": job.payload})


def _whole_ms(dwell: float) -> float:
    """A dwell as the planner rounds it: up to whole milliseconds, with the kernel's tolerance [s]."""
    return float(np.ceil(1000.0 * dwell - 1e-6)) / 1000.0
