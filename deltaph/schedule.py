"""What a run does and when: operations one after the other, planned, asked for early, carried with the payload of their parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from deltaph.errors import InfeasibleError
from deltaph.feed import FeedClock, FloatArray
from deltaph.plan import Plan, time_grid
from deltaph.scenario import Limits, Move, Scenario


@dataclass(frozen=True, slots=True)
class Operation:
    """One pick-and-place operation of a run, with the rest of the gripper before it.

    Attributes:
        move: what is asked for.
        plan: what is planned.
        ready_ms: millisecond in which its plan is ready, which shows one later; -1: before the run.
        begin_ms: when it begins, with its rest [ms].
        start_ms: when the motion starts [ms].
        end_ms: when it arrives [ms].
        clock_ms: the planner's clock when the motion starts; it stands while nothing runs [ms].
        waited_ms: how long the robot stands before it begins, because its plan is not ready [ms].
        request_step: communication point at which it is asked for; the first one is asked for by the start values.
    """

    move: Move
    plan: Plan
    ready_ms: int
    begin_ms: float
    start_ms: float
    end_ms: float
    clock_ms: int
    waited_ms: float
    request_step: int


@dataclass(frozen=True, slots=True)
class Schedule:
    """What a run does: operations, each as soon as its forerunner has arrived and it is planned, then settling.

    Attributes:
        operations: in order.
        planned: of those, the ones up to where they repeat, without a feed override.
        steps: number of communication steps.
        communication_step_ms: [ms].
        feed: overrides in order, as (communication point, value).
        clock: the planner's.
        first_payload: what is in the gripper at the beginning [kg].
    """

    operations: tuple[Operation, ...]
    planned: tuple[Operation, ...]
    steps: int
    communication_step_ms: int
    feed: tuple[tuple[int, float], ...]
    clock: FeedClock
    first_payload: float

    @property
    def arrival_step(self) -> int:
        """The communication point at or after the last arrival."""
        return self.step_at(self.operations[-1].end_ms)

    @property
    def one_pass(self) -> tuple[Operation, ...]:
        """The operations up to where they repeat, as they run."""
        return self.operations[: self.pass_length]

    @property
    def pass_length(self) -> int:
        """Operations after which they repeat."""
        return len(self.planned)

    def step_at(self, ms: float) -> int:
        """The first communication point at or after a time; one that is on the grid but for rounding is on it."""
        return math.ceil(ms / self.communication_step_ms - 1e-6)

    @property
    def pass_ms(self) -> int:
        """What a pass takes as it is planned, rests included, and what the robot waits for plans [ms]."""
        return int(self.planned[-1].end_ms)

    @property
    def period(self) -> float:
        """By how much a pass moves the planner's clock on: what the robot waits is not in it [s]."""
        last = self.planned[-1]
        return (last.clock_ms + last.plan.duration_ms) / 1000.0

    @property
    def waited(self) -> float:
        """How long the robot waits for plans in the whole run [s]."""
        return sum(operation.waited_ms for operation in self.operations) / 1000.0

    @property
    def cycle_time(self) -> float:
        """What the first pass takes as it is planned, with all rests and waits [s].

        Later ones take as long where the communication step is 1 ms. A longer step may fall otherwise in them, and a plan that is
        waited for be asked for some milliseconds earlier or later.
        """
        return self.pass_ms / 1000.0

    def grid(self, step_ms: float = 1.0) -> FloatArray:
        """Times of a pass as it is planned, from 0 to the end [s], `step_ms` apart; the end is always one of them."""
        return time_grid(self.pass_ms, step_ms)

    @property
    def parts_per_minute(self) -> float:
        """Parts that a pass places, by the planned cycle time."""
        return 60.0 * sum(not operation.move.is_return for operation in self.one_pass) / self.cycle_time

    @property
    def payload_changes(self) -> list[tuple[float, float]]:
        """What the gripper really carries, as (from when [s], mass [kg]): a part comes and goes half-way through a rest."""
        changes = [(0.0, self.first_payload)]
        for operation in self.operations:
            if operation.move.payload != changes[-1][1]:
                changes.append((0.0005 * (operation.begin_ms + operation.start_ms), operation.move.payload))
        return changes

    def require_within(self, limits: Limits) -> None:
        """Refuse plans whose peaks go beyond the limits.

        Raises:
            InfeasibleError: names the first operation and the first of its peaks.
        """
        for operation in self.one_pass:
            try:
                operation.plan.require_within(limits)
            except InfeasibleError as error:
                raise _about(operation.move, error) from error


