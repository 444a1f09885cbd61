"""Dynamics of the Delta robot: against a twin with all coordinates and multipliers, energy, its own inverse and the reference."""

import math
from typing import Any

import numpy as np
import pytest
from golden.golden_file import cases, golden
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from deltaph.kernel import ffi, lib
from deltaph.robot import Robot

Vector = NDArray[np.float64]

ROBOT = Robot.default()
GRAVITY = 9.80665
STATES = cases("mechanism", "state")
GOLDEN = golden("mechanism")
UP = np.array([0.0, 0.0, 1.0])

radii, azimuths, heights = st.floats(0.0, 0.4), st.floats(-math.pi, math.pi), st.floats(-0.9, -0.65)
workspace = st.builds(lambda r, a, z: np.array([r * math.cos(a), r * math.sin(a), z]), radii, azimuths, heights)
payloads = st.floats(0.0, 2.0)


def triple(size: float) -> st.SearchStrategy[Vector]:
    return st.tuples(*3 * [st.floats(-size, size)]).map(np.array)


def array(member: Any) -> Vector:
    return np.array(list(member))


def multipliers(motion: Any) -> Vector:
    """lambda, a reserved word of Python."""
    return array(getattr(motion, "lambda"))


def angles_at(point: Vector, robot: Robot = ROBOT) -> Vector:
    return robot.inverse_kinematics(point)


def forward(theta: Vector, rate: Vector, torque: Vector, payload: float = 0.0, robot: Robot = ROBOT) -> Any:
    """The kernel's `dph_motion` that follows from a joint state and torques, or None where it fails."""
    motion = ffi.new("dph_motion *", {"theta": list(theta), "theta_d": list(rate), "torque": list(torque)})
    return motion if lib.dph_forward_dynamics(robot.struct, payload, motion) else None


def inverse(motion: Any, payload: float = 0.0, robot: Robot = ROBOT) -> Any:
    result = ffi.new("dph_motion *", motion[0])
    lib.dph_inverse_dynamics(robot.struct, payload, result)
    return result


class Twin:
    """The mechanism in all six coordinates q = (theta, p) with the multipliers of its three loop closures, as matrices."""

    def __init__(self, robot: Robot, payload: float, theta: Vector, point: Vector) -> None:
        value = {name.removeprefix("robot."): v for name, v in robot.parameters.items()}
        upper, forearm, rods = value["upper_arm_length"], value["forearm_length"], value["forearm_mass"]
        angle = 2.0 * np.pi / 3.0 * np.arange(3)
        u = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
        elbow = u * (value["base_radius"] + upper * c) - upper * s * UP
        self.tangent = -upper * (u * s + UP * c)
        self.normal = -upper * (u * c - UP * s)
        self.forearm = point + value["platform_radius"] * u - elbow
        self.jacobian = np.hstack([-np.diag(np.sum(self.forearm * self.tangent, axis=1)), self.forearm])

        turning = value["forearm_inertia"] / forearm**2
        same, other = rods / 4.0 + turning, rods / 4.0 - turning
        moving = value["platform_mass"] + payload
        self.mass = np.diag([value["upper_arm_inertia"] + value["drive_inertia"] + same * upper**2] * 3 + [moving + 3.0 * same] * 3)
        self.mass[:3, 3:] = other * self.tangent
        self.mass[3:, :3] = other * self.tangent.T
        self.other = other
        arms = GRAVITY * (value["upper_arm_mass"] * value["upper_arm_com"] / upper + rods / 2.0) * self.tangent[:, 2]
        self.weight = np.concatenate([arms, GRAVITY * (moving + 1.5 * rods) * UP])

    def solve(self, rate: Vector, torque: Vector) -> tuple[Vector, Vector, Vector, Vector]:
        """Velocity of the point, acceleration of the joints, acceleration of the point, multipliers."""
        a, b = self.jacobian[:, 3:], -np.diag(self.jacobian[:, :3])
        velocity = np.linalg.solve(a, b * rate)
        s_d = velocity - self.tangent * rate[:, None]
        gamma = np.sum(s_d**2, axis=1) - np.sum(self.forearm * self.normal, axis=1) * rate**2
        centrifugal = np.concatenate([np.zeros(3), self.other * self.normal.T @ rate**2])
        system = np.block([[self.mass, self.jacobian.T], [self.jacobian, np.zeros((3, 3))]])
        force = np.concatenate([torque, np.zeros(3)]) - self.weight - centrifugal
        solution = np.linalg.solve(system, np.concatenate([force, -gamma]))
        return velocity, solution[:3], solution[3:6], solution[6:]

    def energy(self, robot: Robot, payload: float, theta: Vector, rate: Vector, point: Vector, velocity: Vector) -> float:
        """Kinetic and potential energy [J]."""
        q_d = np.concatenate([rate, velocity])
        value = {name.removeprefix("robot."): v for name, v in robot.parameters.items()}
        arm = value["upper_arm_mass"] * value["upper_arm_com"] + value["forearm_mass"] / 2.0 * value["upper_arm_length"]
        height = (value["platform_mass"] + payload + 1.5 * value["forearm_mass"]) * point[2] - arm * np.sum(np.sin(theta))
        return float(q_d @ self.mass @ q_d / 2.0 + GRAVITY * height)


