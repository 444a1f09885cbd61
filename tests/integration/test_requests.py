"""A new target at any time: every accepted request runs, exactly when it should, and what the planner emits is what its plans say.

What should be emitted comes from the rule alone: a request takes one slice of planning in each millisecond, beginning with its
own; its PPO starts once the one before has arrived and it is planned; a request is refused while the one before has not begun.
A cancel discards the one that has not begun, before the request of the same point is looked at; the robot rests where the one
before ends.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from integration.fmi_slave import OK, FmiSlave

from deltaph.fmu import FMI_VERSIONS
from deltaph.importer import planner_values, task_inputs
from deltaph.kernel import ffi, lib
from deltaph.plan import SETPOINT, Plan
from deltaph.scenario import Scenario, Task, load_scenario
from deltaph.variables import variable_table

SCENARIOS = Path(__file__).parents[2] / "scenarios"
TABLE = variable_table("planner")
OUTPUTS = [v.name for v in TABLE.of("output")]
SAMPLED = [v for v in TABLE.of("output") if not v.name.startswith("plan.")]
PLACES = [(-0.1525, 0.0, -0.8), (0.1525, 0.0, -0.8), (0.05, 0.12, -0.8), (-0.03, -0.1, -0.79)]
"""Where the robot is sent, all of them 50 or 40 mm below one plane."""


@dataclass(frozen=True, slots=True)
class Request:
    """A target, or nothing but a cancel.

    Attributes:
        gap_ms: after the request before; rounded up to the communication step.
        place: number of the place; the same one again is refused; None asks for nothing.
        dwell_ms: rest before the motion.
        cancels: cancels at the same communication point.
    """

    gap_ms: int
    place: int | None
    dwell_ms: int = 0
    cancels: bool = False


@dataclass(frozen=True, slots=True)
class Accepted:
    """A plan on the run's clock; `start_ms`: of its dwell."""

    plan: Any
    place: int
    ready_ms: int
    start_ms: int

    @property
    def end_ms(self) -> int:
        return self.start_ms + int(self.plan.dwell_ms) + int(self.plan.duration_ms)


def task_to(pick: int, place: int) -> Task:
    """From place to place, in the common plane."""
    lifts = [-0.75 - PLACES[n][2] for n in (pick, place)]
    return Task(PLACES[pick], PLACES[place], (lifts[0], lifts[1]), (0.006, 0.006))