def schedule(scenario: Scenario, cycles: int | None = None) -> Schedule:
    """Plan a run: one way, or there and back `cycles` times; of a sequence `cycles` passes, one by default.

    Raises:
        InfeasibleError: a task cannot be planned; names the part of a sequence.
    """
    passes = scenario.moves
    if cycles is not None and not scenario.parts:
        passes = (*passes, passes[0].reversed())
    # parts before returns: what is wrong with a part is wrong with the returns from and to it, too
    plans = {move: _plan(scenario, move) for move in sorted(passes, key=lambda move: move.is_return)}
    step = scenario.communication_step_ms
    feed = tuple((math.ceil(1000.0 * change.time / step - 1e-6), change.override) for change in scenario.feed)
    given = FeedClock([(step * at, override) for at, override in feed])
    operations, clock = _one_after_the_other([(move, plans[move]) for move in passes * (cycles or 1)], step, given)
    planned = operations[: len(passes)]
    if feed:
        planned, _ = _one_after_the_other([(move, plans[move]) for move in passes], step, FeedClock())
    steps = math.ceil((operations[-1].end_ms + 1000.0 * scenario.settle) / step - 1e-6)
    return Schedule(operations, planned, steps, step, feed, clock, scenario.first_payload)


def _one_after_the_other(
    planned: Sequence[tuple[Move, Plan]], step: int, clock: FeedClock
) -> tuple[tuple[Operation, ...], FeedClock]:
    """When moves begin and end that are asked for as early as the planner takes them, as it is written in its README.

    Args:
        planned: moves with their plans.
        step: communication step [ms].
        clock: the planner's, were there no plan to wait for.

    Returns:
        the operations, and the planner's clock with the pauses.
    """
    operations: list[Operation] = []
    elapsed, request, ready, arrival = 0, 0, -1, 0.0
    for move, plan in planned:
        if operations:
            # One request may wait: the next one is asked for as soon as its forerunner has left that place.
            request = math.floor(operations[-1].begin_ms / step) + 1
            # A slice in each millisecond, the first in that of the request; the PPO begins in that of the last one.
            ready = request * step + plan.slices - 1
        begin, waited = arrival, 0.0
        if ready > arrival + 1e-6:  # less is rounding, which a feed override brings
            begin, waited = float(ready), ready - arrival
            clock = clock.paused(arrival, begin)
        # the clock stands at the arrival for a while, and where there is no rest the motion starts at the end of it
        start, end = (max(begin, clock.reaches(elapsed + ms)) for ms in (plan.dwell_ms, plan.dwell_ms + plan.duration_ms))
        operations.append(Operation(move, plan, ready, begin, start, end, elapsed + plan.dwell_ms, waited, request))
        elapsed += plan.dwell_ms + plan.duration_ms
        arrival = end
    return tuple(operations), clock


def _plan(scenario: Scenario, move: Move) -> Plan:
    try:
        return Plan(scenario.robot, move.task, scenario.law, move.declared_payload, scenario.limits)
    except InfeasibleError as error:
        raise _about(move, error) from error


def _about(move: Move, error: InfeasibleError) -> InfeasibleError:
    """The same refusal; of a sequence it is said which move it is about."""
    sentence = f"{move.name}: {error}" if move.part else str(error)
    return InfeasibleError(sentence, status=error.status, required=error.required, available=error.available)
