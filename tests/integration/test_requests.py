"""A new target at any time: every accepted request runs, exactly when it should, and what the planner emits is what its plans say.

What should be emitted comes from the rule alone: a request takes one slice of planning in each millisecond, beginning with its
own; its PPO starts once the one before has arrived and it is planned; a request is refused while the one before has not begun.
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
    """A target.

    Attributes:
        gap_ms: after the request before; rounded up to the communication step.
        place: number of the place; the same one again is refused.
        dwell_ms: rest before the motion.
    """

    gap_ms: int
    place: int
    dwell_ms: int


@dataclass(frozen=True, slots=True)
class Accepted:
    """A plan on the run's clock; `start_ms`: of its dwell."""

    plan: Any
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
    """What should happen: the plans that run, and the requests that are refused."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        _, plan, _ = planned(scenario, scenario.task, 0)
        self.plans = [Accepted(plan, -1, 0)]  # that of the start values
        self.place = 1
        self.refused_at: list[int] = []

    def ask(self, at_ms: int, request: Request) -> dict[str, float]:
        """A request at a communication point; returns the inputs that say it."""
        task, last = task_to(self.place, request.place), self.plans[-1]
        inputs = {**task_inputs(task), "task.dwell": request.dwell_ms / 1000.0}
        if last.start_ms > at_ms or last.ready_ms >= at_ms:
            self.refused_at.append(at_ms)
            return inputs
        status, plan, slices = planned(self._scenario, task, request.dwell_ms)
        ready = at_ms + max(slices, 1) - 1
        if status == "ok":
            self.plans.append(Accepted(plan, ready, max(last.end_ms, ready)))
            self.place = request.place
        else:
            self.refused_at.append(ready)
        return inputs

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
            for name, value in expected.ask(ms, pending.pop(0)).items():
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
    ready = [p.ready_ms for p in expected.plans]
    assert found[:, OUTPUTS.index("plan.count")].tolist() == [sum(r < t for r in ready) for t in times]
    assert found[:, OUTPUTS.index("plan.refused")].tolist() == [sum(r < t for r in expected.refused_at) for t in times]
    assert found[-1, OUTPUTS.index("plan.busy")] == 0

    # Continuous, joins included: no joint moves further in a step than its speed lets it.
    for i in (1, 2, 3):
        position, velocity = (found[:, OUTPUTS.index(f"joint[{i}].{what}")] for what in ("position", "velocity"))
        moved, slope = np.abs(np.diff(position)), np.maximum(np.abs(velocity[1:]), np.abs(velocity[:-1]))
        assert (moved <= 1e-3 * step_ms * (slope + 0.3 * step_ms)).all()
    return expected


@pytest.fixture(scope="module")
def slave(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[FmiSlave]:
    one = FmiSlave(dist, "planner", 3, tmp_path_factory.mktemp("requests"))
    yield one
    one.free()


PAPER, LIMITED, OPTIMAL = (load_scenario(SCENARIOS / f"{name}.toml") for name in ("paper", "paper_limited", "time_optimal"))
REQUESTS = st.lists(
    st.builds(Request, gap_ms=st.integers(0, 500), place=st.integers(0, 3), dwell_ms=st.sampled_from([0, 1, 30])), max_size=8
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