def planned(scenario: Scenario, task: Task, dwell_ms: int) -> tuple[str, Any, int]:
    """Status, plan and number of slices."""
    request = ffi.new("dph_task *", Plan.of(scenario)._struct.task)
    for field in ("pick", "place", "lift", "corner_deviation"):
        setattr(request, field, getattr(task, field))
    request.corner_entry_speed, request.corner_mid_speed = scenario.law.corner_entry_speed, scenario.law.corner_mid_speed
    request.traverse_speed, request.dwell = scenario.law.traverse_speed, dwell_ms / 1000.0
    memory, plan = ffi.new("double[]", -(-lib.dph_workspace_size() // 8)), ffi.new("dph_plan *")
    workspace = ffi.cast("dph_workspace *", memory)
    verdict = lib.dph_plan_begin(scenario.robot.struct, request, workspace, plan)
    slices = 0
    while verdict.status == lib.DPH_STATUS_PLANNING:
        verdict = lib.dph_plan_continue(workspace, plan, lib.DPH_SLICE)
        slices += 1
    return TABLE.items("PlanStatus")[verdict.status], plan, slices


class Expected:
    """What should happen.

    Attributes:
        plans: those that run.
        accepted_at: milliseconds in which a plan was accepted, run or not.
        refused_at: milliseconds in which a request was refused.
        cancelled_at: milliseconds in which one was discarded.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        _, plan, _ = planned(scenario, scenario.task, 0)
        self.plans = [Accepted(plan, 1, -1, 0)]  # that of the start values
        self.accepted_at, self.refused_at, self.cancelled_at = [-1], list[int](), list[int]()
        self._said = [(-1, 1, "ok")]  # millisecond; 0 at its beginning, 1 at its end; plan.status

    def ask(self, at_ms: int, place: int, dwell_ms: int) -> dict[str, float]:
        """A request at a communication point; returns the inputs that say it."""
        last = self.plans[-1]
        task = task_to(last.place, place)
        inputs = {**task_inputs(task), "task.dwell": dwell_ms / 1000.0}
        if self._is_planned(at_ms) or self._waits(at_ms):
            self.refused_at.append(at_ms)
            self._said.append((at_ms, 0, "busy"))
            return inputs
        status, plan, slices = planned(self._scenario, task, dwell_ms)
        ready = at_ms + max(slices, 1) - 1
        self._said += [(at_ms, 0, "planning"), (ready, 1, status)]
        if status == "ok":
            self.plans.append(Accepted(plan, place, ready, max(last.end_ms, ready)))
            self.accepted_at.append(ready)
        else:
            self.refused_at.append(ready)
        return inputs

    def cancel(self, at_ms: int) -> None:
        """A cancel at a communication point."""
        if not (self._is_planned(at_ms) or self._waits(at_ms)):
            return
        if self._waits(at_ms):
            self.plans.pop()
        for verdicts in (self.accepted_at, self.refused_at):
            verdicts[:] = [ready for ready in verdicts if ready < at_ms]
        self.cancelled_at.append(at_ms)
        self._said = [said for said in self._said if said[0] < at_ms] + [(at_ms, 0, "cancelled")]

    def _is_planned(self, at_ms: int) -> bool:
        """Whether a verdict is still to come."""
        return max(ready for ready, moment, _ in self._said if moment == 1) >= at_ms

    def _waits(self, at_ms: int) -> bool:
        """Whether the last plan has not begun."""
        last = self.plans[-1]
        return last.start_ms > at_ms or last.ready_ms >= at_ms

    def status_at(self, ms: int) -> str:
        """What plan.status shows at a communication point."""
        return max((said for said in enumerate(self._said) if said[1][0] < ms), key=lambda said: (*said[1][:2], said[0]))[1][2]

    def at(self, ms: int) -> np.ndarray:
        """The sampled outputs at a time; a plan that is ready only then shows in the step behind it."""
        now = [accepted for accepted in self.plans if accepted.start_ms <= ms and accepted.ready_ms < ms][-1]
        setpoint = np.empty(1, dtype=SETPOINT)
        time = (ms - now.start_ms - now.plan.dwell_ms) / 1000.0
        lib.dph_plan_sample(now.plan, time, ffi.cast("dph_setpoint *", ffi.from_buffer(setpoint)))
        values = [setpoint[0][v.group.removeprefix("path_")] for v in SAMPLED]
        return np.array([x if v.index is None else x[v.index] for v, x in zip(SAMPLED, values, strict=True)], dtype=np.float64)


def check(slave: FmiSlave, scenario: Scenario, step_ms: int, requests: list[Request]) -> Expected:
    """Run the requests through the FMU and hold every output of every communication point against what is expected."""
    assert slave.call("Reset") == OK
    for name, value in planner_values(scenario).items():
        assert slave.put({name: value if TABLE[name].is_float else int(value)}) == OK, slave.messages
    slave.initialize()
    expected, asked, ms, pending = Expected(scenario), 1, 0, list(requests)
    due = pending[0].gap_ms if pending else 0
    rows = [slave.outputs()]
    while pending or ms < expected.plans[-1].end_ms + 2 * step_ms:
        if pending and ms >= due:
            asked += 1
            request = pending.pop(0)
            if request.cancels:
                expected.cancel(ms)
                assert slave.put({"task.cancel": asked}) == OK
            if request.place is not None:
                for name, value in expected.ask(ms, request.place, request.dwell_ms).items():
                    assert slave.put({name: value}) == OK, slave.messages
                assert slave.put({"task.trigger": asked}) == OK
            due = ms + step_ms + pending[0].gap_ms if pending else 0
        assert slave.step(ms / 1000.0, step_ms / 1000.0) == OK, slave.messages
        ms += step_ms
        rows.append(slave.outputs())

    found = np.array(rows, dtype=np.float64)
    times = np.arange(len(rows)) * step_ms
    sampled = found[:, [OUTPUTS.index(v.name) for v in SAMPLED]]
    assert (sampled == np.array([expected.at(t) for t in times])).all()
    # A verdict falls in a millisecond, and shows from the communication point behind it on.
    decided = {"count": expected.accepted_at, "refused": expected.refused_at, "cancelled": expected.cancelled_at}
    for output, at in decided.items():
        assert found[:, OUTPUTS.index(f"plan.{output}")].tolist() == [sum(ms < t for ms in at) for t in times]
    said = found[:, OUTPUTS.index("plan.status")].astype(int)
    statuses = TABLE.items("PlanStatus")
    assert [statuses[number] for number in said] == [expected.status_at(t) for t in times]
    assert found[-1, OUTPUTS.index("plan.busy")] == 0

    # Continuous, joins included: no joint moves further in a step than its speed lets it.
    for i in (1, 2, 3):
        position, velocity = (found[:, OUTPUTS.index(f"joint[{i}].{what}")] for what in ("position", "velocity"))
        moved, slope = np.abs(np.diff(position)), np.maximum(np.abs(velocity[1:]), np.abs(velocity[:-1]))
        assert (moved <= 1e-3 * step_ms * (slope + 0.3 * step_ms)).all()
    return expected


@pytest.fixture(scope="module", params=FMI_VERSIONS)
def slave(dist: Path, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[FmiSlave]:
    one = FmiSlave(dist, "planner", request.param, tmp_path_factory.mktemp("requests"))
    yield one
    one.free()


PAPER, LIMITED, OPTIMAL = (load_scenario(SCENARIOS / f"{name}.toml") for name in ("paper", "paper_limited", "time_optimal"))
REQUESTS = st.lists(
    st.builds(
        Request,
        gap_ms=st.integers(0, 500) | st.integers(0, 20),
        place=st.none() | st.integers(0, 3),
        dwell_ms=st.sampled_from([0, 1, 30]),
        cancels=st.booleans(),
    ),
    max_size=8,
)


@pytest.mark.parametrize("scenario", [PAPER, LIMITED, OPTIMAL], ids=["paper", "paper_limited", "time_optimal"])
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(step_ms=st.sampled_from([1, 2, 5]), requests=REQUESTS)
def test_requests_at_random_times(slave: FmiSlave, scenario: Scenario, step_ms: int, requests: list[Request]) -> None:
    check(slave, scenario, step_ms, requests)


@pytest.mark.parametrize("scenario", [PAPER, OPTIMAL], ids=["paper", "time_optimal"])
def test_a_request_at_each_step_of_a_run(slave: FmiSlave, scenario: Scenario) -> None:
    duration = Plan.of(scenario).duration_ms
    for ms in sorted({*range(0, duration, 23), *range(duration - 12, duration + 3)}):
        expected = check(slave, scenario, 1, [Request(ms, 0, 20)])
        assert len(expected.plans) == 2
        assert expected.plans[1].start_ms >= duration


def test_two_in_succession_one_waits_and_one_is_refused(slave: FmiSlave) -> None:
    expected = check(slave, PAPER, 1, [Request(10, 2, 0), Request(0, 3, 0), Request(292, 3, 0), Request(0, 1, 0)])
    assert [p.start_ms for p in expected.plans[:2]] == [0, 303]
    assert len(expected.plans) == 3
    assert len(expected.refused_at) == 2


def test_ten_targets_are_reached_back_to_back(slave: FmiSlave) -> None:
    """Asked for again and again until each is taken: the robot does not stop longer than its dwell."""
    expected = check(slave, OPTIMAL, 1, [Request(20, n % 4, 25) for n in range(120)])
    plans = expected.plans
    assert len(plans) > 10
    assert all(later.start_ms == former.end_ms for former, later in itertools.pairwise(plans))


@pytest.mark.parametrize("scenario", [PAPER, OPTIMAL], ids=["paper", "time_optimal"])
def test_a_cancel_at_each_step_of_a_run(slave: FmiSlave, scenario: Scenario) -> None:
    """Of a second request, while it is planned, waits, has just begun, runs and has arrived."""
    duration = Plan.of(scenario).duration_ms
    for ms in sorted({*range(0, 2 * duration, 41), *range(12), *range(duration - 12, duration + 3)}):
        expected = check(slave, scenario, 1, [Request(10, 0, 5), Request(ms, None, cancels=True), Request(20, 2)])
        discarded = 10 + 1 + ms < duration
        assert expected.cancelled_at == [10 + 1 + ms] * discarded
        assert [p.place for p in expected.plans][1:] == ([2] if discarded else [0, 2] if ms + 11 + 21 >= duration else [0])


def test_a_cancel_and_a_request_exchange_what_waits(slave: FmiSlave) -> None:
    expected = check(slave, PAPER, 1, [Request(10, 0), Request(5, 2, cancels=True), Request(5, 3, cancels=True)])
    assert [p.place for p in expected.plans] == [1, 3]
    assert (len(expected.accepted_at), len(expected.cancelled_at), expected.refused_at) == (4, 2, [])


def test_only_a_new_value_that_is_not_0_cancels(slave: FmiSlave) -> None:
    """And the start value, whatever it is, does not."""
    assert slave.call("Reset") == OK
    assert slave.put({"task.cancel": 7}) == OK
    slave.initialize()
    cancelled = []
    for n, value in enumerate((7, 0, 0, 7, 7, 8, -1)):
        assert slave.put({**task_inputs(task_to(1, 0))}) == OK
        assert slave.put({"task.trigger": n + 2, "task.cancel": value}) == OK
        assert slave.step(n / 1000.0) == OK
        cancelled.append(int(slave.get("plan.cancelled")[0]))
    assert cancelled == [0, 0, 0, 1, 1, 2, 3]
    assert slave.get("plan.count", "plan.refused") == [5, 3]


def test_under_a_hold_the_running_one_ends_where_it_should(slave: FmiSlave) -> None:
    """Feed stops the robot, the cancel discards what waits; with the feed back it arrives, and the next one begins there."""
    assert slave.call("Reset") == OK
    slave.initialize()
    inputs: dict[int, dict[str, float]] = {
        20: {**task_inputs(task_to(1, 0))},
        100: {"feed": 0.0},
        600: {"feed": 1.0},
        1400: {**task_inputs(task_to(1, 2))},
    }
    integers = {20: {"task.trigger": 2}, 100: {"task.cancel": 1}, 1400: {"task.trigger": 3}}
    busy = []
    for ms in range(2000):
        for values in (inputs, integers):
            assert ms not in values or slave.put(values[ms]) == OK, slave.messages
        assert slave.step(ms / 1000.0) == OK
        busy.append(bool(slave.get("plan.busy")[0]))
        if ms == 1399:
            assert slave.get(*(f"tcp.position.{axis}" for axis in "xyz")) == list(PLACES[1])
    assert busy[550] and not busy[1399] and busy[1400] and not busy[-1]
    assert slave.get(*(f"tcp.position.{axis}" for axis in "xyz")) == list(PLACES[2])
    assert slave.get("plan.count", "plan.cancelled", "plan.refused") == [3, 1, 0]
