"""Tasks whose legs are short or missing, under the laws that take the deviation as an upper bound."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from property.finite_differences import ratios
from property.random_tasks import PAPERS_PEAKS

from deltaph.errors import InfeasibleError
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import Law, Task

ROBOT = Robot.default()
EXCESS = 1e-3

lifts = st.one_of(st.just(0.0), st.floats(math.log(1e-3), math.log(0.1)).map(math.exp))
deviations = st.floats(math.log(1e-3), math.log(0.02)).map(math.exp)
laws = st.sampled_from(["time_optimal", "paper_limited"]).map(lambda name: Law(name, 1.2, 0.8, 2.4, 0.5))


@st.composite
def tasks(draw: st.DrawFn) -> Task:
    """Any direction, traverses from 1 mm, unequal lifts, none on some sides, deviations that mostly do not fit."""
    angle, width = draw(st.floats(0.0, 6.28)), math.exp(draw(st.floats(math.log(1e-3), math.log(0.4))))
    x, y = 0.5 * width * math.cos(angle), 0.5 * width * math.sin(angle)
    lift, top = (draw(lifts), draw(lifts)), draw(st.floats(-0.72, -0.65))
    return Task((-x, -y, top - lift[0]), (x, y, top - lift[1]), lift, (draw(deviations), draw(deviations)))


@given(tasks(), laws)
@settings(max_examples=100, deadline=None)
def test_deviation_is_never_exceeded_and_smaller_only_where_a_leg_is_short(task: Task, law: Law) -> None:
    plan = Plan(ROBOT, task, law, 0.0, PAPERS_PEAKS)
    path = plan.sample(np.linspace(0.0, plan.duration, 4001))["tcp_position"]
    spacing = np.linalg.norm(np.diff(path, axis=0), axis=1).max()
    sides = zip(plan.vertices, plan.corner_deviation, task.corner_deviation, plan.corner_legs, plan.corner_bound, strict=True)
    for vertex, planned, prescribed, (leg, second_leg), bound in sides:
        found = np.linalg.norm(path - vertex, axis=1).min()
        assert planned - 1e-9 <= found <= math.hypot(planned, spacing) + 1e-9
        assert planned <= prescribed * (1 + 1e-12)
        assert (planned < prescribed * (1 - 1e-9)) == (bound != "")
        assert (leg > 0.0) == (second_leg > 0.0) == (planned > 0.0)
    for lift, (leg, _) in zip(task.lift, plan.corner_legs, strict=True):
        assert leg <= 0.9 * lift * (1 + 1e-12)
    assert sum(legs[1] for legs in plan.corner_legs) <= math.dist(task.pick[:2], task.place[:2]) * (1 + 1e-12)


@given(tasks(), laws)
@settings(max_examples=60, deadline=None)
def test_limits_hold_by_differences_of_the_inverse_kinematics(task: Task, law: Law) -> None:
    plan = Plan(ROBOT, task, law, 0.0, PAPERS_PEAKS)
    assert plan.violations(PAPERS_PEAKS) == []
    if plan.duration < 1.0:  # the differences of longer motions are rounding
        assert max(ratios(plan, PAPERS_PEAKS)) <= 1 + EXCESS


@given(tasks(), laws)
@settings(max_examples=60, deadline=None)
def test_rest_to_rest_and_continuous(task: Task, law: Law) -> None:
    plan = Plan(ROBOT, task, law, 0.0, PAPERS_PEAKS)
    ends = plan.sample(np.array([0.0, plan.duration]))
    assert ends["tcp_position"].tolist() == [list(task.pick), list(task.place)]
    assert (ends["joint_velocity"] == 0.0).all()
    assert (ends["joint_acceleration"] == 0.0).all()
    gap = 1e-9
    times = np.array(list(plan._struct.boundary)[: plan._struct.pieces + 1]) / plan.speed_factor
    for what, derivative in (("position", "velocity"), ("velocity", "acceleration"), ("acceleration", "jerk")):
        before, after = (plan.sample(np.clip(times + shift, 0.0, plan.duration))[f"joint_{what}"] for shift in (-gap, gap))
        slope = max(getattr(plan.peaks, f"joint_{derivative}"))
        assert np.abs(after - before).max() <= 2.02 * gap * slope + 2e-8, what


@given(tasks(), laws)
@settings(max_examples=40, deadline=None)
def test_mirrored_task_has_the_mirrored_corners(task: Task, law: Law) -> None:
    plan, back = (Plan(ROBOT, t, law, 0.0, PAPERS_PEAKS) for t in (task, task.reversed()))
    assert back.corner_deviation[::-1] == pytest.approx(plan.corner_deviation, rel=1e-12)
    assert back.corner_legs[0] == pytest.approx(plan.corner_legs[1], rel=1e-12)
    assert back.length == pytest.approx(plan.length, rel=1e-12)
    if law.name == "paper_limited":
        time = np.linspace(0.0, plan.duration, 50)
        if back.nominal_duration == pytest.approx(plan.nominal_duration, rel=1e-12):
            there, here = plan.sample(time)["tcp_position"], back.sample(plan.duration - time)["tcp_position"]
            assert there == pytest.approx(here, abs=1e-8)


@given(st.floats(1e-3, 0.1), st.booleans(), laws)
@settings(max_examples=20, deadline=None)
def test_straight_up_and_straight_down(height: float, up: bool, law: Law) -> None:
    low, high = (0.05, -0.08, -0.7 - height), (0.05, -0.08, -0.7)
    task = Task(low, high, (height, 0.0), (0.006, 0.006)) if up else Task(high, low, (0.0, height), (0.006, 0.006))
    plan = Plan(ROBOT, task, law, 0.0, PAPERS_PEAKS)
    assert plan.corner_deviation == (0.0, 0.0)
    assert set(plan.corner_bound) == {"no lift, no corner", "no traverse, no corner"}
    z = plan.sample(np.linspace(0.0, plan.duration, 500))["tcp_position"][:, 2]
    assert (np.diff(z) * (1 if up else -1) >= -1e-12).all()
    assert plan.length == pytest.approx(height, rel=1e-9)
    assert plan.violations(PAPERS_PEAKS) == []


@pytest.mark.parametrize("name", ["time_optimal", "paper_limited"])
@pytest.mark.parametrize(("width", "lift"), [(0.0, (0.05, 0.05)), (0.0, (0.0, 0.0)), (1e-7, (0.05, 0.0))])
def test_no_way_across(name: str, width: float, lift: tuple[float, float]) -> None:
    task = Task((0.0, 0.0, -0.7 - lift[0]), (width, 0.0, -0.7 - lift[1]), lift, (0.006, 0.006))
    with pytest.raises(InfeasibleError) as refusal:
        Plan(ROBOT, task, Law(name, 1.2, 0.8, 2.4, 0.5), 0.0, PAPERS_PEAKS)
    assert refusal.value.status == "traverse_too_short"


@pytest.mark.parametrize(("name", "status"), [("paper", "lift_too_low"), ("comparison", "invalid_value")])
def test_the_printed_laws_have_corners_on_both_sides(name: str, status: str) -> None:
    task = Task((-0.1, 0.0, -0.75), (0.1, 0.0, -0.7), (0.05, 0.0), (0.006, 0.006))
    with pytest.raises(InfeasibleError) as refusal:
        Plan(ROBOT, task, Law(name, 1.2, 0.8, 2.4, 0.5))
    assert refusal.value.status == status