# Against the twin


@given(workspace, triple(5.0), triple(50.0), payloads)
def test_forward_dynamics_solves_the_equations_in_all_coordinates(
    point: Vector, rate: Vector, torque: Vector, payload: float
) -> None:
    theta = angles_at(point)
    motion = forward(theta, rate, torque, payload)
    velocity, joints, platform, expected = Twin(ROBOT, payload, theta, point).solve(rate, torque)
    # relative to 600 rad/s^2, 300 m/s^2 and 200 N/m, which these torques and speeds make
    assert array(motion.point_d) == pytest.approx(velocity, abs=1e-12 * 5.0)
    assert array(motion.theta_dd) == pytest.approx(joints, abs=1e-12 * 600.0)
    assert array(motion.point_dd) == pytest.approx(platform, abs=1e-12 * 300.0)
    assert multipliers(motion) == pytest.approx(expected, abs=1e-12 * 200.0)


@given(workspace, triple(5.0), triple(50.0), payloads)
def test_inverse_dynamics_undoes_forward_dynamics(point: Vector, rate: Vector, torque: Vector, payload: float) -> None:
    motion = forward(angles_at(point), rate, torque, payload)
    again = inverse(motion, payload)
    assert array(again.torque) == pytest.approx(torque, abs=1e-13 * 50.0 * 4.0)
    assert multipliers(again) == pytest.approx(multipliers(motion), abs=1e-12 * 200.0)


@given(workspace, payloads)
def test_the_reduced_mass_matrix_is_symmetric_and_positive(point: Vector, payload: float) -> None:
    theta = angles_at(point)
    still = array(forward(theta, np.zeros(3), np.zeros(3), payload).theta_dd)
    response = np.array([array(forward(theta, np.zeros(3), 10.0 * e, payload).theta_dd) - still for e in np.eye(3)]) / 10.0
    assert response == pytest.approx(response.T, abs=1e-13 * 20.0)
    assert np.all(np.linalg.eigvalsh(response) > 0.0)


# Laws


def test_energy_is_kept_in_a_fall_without_torque() -> None:
    # RK4 drifts with the step's fourth power: 3e-13 J at 5e-4 s, found with three steps
    theta, rate = angles_at(np.array([0.1, -0.15, -0.75])), np.zeros(3)
    step, payload, energies = 5e-4, 0.5, []

    def slope(theta: Vector, rate: Vector) -> tuple[Vector, Vector, Any]:
        motion = forward(theta, rate, np.zeros(3), payload)
        return rate, array(motion.theta_dd), motion

    for _ in range(201):
        v1, a1, motion = slope(theta, rate)
        point, velocity = array(motion.point), array(motion.point_d)
        energies.append(Twin(ROBOT, payload, theta, point).energy(ROBOT, payload, theta, rate, point, velocity))
        v2, a2, _ = slope(theta + step / 2 * v1, rate + step / 2 * a1)
        v3, a3, _ = slope(theta + step / 2 * v2, rate + step / 2 * a2)
        v4, a4, _ = slope(theta + step * v3, rate + step * a3)
        theta = theta + step / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
        rate = rate + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    assert np.linalg.norm(rate) > 3.0
    assert np.array(energies) == pytest.approx(energies[0], abs=2e-12)


