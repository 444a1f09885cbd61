"""The laws within limits on the paper's case: durations against independent optima, refusals, defaults."""

import math
from dataclasses import replace

import numpy as np
import pytest
from property.finite_differences import joint_angles, ratios
from property.random_tasks import PAPERS_PEAKS, TIME_OPTIMAL, limits_of
from reference.time_optimal import shortest_duration

from deltaph.errors import InfeasibleError
from deltaph.importer import NO_LIMIT, limit_values
from deltaph.kernel import lib
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import Law, Limits, Task
from deltaph.variables import variable_table

ROBOT = Robot.default()
PAPER = Law("paper", 1.2, 0.8, 2.4, 0.5)


def task(deviation: float = 0.006, lift: float = 0.05) -> Task:
    return Task((-0.1525, 0.0, -0.8), (0.1525, 0.0, -0.8), (lift, lift), (deviation, deviation))


def optimal(limits: Limits, deviation: float = 0.006, payload: float = 0.0) -> Plan:
    return Plan(ROBOT, task(deviation), TIME_OPTIMAL, payload, limits)


# Optima: cvxpy with Clarabel on 240 quadratic B-splines, and the kernel's method on 400 intervals with a gap of 1e-5; they agree
# within 0.05 %.
@pytest.mark.parametrize(("deviation", "optimum", "bound"), [(0.006, 0.22314, 0.2245), (0.001, 0.2416, 0.244)])
def test_jerk_limited_durations(deviation: float, optimum: float, bound: float) -> None:
    plan = optimal(PAPERS_PEAKS, deviation)
    assert optimum <= plan.nominal_duration <= bound
    assert max(ratios(plan, PAPERS_PEAKS)) <= 1.001


@pytest.mark.parametrize("jerk", [PAPERS_PEAKS.joint_jerk, (math.inf,) * 3])
@pytest.mark.parametrize("deviation", [1e-4, 1e-5, 3e-6])
def test_no_jump_beside_corners_of_micrometres(deviation: float, jerk: tuple[float, float, float]) -> None:
    """Where the tool almost stops, b spans orders of magnitude within a piece; its clock is as exact there."""
    plan = optimal(replace(PAPERS_PEAKS, joint_jerk=jerk), deviation)
    time = np.linspace(0.0, plan.duration, 100_001)
    found = plan.sample(time)
    moved, speed = np.diff(found["tcp_position"], axis=0), found["tcp_velocity"]
    # trapezoidal rule: its error is of third order in a step
    np.testing.assert_allclose(moved, time[1] * 0.5 * (speed[1:] + speed[:-1]), atol=1e-10)


def test_who_is_beyond_a_limit_is_told_what_can_be_changed() -> None:
    limits = replace(PAPERS_PEAKS, joint_velocity=(4.0,) * 3)
    with pytest.raises(InfeasibleError, match=r"beyond the limit of 4 rad/s: lower the law's speeds$"):
        Plan(ROBOT, task(), PAPER).require_within(limits)
    with pytest.raises(InfeasibleError, match=r"beyond the limit of 4 rad/s: the law misses it by 10 %, lower it by as much$"):
        optimal(PAPERS_PEAKS).require_within(limits)


def derivatives_by_arc_length(count: int) -> tuple[float, np.ndarray, np.ndarray]:
    """dq/ds, d2q/ds2 on the paper's path, from positions of the paper's own plan and differences of its joint angles."""
    plan = Plan(ROBOT, task(), PAPER)
    ds, step = plan.length / (count - 1), 1e-4 * plan.length

    def angles(arc_length: np.ndarray) -> np.ndarray:
        low, high = np.zeros_like(arc_length), np.full_like(arc_length, plan.duration)
        for _ in range(60):
            middle = 0.5 * (low + high)
            below = plan.sample(middle)["arc_length"] < arc_length
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return joint_angles(plan.sample(high)["tcp_position"])

    at = np.clip(np.linspace(0.0, plan.length, count), step, plan.length - step)
    before, here, after = (angles(at + shift) for shift in (-step, 0.0, step))
    return ds, (after - before) / (2.0 * step), (after - 2.0 * here + before) / step**2


