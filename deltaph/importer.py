"""The importer: steps both FMUs on one grid, exchanging in parallel, and yields one frame per communication point.

At t_n it reads all outputs, sets all inputs, then steps every FMU to t_n+1. The plant extrapolates its reference inside the step,
so that this exchange shows no millisecond of lag as tracking error.
"""

from __future__ import annotations

import contextlib
import math
import tempfile
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from itertools import count, takewhile
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

import numpy as np

from deltaph.errors import DeltaphError
from deltaph.fmu.terminals import JOINTS, MEMBERS
from deltaph.frame import Frame, Frames, FrameStore
from deltaph.pacing import Account, Pacer, Undisturbed, undisturbed
from deltaph.scenario import Fault, Limits, Move, Scenario, Task
from deltaph.schedule import Schedule
from deltaph.slave import Slave
from deltaph.variables import Model, variable_table

CONNECTIONS: tuple[tuple[str, str], ...] = tuple(
    (f"joint[{i}].{output}", f"joint[{i}].{reference}") for output, reference in MEMBERS.items() for i in JOINTS
)
"""Planner output -> plant input."""


def task_inputs(task: Task) -> dict[str, float]:
    """The planner inputs that say a task."""
    points = {"pick": task.pick, "place": task.place}
    coordinates = {f"task.{name}.{axis}": value for name, point in points.items() for axis, value in zip("xyz", point, strict=True)}
    return coordinates | {
        "task.lift_pick": task.lift[0],
        "task.lift_place": task.lift[1],
        "task.corner_deviation_pick": task.corner_deviation[0],
        "task.corner_deviation_place": task.corner_deviation[1],
        "task.dwell": task.dwell,
    }


def move_inputs(move: Move) -> dict[str, float]:
    """The planner inputs that say a move, but for the trigger."""
    return task_inputs(move.task) | {"payload.mass": move.declared_payload}


NO_LIMIT = 1e30
"""How the planner FMU is told that there is no limit: FMI parameters are finite in every tool."""


def limit_values(limits: Limits) -> dict[str, float]:
    """The planner parameters that say the limits."""
    joints = {
        f"limit.joint[{i}].{quantity}": value
        for quantity in ("velocity", "acceleration", "jerk", "torque")
        for i, value in enumerate(getattr(limits, f"joint_{quantity}"), 1)
    }
    return {name: min(value, NO_LIMIT) for name, value in (joints | {"limit.tcp_speed": limits.tcp_speed}).items()}


def planner_values(scenario: Scenario) -> dict[str, float]:
    """Parameters and first inputs of the planner."""
    law = scenario.law
    return (
        scenario.robot.parameters
        | move_inputs(scenario.moves[0])
        | limit_values(scenario.limits)
        | {
            "law": variable_table("planner").items("Law").index(law.name),
            "speed.corner_entry": law.corner_entry_speed,
            "speed.corner_mid": law.corner_mid_speed,
            "speed.traverse": law.traverse_speed,
            "overlap": law.overlap,
        }
    )


def plant_values(scenario: Scenario) -> dict[str, float]:
    """Parameters and first inputs of the plant."""
    start = {f"start.{axis}": value for axis, value in zip("xyz", scenario.task.pick, strict=True)}
    return {**scenario.robot.parameters, **scenario.plant, **start, "payload.mass": scenario.first_payload}


class _Link:
    """The planner outputs that feed plant inputs, moved as one array."""

    def __init__(self, planner: Slave, plant: Slave) -> None:
        outputs = [v.name for v in planner.table.of("output") if v.is_float]
        inputs = [v.name for v in plant.table.of("input") if v.is_float]
        self._source, self._from = planner.outputs, np.array([outputs.index(name) for name, _ in CONNECTIONS])
        self._target, self._to = plant.inputs, np.array([inputs.index(name) for _, name in CONNECTIONS])

    def move(self) -> None:
        self._target[self._to] = self._source[self._from]


