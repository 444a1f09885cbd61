"""Kinematics of the Delta robot: closed forms against the loop closure, their own inverse, differences and the reference."""

import math
from typing import Any

import numpy as np
import pytest
from golden.golden_file import cases, golden
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from deltaph.kernel import ffi, lib, sentence
from deltaph.robot import Robot

Vector = NDArray[np.float64]

ROBOT = Robot.default()
STATES = cases("mechanism", "state")
GOLDEN = golden("mechanism")
ANGLES = 2.0 * np.pi / 3.0 * np.arange(3)
DIRECTION = np.stack([np.cos(ANGLES), np.sin(ANGLES), 0.0 * ANGLES], axis=1)  # (arm, axis)

radii, azimuths, heights = st.floats(0.0, 0.45), st.floats(-math.pi, math.pi), st.floats(-0.9, -0.6)
workspace = st.builds(lambda r, a, z: np.array([r * math.cos(a), r * math.sin(a), z]), radii, azimuths, heights)
anything = st.floats(allow_nan=True, allow_infinity=True)


def view(array: Vector) -> Any:
    return ffi.from_buffer("double[3]", array)


def inverse(point: Vector, robot: Robot = ROBOT) -> tuple[Any, Vector]:
    theta = np.full(3, 99.0)
    verdict = lib.dph_inverse_kinematics(robot.struct, view(point), view(theta))
    return verdict, theta


def forward(theta: Vector, robot: Robot = ROBOT) -> Vector | None:
    point = np.empty(3)
    return point if lib.dph_forward_kinematics(robot.struct, view(theta), view(point)) else None


def joint_motion(theta: Vector, motion: Vector, robot: Robot = ROBOT) -> Vector:
    """Joint velocity, acceleration, jerk (3, 3) for a motion of the point (order 0 to 3, 3)."""
    result = np.empty((3, 3))
    lib.dph_joint_motion(robot.struct, view(theta), *map(view, motion), *map(view, result))
    return result


def forearms(theta: Vector, point: Vector) -> Vector:
    """Forearm vectors (arm, axis) [m] by the definition of the geometry."""
    shoulder = ROBOT.parameters["robot.base_radius"] * DIRECTION
    arm = np.cos(theta)[:, None] * DIRECTION - np.sin(theta)[:, None] * np.array([0.0, 0.0, 1.0])
    elbow = shoulder + ROBOT.parameters["robot.upper_arm_length"] * arm
    return np.asarray(point + ROBOT.parameters["robot.platform_radius"] * DIRECTION - elbow)


# Positions


@given(workspace)
def test_inverse_kinematics_closes_the_loops(point: Vector) -> None:
    verdict, theta = inverse(point)
    assert verdict.status == lib.DPH_STATUS_OK
    assert np.linalg.norm(forearms(theta, point), axis=1) == pytest.approx(ROBOT.parameters["robot.forearm_length"], abs=1e-15)


@given(workspace)
def test_forward_kinematics_undoes_inverse_kinematics(point: Vector) -> None:
    found = forward(inverse(point)[1])
    assert found is not None
    assert found == pytest.approx(point, abs=1e-14)  # rounding of metres, spread by the Jacobian


@given(st.tuples(*3 * [st.floats(-0.6, 1.2)]).map(np.array))
def test_inverse_kinematics_undoes_forward_kinematics(theta: Vector) -> None:
    point = forward(theta)
    assume(point is not None)
    assert point is not None
    dexterity = lib.dph_dexterity(ROBOT.struct, view(theta), view(point))
    assume(dexterity > 0.1 and point[2] < -0.4)
    assert inverse(point)[1] == pytest.approx(theta, abs=1e-15 / dexterity * 8)


def test_angles_are_right_in_every_direction_of_the_arms() -> None:
    random, free = np.random.default_rng(5), Robot.default(joint_position_min=-math.pi, joint_position_max=math.pi)
    found = []
    for point in random.uniform((-0.8, -0.8, -1.1), (0.8, 0.8, 1.1), (20000, 3)):
        verdict, theta = inverse(point, free)
        if verdict.status == lib.DPH_STATUS_OK:
            found.append(theta)
            assert lib.dph_closure_residual(free.struct, view(theta), view(point)) < 1e-15
    octants = np.floor(np.array(found) / (math.pi / 4.0))
    assert set(octants.ravel()) == set(range(-4, 4))


