"""Laws that every plan keeps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from property.random_tasks import random_tasks

from deltaph.errors import InfeasibleError
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import Law, Task
from deltaph.variables import variable_table

ROBOT = Robot.default()
REASONS = set(variable_table("planner").items("PlanStatus")) - {"none", "ok"}


@st.composite
def tasks(draw: st.DrawFn) -> Task:
    """Mostly feasible tasks: a level traverse within the workspace, any direction, unequal lifts."""
    pick_radius, place_radius = draw(st.floats(0.0, 0.30)), draw(st.floats(0.0, 0.30))
    pick_angle, place_angle = draw(st.floats(0.0, 6.28)), draw(st.floats(0.0, 6.28))
    top = draw(st.floats(-0.75, -0.65))
    lift = (draw(st.floats(0.02, 0.1)), draw(st.floats(0.02, 0.1)))
    deviation = (draw(st.floats(1e-3, 0.012)), draw(st.floats(1e-3, 0.012)))
    pick = (pick_radius * np.cos(pick_angle), pick_radius * np.sin(pick_angle), top - lift[0])
    place = (place_radius * np.cos(place_angle), place_radius * np.sin(place_angle), top - lift[1])
    return Task(tuple(map(float, pick)), tuple(map(float, place)), lift, deviation)


speeds = st.floats(0.05, 5.0)
laws = st.builds(Law, st.sampled_from(["paper", "comparison"]), speeds, speeds, speeds, st.floats(0.0, 1.0))


def plan_or_none(task: Task, law: Law) -> Plan | None:
    try:
        return Plan(ROBOT, task, law)
    except InfeasibleError as refusal:
        assert refusal.status in REASONS
        assert str(refusal)
        return None


@given(tasks(), laws)
@settings(max_examples=300, deadline=None)
def test_motion_is_continuous_and_arrives_at_rest(task: Task, law: Law) -> None:
    plan = plan_or_none(task, law)
    if plan is None:
        return
    ends = plan.sample(np.array([0.0, plan.duration]))
    assert ends["tcp_position"][0].tolist() == list(task.pick)
    assert ends["tcp_position"][1].tolist() == list(task.place)
    for what in ("tcp_velocity", "tcp_acceleration", "joint_velocity", "joint_acceleration"):
        assert np.abs(ends[what]).max() == 0.0, what

    # Across each boundary, over a gap that is short against the piece: a jump would show as a change that does not shrink with it.
    gap = 1e-9
    for phase in plan.phases[1:]:
        before, after = plan.sample(np.array([phase.start - gap, phase.start + gap]))
        for what, derivative in (("position", "velocity"), ("velocity", "acceleration"), ("acceleration", "jerk")):
            jump = np.abs(after[f"tcp_{what}"] - before[f"tcp_{what}"]).max()
            slope = max(np.abs(s[f"tcp_{derivative}"]).max() for s in (before, after))
            scale = np.abs(before[f"tcp_{what}"]).max() + np.abs(after[f"tcp_{what}"]).max()
            assert jump <= 3.0 * gap * slope + 1e-9 * scale + 1e-9, (phase.name, what)


@given(tasks(), laws)
@settings(max_examples=200, deadline=None)
def test_deviation_is_kept_by_construction(task: Task, law: Law) -> None:
    plan = plan_or_none(task, law)
    if plan is None:
        return
    path = plan.sample(np.linspace(0.0, plan.duration, 4001))["tcp_position"]
    for vertex, deviation, prescribed in zip(plan.vertices, plan.corner_deviation, task.corner_deviation, strict=True):
        found = np.linalg.norm(path - vertex, axis=1).min()
        assert found >= deviation * (1 - 1e-9) - 1e-12
        spacing = np.linalg.norm(np.diff(path, axis=0), axis=1).max()
        assert found <= np.hypot(deviation, spacing) + 1e-12
        if law.name == "paper":
            assert deviation == prescribed


@given(tasks(), laws)
@settings(max_examples=100, deadline=None)
def test_derivatives_belong_together(task: Task, law: Law) -> None:
    plan = plan_or_none(task, law)
    if plan is None:
        return
    h = 1e-6 * plan.duration
    for phase in plan.phases:
        middle = phase.start + 0.43 * phase.duration
        if phase.duration < 100 * h or law.name == "comparison":
            continue
        before, here, after = plan.sample(np.array([middle - h, middle, middle + h]))
        for kind in ("tcp", "joint"):
            for what, derivative in (("position", "velocity"), ("velocity", "acceleration"), ("acceleration", "jerk")):
                slope = (after[f"{kind}_{what}"] - before[f"{kind}_{what}"]) / (2 * h)
                exact = here[f"{kind}_{derivative}"]
                assert slope == pytest.approx(
                    exact, rel=2e-3, abs=2e-3 * (np.abs(exact).max() + np.abs(here[f"{kind}_{what}"]).max())
                )


@given(tasks(), laws)
@settings(max_examples=50, deadline=None)
def test_mirrored_task_is_the_mirrored_motion(task: Task, law: Law) -> None:
    plan = plan_or_none(task, law)
    if plan is None:
        return
    back = Plan(ROBOT, task.reversed(), law)
    assert back.duration_ms == plan.duration_ms
    time = np.linspace(0.0, plan.duration, 50)
    there, here = plan.sample(time), back.sample(plan.duration - time)
    assert there["tcp_position"] == pytest.approx(here["tcp_position"], abs=1e-11)
    assert there["tcp_velocity"] == pytest.approx(-here["tcp_velocity"], abs=1e-8)


@given(tasks(), laws)
@settings(max_examples=30, deadline=None)
def test_peaks_bound_every_sample(task: Task, law: Law) -> None:
    plan = plan_or_none(task, law)
    if plan is None:
        return
    s = plan.sample(np.linspace(0.0, plan.duration, 3000))
    for what in ("joint_velocity", "joint_acceleration", "joint_jerk", "joint_torque"):
        assert (np.abs(s[what]).max(axis=0) <= np.array(getattr(plan.peaks, what)) * (1 + 1e-12)).all(), what
    assert np.linalg.norm(s["tcp_velocity"], axis=1).max() <= plan.peaks.tcp_speed * (1 + 1e-12)
    assert np.linalg.norm(s["tcp_acceleration"], axis=1).max() <= plan.peaks.tcp_acceleration * (1 + 1e-12)


wild = st.floats(allow_nan=True, allow_infinity=True)


@given(
    st.tuples(wild, wild, wild),
    st.tuples(wild, wild, wild),
    st.tuples(wild, wild),
    st.tuples(wild, wild),
    st.builds(Law, st.sampled_from(["paper", "comparison"]), wild, wild, wild, wild),
    wild,
)
@settings(max_examples=500, deadline=None)
def test_wild_tasks_are_refused_or_planned_and_never_crash(pick, place, lift, deviation, law, payload) -> None:  # type: ignore[no-untyped-def]
    try:
        plan = Plan(ROBOT, Task(pick, place, lift, deviation), law, payload)
    except InfeasibleError as refusal:
        assert refusal.status in REASONS
        return
    assert np.isfinite(plan.sample(np.linspace(-1.0, plan.duration + 1.0, 20))["joint_position"]).all()


@pytest.mark.parametrize("law", ["paper", "comparison", "paper_limited", "time_optimal"])
def test_joints_alone_have_the_bits_of_the_setpoints(law: str) -> None:
    for task in random_tasks(10):
        plan = plan_or_none(task, Law(law, 1.2, 0.8, 2.4, 0.5))
        if plan is None:
            continue
        time = np.linspace(-0.01, plan.duration + 0.01, 1001)
        setpoints = plan.sample(time)
        for what, found in zip(("position", "velocity", "acceleration"), plan.joints(time), strict=True):
            assert found.tobytes() == setpoints[f"joint_{what}"].tobytes(), what