def test_a_platform_on_massless_arms_falls_freely() -> None:
    light = Robot.default(
        upper_arm_mass=0.0, upper_arm_inertia=0.0, forearm_mass=0.0, forearm_inertia=0.0, drive_inertia=1e-9, platform_mass=1.0
    )
    motion = forward(angles_at(np.array([0.1, 0.05, -0.8])), np.zeros(3), np.zeros(3), robot=light)
    assert array(motion.point_dd) == pytest.approx([0.0, 0.0, -GRAVITY], abs=1e-6)
    assert multipliers(motion) == pytest.approx(0.0, abs=1e-6)


def test_rods_in_tension_have_positive_multipliers() -> None:
    motion = forward(angles_at(np.array([0.0, 0.0, -0.8])), np.zeros(3), np.zeros(3))
    held = ffi.new("dph_motion *", {"theta": motion.theta, "point": motion.point})
    assert np.all(multipliers(inverse(held)) > 0.0)


def test_payload_counts_as_platform_mass() -> None:
    theta, rate, torque = angles_at(np.array([0.1, 0.1, -0.7])), np.array([1.0, -2.0, 0.5]), np.array([5.0, 0.0, -9.0])
    loaded = forward(theta, rate, torque, payload=0.75)
    heavy = forward(theta, rate, torque, robot=Robot.default(platform_mass=1.25))
    assert array(loaded.theta_dd) == pytest.approx(array(heavy.theta_dd), rel=1e-15)


# Any input

anything = st.floats(allow_nan=True, allow_infinity=True)
wild = st.tuples(anything, anything, anything)


@given(wild, wild, wild, anything)
def test_forward_dynamics_fails_rather_than_return_what_is_not_finite(
    theta: tuple[float, ...], rate: tuple[float, ...], torque: tuple[float, ...], payload: float
) -> None:
    motion = forward(np.array(theta), np.array(rate), np.array(torque), payload)
    if motion is not None:
        for member in ("theta_dd", "point", "point_d", "point_dd", "lambda"):
            assert np.all(np.isfinite(array(getattr(motion, member))))


# The reference


@pytest.mark.parametrize("name", STATES)
def test_dynamics_agrees_with_the_reference(name: str) -> None:
    state, length = STATES[name], ROBOT.parameters["robot.forearm_length"]
    point, rest = np.array(state["position"]), np.zeros(3)
    theta = angles_at(point)
    derivative = np.empty((3, 3))
    vectors = [np.array(v) for v in (point, state["velocity"], state["acceleration"], rest)]
    views = [ffi.from_buffer("double[3]", v) for v in (theta, *vectors, *derivative)]
    lib.dph_joint_motion(ROBOT.struct, *views)
    given_motion = ffi.new(
        "dph_motion *",
        {
            "theta": list(theta),
            "theta_d": list(derivative[0]),
            "theta_dd": list(derivative[1]),
            "point": list(point),
            "point_d": state["velocity"],
            "point_dd": state["acceleration"],
        },
    )
    held = inverse(given_motion, state["payload"])
    joint_state = [np.array(state[f"joint_{kind}"]) for kind in ("position", "velocity", "torque")]
    moved = forward(joint_state[0], joint_state[1], joint_state[2], state["payload"])

    values: dict[str, float] = {}
    for i in range(3):
        values[f"inverse.joint_torque.{i + 1}"] = held.torque[i]
        values[f"inverse.rod_force.{i + 1}"] = multipliers(held)[i] * length
        values[f"forward.joint_acceleration.{i + 1}"] = moved.theta_dd[i]
        values[f"forward.rod_force.{i + 1}"] = multipliers(moved)[i] * length
        values[f"forward.velocity.{'xyz'[i]}"] = moved.point_d[i]
        values[f"forward.acceleration.{'xyz'[i]}"] = moved.point_dd[i]
    rows = [row for row in GOLDEN if row.case == name and row.quantity in values]
    assert len(rows) == len(values)
    assert not [problem for row in rows if (problem := row.check(values[row.quantity]))]