def test_elbows_point_outwards() -> None:
    theta = inverse(np.array([0.0, 0.0, -0.8]))[1]
    elbows = ROBOT.elbows(theta[None])[0]
    outwards = np.sum(elbows * DIRECTION, axis=1)
    assert np.all(outwards > ROBOT.parameters["robot.base_radius"])
    assert elbows == pytest.approx(forearms(theta, np.zeros(3)) * -1.0 + ROBOT.parameters["robot.platform_radius"] * DIRECTION)


def test_turning_the_point_by_120_degrees_permutes_the_joints() -> None:
    point = np.array([0.11, -0.07, -0.79])
    turn = np.array([[-0.5, -math.sqrt(0.75), 0.0], [math.sqrt(0.75), -0.5, 0.0], [0.0, 0.0, 1.0]])
    assert np.roll(inverse(point)[1], 1) == pytest.approx(inverse(turn @ point)[1], abs=1e-15)


# Refusals


@pytest.mark.parametrize(
    ("point", "joint"), [((0.9, 0.0, -0.8), 2), ((-0.9, 0.0, -0.8), 1), ((0.0, 0.0, -1.3), 1), ((0.0, 2.0, -0.8), 1)]
)
def test_a_point_out_of_reach_is_refused_with_facts(point: tuple[float, float, float], joint: int) -> None:
    verdict, theta = inverse(np.array(point))
    assert (verdict.status, verdict.joint) == (lib.DPH_STATUS_UNREACHABLE, joint)
    assert verdict.required > verdict.available
    assert np.all(theta == 99.0)
    assert f"out of reach of arm {joint}" in sentence(verdict)


def test_a_point_too_near_is_refused_with_the_lower_bound() -> None:
    verdict, theta = inverse(np.array([0.0, 0.0, 0.01]))
    assert verdict.status == lib.DPH_STATUS_UNREACHABLE
    assert verdict.required == pytest.approx(math.hypot(0.155, 0.01))
    assert verdict.available == pytest.approx(0.45)
    assert np.all(theta == 99.0)


@given(st.tuples(anything, anything, anything).map(np.array))
def test_any_point_gets_angles_or_a_refusal(point: Vector) -> None:
    verdict, theta = inverse(point)
    if verdict.status == lib.DPH_STATUS_OK:
        assert np.all(np.abs(theta) <= math.pi)
    else:
        assert verdict.status == lib.DPH_STATUS_UNREACHABLE
        assert np.all(theta == 99.0)


@given(st.tuples(*3 * [st.floats(-2.0, 2.0)]).map(np.array))
def test_what_is_refused_lies_beyond_the_bound(point: Vector) -> None:
    verdict, _ = inverse(point)
    if verdict.status == lib.DPH_STATUS_UNREACHABLE:
        upper, forearm = (ROBOT.parameters[f"robot.{name}"] for name in ("upper_arm_length", "forearm_length"))
        too_near = verdict.required < verdict.available <= forearm - upper
        assert too_near or verdict.required > verdict.available > 0.0


@given(st.tuples(anything, anything, anything).map(np.array))
def test_any_angles_get_a_finite_point_or_none(theta: Vector) -> None:
    point = forward(theta)
    assert point is None or np.all(np.isfinite(point))


def test_spheres_that_do_not_meet_are_refused() -> None:
    short = Robot.default(forearm_length=0.3)
    point = np.full(3, 7.0)
    assert lib.dph_forward_kinematics(short.struct, view(np.zeros(3)), view(point)) == 0
    assert np.all(point == 7.0)


# Motions