def test_without_a_jerk_limit_against_reachability_analysis() -> None:
    best = shortest_duration(*derivatives_by_arc_length(1501), 4.4227, 241.365)
    assert best == pytest.approx(0.2146, abs=2e-4)  # toppra with 1000 intervals: 214.7 ms
    plan = optimal(limits_of(4.4227, 241.365, math.inf))
    assert 0.998 * best <= plan.nominal_duration <= min(1.006 * best, 0.216)
    assert max(ratios(plan, limits_of(4.4227, 241.365, math.inf))[:2]) <= 1.001


def test_papers_law_within_its_own_peaks_gains_little() -> None:
    plan = Plan(ROBOT, task(), replace(PAPER, name="paper_limited"), 0.0, PAPERS_PEAKS)
    assert 0.2985 <= plan.nominal_duration <= 0.3  # differential evolution: 299.0 ms
    assert plan.violations(PAPERS_PEAKS) == []
    again = Plan(ROBOT, task(), Law("paper", *plan.speeds, 0.5))
    assert again.nominal_duration == plan.nominal_duration


def test_phases_are_the_six_of_the_path() -> None:
    phases, paper = optimal(PAPERS_PEAKS).phases, Plan(ROBOT, task(), PAPER).phases
    assert [p.name for p in phases] == [p.name for p in paper]
    assert [p.length for p in phases] == pytest.approx([p.length for p in paper], abs=1e-12)
    assert sum(p.duration for p in phases) == pytest.approx(0.224, abs=1e-12)


def test_the_same_plan_twice_has_the_same_bits() -> None:
    one, other = optimal(PAPERS_PEAKS), optimal(limits_of(1.0, 1e3, math.inf))
    again = optimal(PAPERS_PEAKS)
    assert other.duration > one.duration
    there, here = one.sample(one.grid()), again.sample(again.grid())
    assert all((there[name] == here[name]).all() for name in there.dtype.names)


@pytest.mark.parametrize("name", ["paper_limited", "time_optimal"])
@pytest.mark.parametrize(
    ("limits", "status", "says"),
    [
        (limits_of(math.inf, math.inf, math.inf), "no_limit", "needs a limit"),
        (limits_of(4.0, math.inf, math.inf, torque=1.0), "limit_exceeded", "to hold still"),
        (limits_of(math.nan, 240.0, math.inf), "invalid_value", "nan"),
        (limits_of(4.0, -1.0, math.inf), "invalid_value", "-1"),
        (limits_of(1e-6, math.inf, math.inf), "too_slow", "raise"),
    ],
)
def test_refusals(name: str, limits: Limits, status: str, says: str) -> None:
    with pytest.raises(InfeasibleError, match=says) as refusal:
        Plan(ROBOT, task(), replace(PAPER, name=name), 0.0, limits)
    assert refusal.value.status == status


def test_other_laws_ignore_limits() -> None:
    assert Plan(ROBOT, task(), PAPER, 0.0, limits_of(1e-3, 1e-3, 1e-3)).duration == 0.303


def test_the_fmu_starts_with_the_limits_of_the_drives() -> None:
    table = variable_table("planner")
    for name, value in limit_values(Limits.of_drives()).items():
        assert table[name].start == pytest.approx(value, rel=1e-12), name
    assert table["limit.tcp_speed"].start == NO_LIMIT


def test_workspace_is_small() -> None:
    assert lib.dph_workspace_size() < 1 << 19


def test_a_solution_is_positive_between_its_samples_too() -> None:
    # Corners so small that the solver's b dips below zero between two of the points at which it is verified.
    limits = limits_of(0.00383, math.inf, 3.56e10, tcp_speed=22.7)
    lift, deviation, half = 0.0349, 1.55e-6, 0.000945
    task = Task((-half, 0.0, -0.8), (half, 0.0, -0.8), (lift, lift), (deviation, deviation))
    plan = Plan(ROBOT, task, TIME_OPTIMAL, 0.0, limits)
    assert math.isfinite(plan.nominal_duration)
    assert plan.violations(limits) == []
