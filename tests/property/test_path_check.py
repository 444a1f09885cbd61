"""The path check: what it accepts is within bounds everywhere, what it refuses is not; held against dense samples of the path."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from deltaph.errors import InfeasibleError
from deltaph.kernel import ffi, lib
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import Law, Task

Vector = NDArray[np.float64]

LEAST_DEXTERITY = 0.1
LAW = Law("paper", 1.2, 0.8, 2.4, 0.5)
GIANT, BELOW = Robot.default(upper_arm_length=3.0, forearm_length=8.0, joint_position_min=-3.14, joint_position_max=3.14), 7.0
"""A robot that goes wherever one of those below could be asked to go, that many metres lower: planning with it gives the path."""

# A step of 1e-4 upper arms turns a joint at the least dexterity by 1e-3 rad, half of which can hide between two poses.
HIDDEN = 5e-4


FREE = {"joint_position_min": -3.14, "joint_position_max": 3.14}


@st.composite
def tasks(draw: st.DrawFn, radius: float, lowest: float, highest: float) -> Task:
    r, a = (draw(st.tuples(st.floats(0.0, most), st.floats(0.0, most))) for most in (radius, 6.28))
    height, lift = draw(st.floats(lowest, highest)), draw(st.floats(0.02, 0.15))
    ends = [(r[k] * float(np.cos(a[k])), r[k] * float(np.sin(a[k])), height) for k in range(2)]
    assume(np.hypot(ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]) > 2.1 * lift)
    deviation = 0.16 * lift * draw(st.floats(0.1, 1.0))
    return Task(ends[0], ends[1], (lift, lift), (deviation, deviation))


robots = st.fixed_dictionaries(
    {
        "upper_arm_length": st.floats(0.1, 0.6),
        "forearm_length": st.floats(0.5, 1.2),
        "base_radius": st.floats(0.05, 0.4),
        "platform_radius": st.floats(0.02, 0.2),
    }
)
laws = st.sampled_from(["paper", "comparison"])


def path_of(task: Task, law: str, count: int = 3000) -> Vector:
    """Points (n, 3) of the path."""
    pick, place = ((x, y, z - BELOW) for x, y, z in (task.pick, task.place))
    plan = Plan(GIANT, replace(task, pick=pick, place=place), replace(LAW, name=law))
    path: Vector = plan.sample(np.linspace(0.0, plan.duration, count))["tcp_position"] + np.array([0.0, 0.0, BELOW])
    return path


def postures(robot: Robot, path: Vector) -> tuple[Vector, Vector]:
    """Joint angles (n, 3), not a number where out of reach, and dexterity (n), there 0."""
    theta, dexterity = np.full_like(path, np.nan), np.zeros(len(path))
    for k, point in enumerate(path):
        angles, at = ffi.from_buffer("double[3]", theta[k]), ffi.from_buffer("double[3]", np.ascontiguousarray(point))
        if lib.dph_inverse_kinematics(robot.struct, at, angles).status == lib.DPH_STATUS_OK:
            dexterity[k] = lib.dph_dexterity(robot.struct, angles, at)
    return theta, dexterity


def refusal_of(robot: Robot, task: Task, law: str) -> InfeasibleError | None:
    try:
        Plan(robot, task, replace(LAW, name=law))
    except InfeasibleError as refusal:
        return refusal
    return None


@given(robots, tasks(0.8, -1.3, -0.2), laws)
@settings(max_examples=120, deadline=None)
def test_a_path_is_refused_where_it_is_out_of_reach_or_singular(lengths: dict[str, float], task: Task, law: str) -> None:
    robot = Robot.default(**lengths, **FREE)
    dexterity = postures(robot, path_of(task, law))[1].min()
    refusal = refusal_of(robot, task, law)
    if refusal is None:
        assert dexterity >= LEAST_DEXTERITY * 0.99
    else:
        assert refusal.status in {"unreachable", "singular"}
        assert dexterity < LEAST_DEXTERITY * 1.01


@given(tasks(0.35, -0.9, -0.7), laws, st.sampled_from(["joint_position_min", "joint_position_max"]))
@settings(max_examples=120, deadline=None)
def test_a_joint_range_is_refused_from_where_the_path_needs_more(task: Task, law: str, end: str) -> None:
    theta, _ = postures(Robot.default(**FREE), path_of(task, law))
    sign = 1.0 if end == "joint_position_max" else -1.0
    extremes = (sign * theta).max(axis=0)
    extreme = sign * float(extremes.max())
    assert refusal_of(Robot.default(**(FREE | {end: extreme + sign * HIDDEN})), task, law) is None
    refusal = refusal_of(Robot.default(**(FREE | {end: extreme - sign * HIDDEN})), task, law)
    assert refusal is not None
    assert refusal.status == "joint_range"
    beyond = [joint for joint in range(3) if extremes[joint] > sign * refusal.available]
    assert any(f"joint {joint + 1} would have to turn" in str(refusal) for joint in beyond)
    assert refusal.available == pytest.approx(extreme - sign * HIDDEN, abs=1e-15)
    assert 0.0 < sign * (refusal.required - refusal.available) <= 2.0 * HIDDEN