@given(workspace, st.lists(st.floats(-3.0, 3.0), min_size=9, max_size=9))
def test_each_order_of_joint_motion_is_the_derivative_of_the_one_below(point: Vector, derivatives: list[float]) -> None:
    motion = np.vstack([point, np.reshape(derivatives, (3, 3))])
    step, stencil = 3e-4, np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
    rows = []
    for t in step * np.arange(-3, 4):
        moved = np.array([sum(motion[n + k] * t**k / math.factorial(k) for k in range(4 - n)) for n in range(4)])
        theta = inverse(moved[0])[1]
        rows.append(np.vstack([theta, joint_motion(theta, moved)]))
    differences = np.einsum("s,snk->nk", stencil, np.array(rows)) / step
    # rounding 1e-16 / step times the growth of the derivatives: v < 6 m/s at 0.2 m from a singularity, 30 rad/s per order
    for order in range(3):
        assert rows[3][order + 1] == pytest.approx(differences[order], rel=1e-7, abs=1e-9 * 30.0 ** (order + 1))


def test_a_resting_point_rests_the_joints() -> None:
    point = np.array([-0.1525, 0.0, -0.8])
    assert np.all(joint_motion(inverse(point)[1], np.array([point, np.zeros(3), np.zeros(3), np.zeros(3)])) == 0.0)


# Dexterity


def test_dexterity_is_the_smaller_of_both_distances_from_singularity() -> None:
    point = np.array([0.12, -0.2, -0.78])
    theta = inverse(point)[1]
    s = forearms(theta, point)
    tangent = -np.sin(theta)[:, None] * DIRECTION - np.cos(theta)[:, None] * np.array([0.0, 0.0, 1.0])
    serial = np.min(np.abs(np.sum(s * tangent, axis=1))) / 0.8
    parallel = abs(np.linalg.det(s)) / 0.8**3
    assert lib.dph_dexterity(ROBOT.struct, view(theta), view(point)) == pytest.approx(min(serial, parallel), rel=1e-13)


def test_dexterity_vanishes_where_an_arm_is_stretched() -> None:
    # straight down below the shoulder of arm 1
    reach = ROBOT.parameters["robot.upper_arm_length"] + ROBOT.parameters["robot.forearm_length"]
    point = np.array(
        [ROBOT.parameters["robot.base_radius"] - ROBOT.parameters["robot.platform_radius"], 0.0, -reach * (1.0 - 1e-15)]
    )
    theta = np.array([math.pi / 2, 1.0, 1.0])
    assert lib.dph_dexterity(ROBOT.struct, view(theta), view(point)) == pytest.approx(0.0, abs=1e-7)


# The robot itself


@pytest.mark.parametrize(
    ("change", "bound"),
    [
        ({"forearm_length": 0.0}, 1e-9),
        ({"upper_arm_length": math.nan}, 1e-9),
        ({"platform_mass": -1.0}, 0.0),
        ({"base_radius": math.inf}, 1e6),
        ({"base_radius": 3.0}, 2.955),
        ({"upper_arm_inertia": 0.0, "drive_inertia": 0.0}, 1e-9),
        ({"joint_position_min": 2.0}, 2.0),
    ],
)
def test_what_is_no_robot_is_refused_with_the_bound(change: dict[str, float], bound: float) -> None:
    verdict = lib.dph_robot_check(Robot.default(**change).struct)
    assert verdict.status == lib.DPH_STATUS_INVALID_ROBOT
    assert verdict.required == pytest.approx(bound)


def test_the_default_robot_is_one() -> None:
    assert lib.dph_robot_check(ROBOT.struct).status == lib.DPH_STATUS_OK


# The reference


@pytest.mark.parametrize("name", STATES)
def test_kinematics_agrees_with_the_reference(name: str) -> None:
    state = STATES[name]
    motion = np.array([state[key] for key in ("position", "velocity", "acceleration", "jerk")])
    theta = inverse(motion[0])[1]
    point = forward(np.array(state["joint_position"]))
    assert point is not None
    values = {
        f"inverse.joint_{kind}.{i + 1}": row[i]
        for kind, row in zip(("position", "velocity", "acceleration", "jerk"), (theta, *joint_motion(theta, motion)), strict=True)
        for i in range(3)
    }
    values |= {f"forward.position.{axis}": point[k] for k, axis in enumerate("xyz")}
    rows = [row for row in GOLDEN if row.case == name and row.quantity in values]
    assert len(rows) == 15
    assert not [problem for row in rows if (problem := row.check(float(values[row.quantity])))]