class _Requests:
    """Posts the moves after the first one and the feed when their time comes, and sees to it that each move begins in time."""

    def __init__(self, planner: Slave, run: Schedule) -> None:
        self._planner = planner
        self._pending: dict[int, dict[str, float]] = {step: {"feed": override} for step, override in run.feed}
        for number, op in enumerate(run.operations[1:], 2):
            inputs = self._pending.setdefault(op.request_step, {})
            inputs |= {**move_inputs(op.move), "task.trigger": number}
        # what the feed has slowed down may come a rounding error later, and so one point
        slack = 1 if run.feed else 0
        # an operation that begins in the millisecond in which it is ready shows at the communication point behind that
        shows = [op.ready_ms // run.communication_step_ms + 1 for op in run.operations]
        self._begins = [(max(run.step_at(op.begin_ms) + slack, at), op.move) for op, at in zip(run.operations, shows, strict=True)]
        self._begun = 0
        others = [v.name for v in planner.table.of("output") if not v.is_float]
        self._count, self._refused, self._status = (others.index(f"plan.{name}") for name in ("count", "refused", "status"))

    def post(self, step: int) -> None:
        self._check(step)
        values = self._pending.pop(step, None)
        if values is not None:
            self._planner.set(values)

    def _check(self, step: int) -> None:
        """Whether the operation that begins now is planned.

        Raises:
            DeltaphError: it is not: the run is not the one that was scheduled.
        """
        if self._begun == len(self._begins) or step < self._begins[self._begun][0]:
            return
        move, integers = self._begins[self._begun][1], self._planner.integers
        self._begun += 1
        if integers[self._count] < self._begun:
            status = variable_table("planner").items("PlanStatus")[integers[self._status]]
            why = f"refused it: {status}" if integers[self._refused] else "has not planned it in time"
            raise DeltaphError(f"operation {self._begun} ({move.name}) should begin at step {step}, but the planner FMU {why}")


def _events(scenario: Scenario, run: Schedule) -> list[Fault]:
    """What happens to the plant, in order of time: faults, and parts that come into the gripper and leave it."""
    parts = [Fault(time, {"payload.mass": mass}) for time, mass in run.payload_changes[1:]]
    return sorted((*parts, *scenario.faults), key=lambda event: event.time)


class _Faults:
    """Sets plant inputs when the time of a fault has come."""

    def __init__(self, plant: Slave, faults: Sequence[Fault], communication_step_ms: int) -> None:
        self._plant = plant
        step = communication_step_ms / 1000.0
        # a time on the grid is meant to be on it, whatever rounding says
        self._pending = deque((math.ceil(fault.time / step - 1e-9), fault.inputs) for fault in faults)

    def set(self, step: int) -> None:
        while self._pending and self._pending[0][0] <= step:
            self._plant.set(self._pending.popleft()[1])


def cosimulate(
    scenario: Scenario,
    run: Schedule,
    fmus: Mapping[Model, Path],
    *,
    realtime: Undisturbed | None = None,
    dropped: Callable[[], int] = lambda: 0,
    frames: Frames | None = None,
) -> Generator[Frame, None, None]:
    """Co-simulate a scenario; yields frame 0, the initial state, and one frame per step. To be closed where it is left early.

    Args:
        scenario: what to run.
        run: its schedule.
        fmus: the FMI 3.0 FMUs.
        realtime: keep the communication points on the monotonic clock, with this asked of the system; None runs as fast as it can.
        dropped: frames that the sinks did not get so far; goes into the timing.
        frames: where the frames are kept, room for the run's; None gives them a place of their own.

    Raises:
        DeltaphError: an FMU refuses its parameters, or the system what is asked of it.
    """
    size = run.communication_step_ms / 1000.0
    frames = Frames(run.steps + 1) if frames is None else frames
    with tempfile.TemporaryDirectory(prefix="deltaph-") as directory, contextlib.ExitStack() as stack:
        if realtime is not None:
            _warm_up(scenario, fmus, Path(directory) / "warm-up", size)
        planner, plant, link = _cell(scenario, fmus, Path(directory), stack)
        requests = _Requests(planner, run)
        faults = _Faults(plant, _events(scenario, run), run.communication_step_ms)
        pacer = None
        if realtime is not None:
            pacer = Pacer(run.communication_step_ms * 1_000_000)
            stack.enter_context(undisturbed(realtime))
        yield from _loop(planner, plant, link, requests, faults, range(run.steps + 1), size, frames, pacer, dropped)


class Operator(Protocol):
    """Who says what a cell does that has no schedule."""

    @property
    def ended(self) -> bool:
        """No further step is wanted."""
        ...

    def attach(self, planner: Slave, plant: Slave) -> None:
        """Both FMUs are there, in their initial state."""
        ...

    def post(self, step: int) -> None:
        """Outputs are those of this communication point, and inputs may be set. In the step loop: must not block."""
        ...


def attend(
    scenario: Scenario,
    fmus: Mapping[Model, Path],
    operator: Operator,
    *,
    realtime: Undisturbed,
    dropped: Callable[[], int],
    frames: FrameStore,
) -> Generator[Frame, None, None]:
    """Co-simulate in real time, without a schedule: the robot rests at the scenario's pick point until it is told to move.

    To be closed where it is left early.

    Args:
        scenario: robot, law, drives, faults, and where the robot rests.
        fmus: the FMI 3.0 FMUs.
        operator: says what to do.
        realtime: what is asked of the system.
        dropped: frames that the sinks did not get so far; goes into the timing.
        frames: where the frames are kept.

    Raises:
        DeltaphError: an FMU refuses its parameters, or the system what is asked of it.
    """
    size = scenario.communication_step_ms / 1000.0
    with tempfile.TemporaryDirectory(prefix="deltaph-") as directory, contextlib.ExitStack() as stack:
        _warm_up(scenario, fmus, Path(directory) / "warm-up", size)
        planner, plant, link = _cell(scenario, fmus, Path(directory), stack, {"task.trigger": 0})
        operator.attach(planner, plant)
        faults = _Faults(plant, scenario.faults, scenario.communication_step_ms)
        pacer = Pacer(scenario.communication_step_ms * 1_000_000)
        stack.enter_context(undisturbed(realtime))
        points = takewhile(lambda _: not operator.ended, count())
        yield from _loop(planner, plant, link, operator, faults, points, size, frames, pacer, dropped)


def _cell(
    scenario: Scenario,
    fmus: Mapping[Model, Path],
    directory: Path,
    stack: contextlib.ExitStack,
    start: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Slave, Slave, _Link]:
    """Both FMUs in their initial state, the planner with start values of its own, and what links them."""
    planner = stack.enter_context(Slave("planner", fmus["planner"], directory))
    plant = stack.enter_context(Slave("plant", fmus["plant"], directory))
    planner.set({**planner_values(scenario), **start})
    plant.set(plant_values(scenario))
    link = _Link(planner, plant)
    planner.initialize(0.0)
    planner.start()
    planner.read()
    plant.initialize(0.0)
    link.move()
    plant.write()
    plant.start()
    plant.read()
    return planner, plant, link


WARM_UP_STEPS = 50
"""Enough for every page of code and data that a step touches; other instances take them: the run's state is untouched."""

WARM_UP_NS = 1_000_000
"""Between two of them, however long the run's steps are: at 1 s the run would begin a minute late [ns]."""


def _warm_up(scenario: Scenario, fmus: Mapping[Model, Path], directory: Path, size: float) -> None:
    with contextlib.ExitStack() as stack:
        planner, plant, link = _cell(scenario, fmus, directory, stack)
        pacer = Pacer(WARM_UP_NS)
        pacer.begin()
        for n in range(WARM_UP_STEPS):
            link.move()
            plant.write()
            planner.step(n * size, size)
            plant.step(n * size, size)
            planner.read()
            plant.read()
            pacer.wait(0.0, 0.0, 0.0)


def _loop(
    planner: Slave,
    plant: Slave,
    link: _Link,
    requests: _Requests | Operator,
    faults: _Faults,
    points: Iterable[int],
    size: float,
    frames: FrameStore,
    pacer: Pacer | None,
    dropped: Callable[[], int],
) -> Iterator[Frame]:
    """The step loop."""
    clock, publish = time.perf_counter, 0.0
    planner_step = plant_step = lateness = 0.0
    account = Account() if pacer is None else pacer.account
    begin = clock()
    if pacer is not None:
        pacer.begin()
    for n in points:
        if n > 0:
            t = (n - 1) * size
            requests.post(n - 1)
            faults.set(n - 1)
            link.move()
            plant.write()
            t0 = clock()
            planner.step(t, size)
            t1 = clock()
            plant.step(t, size)
            t2 = clock()
            planner_step, plant_step = t1 - t0, t2 - t1
            planner.read()
            plant.read()
            if pacer is not None:
                lateness = pacer.wait(planner_step, plant_step, publish)
        elapsed = clock() - begin
        missed = account.missed
        factor = n * size / elapsed
        timing = planner_step, plant_step, publish, lateness, sum(missed), factor, *missed, account.slipped, dropped()
        outputs = (planner.outputs, planner.integers), (plant.outputs, plant.integers)
        frame = frames.append(n * size, time.time_ns(), *outputs, timing)
        t3 = clock()
        yield frame
        publish = clock() - t3
