"""The kernel's dynamics against two independent engines that simulate the true mechanism: rods on ball joints, a free platform."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference.mujoco_delta import MujocoDelta
from reference.pinocchio_delta import PinocchioDelta

from deltaph.kernel import ffi, lib
from deltaph.robot import Robot
from deltaph.scenario import load_scenario

Vector = NDArray[np.float64]

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STATES = range(20)
ARMATURES = pytest.mark.parametrize("armature", [0.0, 0.1], ids=["no rotor", "rotor"])


class State:
    """A random state of a robot, the same for the same seed: tcp in a box, payload, joint rates, torques."""

    def __init__(self, seed: int, armature: float, robot: Robot | None = None, height: float = -0.775) -> None:
        random = np.random.default_rng(seed)
        self.robot = Robot.default(drive_inertia=armature) if robot is None else robot
        self.parameters = {name.removeprefix("robot."): value for name, value in self.robot.parameters.items()}
        self.point = np.array([*random.uniform(-0.25, 0.25, 2), height + random.uniform(-0.125, 0.125)])
        self.theta = self.robot.inverse_kinematics(self.point)
        self.rate = random.uniform(-5.0, 5.0, 3)
        self.torque = random.uniform(-40.0, 40.0, 3)
        self.payload = random.uniform(0.0, 1.0)

    def kernel(self, force: Iterable[float] = (0.0, 0.0, 0.0)) -> Any:
        state = {"theta": self.theta, "theta_d": self.rate, "torque": self.torque, "force": force}
        motion = ffi.new("dph_motion *", {name: list(value) for name, value in state.items()})
        assert lib.dph_forward_dynamics(self.robot.struct, self.payload, motion)
        return motion


def difference(found: Any, expected: Vector) -> float:
    """Relative to the largest component."""
    return float(np.abs(np.array(list(found)) - expected).max() / np.abs(expected).max())


@ARMATURES
@pytest.mark.parametrize("seed", STATES)
def test_forward_and_inverse_dynamics_agree_with_pinocchio(seed: int, armature: float) -> None:
    state = State(seed, armature)
    oracle = PinocchioDelta(state.parameters, state.payload)
    q = oracle.configuration(state.theta, state.point)
    assert oracle.closure_error(q) < 1e-12
    v = oracle.velocity(q, state.rate)
    joints, platform = oracle.forward(q, v, state.torque, np.zeros(3))

    motion = state.kernel()
    assert difference(motion.point_d, v[oracle.point]) < 1e-10
    assert difference(motion.theta_dd, joints) < 1e-10
    assert difference(motion.point_dd, platform) < 1e-10

    lib.dph_inverse_dynamics(state.robot.struct, state.payload, motion)
    assert difference(motion.torque, oracle.inverse(q, v, joints)) < 1e-10


@ARMATURES
@pytest.mark.parametrize("seed", STATES)
def test_forward_dynamics_agrees_with_mujocos_matrices(seed: int, armature: float) -> None:
    state = State(seed, armature)
    oracle = MujocoDelta(state.parameters, state.payload)
    oracle.set_state(state.theta, state.point, state.rate)
    joints, platform = oracle.forward(state.torque, np.zeros(3))
    motion = state.kernel()
    assert difference(motion.theta_dd, joints) < 1e-8
    assert difference(motion.point_dd, platform) < 1e-8


@pytest.mark.parametrize("seed", STATES)
def test_another_robot_agrees_with_both_engines(seed: int) -> None:
    state = State(seed, 0.0, load_scenario(SCENARIOS / "rl5.toml").robot, height=-1.05)
    motion = state.kernel()
    pinocchio, mujoco = PinocchioDelta(state.parameters, state.payload), MujocoDelta(state.parameters, state.payload)
    q = pinocchio.configuration(state.theta, state.point)
    mujoco.set_state(state.theta, state.point, state.rate)
    joints, _ = pinocchio.forward(q, pinocchio.velocity(q, state.rate), state.torque, np.zeros(3))
    assert difference(motion.theta_dd, joints) < 1e-10
    assert difference(motion.theta_dd, mujoco.forward(state.torque, np.zeros(3))[0]) < 1e-8


def torque_at(t: float) -> Vector:
    """Torques [N m] that hold the robot about, and shake it."""
    return np.array([-3.0 + 8.0 * np.sin(20.0 * t), -3.0 + 6.0 * np.sin(25.0 * t + 1.0), -2.5 - 7.0 * np.sin(15.0 * t)])


def kernel_trajectory(robot: Robot, payload: float, theta: Vector, duration: float, step: float) -> Vector:
    """Joint angles (3) after a time, by RK4 with the kernel's forward dynamics."""
    rate = np.zeros(3)

    def acceleration(t: float, theta: Vector, rate: Vector) -> Vector:
        motion = ffi.new("dph_motion *", {"theta": theta.tolist(), "theta_d": rate.tolist(), "torque": torque_at(t).tolist()})
        assert lib.dph_forward_dynamics(robot.struct, payload, motion)
        return np.array(list(motion.theta_dd))

    for k in range(round(duration / step)):
        t = k * step
        a1 = acceleration(t, theta, rate)
        v2 = rate + step / 2 * a1
        a2 = acceleration(t + step / 2, theta + step / 2 * rate, v2)
        v3 = rate + step / 2 * a2
        a3 = acceleration(t + step / 2, theta + step / 2 * v2, v3)
        v4 = rate + step * a3
        a4 = acceleration(t + step, theta + step * v3, v4)
        theta = theta + step / 6 * (rate + 2 * v2 + 2 * v3 + v4)
        rate = rate + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return theta


def test_a_trajectory_of_mujoco_converges_to_the_kernels() -> None:
    state = State(0, 0.0724)
    duration, point = 0.3, np.array([0.05, -0.08, -0.8])
    start = state.robot.inverse_kinematics(point)
    expected = kernel_trajectory(state.robot, 0.5, start, duration, 5e-4)
    assert np.abs(expected - start).max() > 0.3
    errors = []
    for step in (4e-4, 1e-4, 5e-5):
        oracle = MujocoDelta(state.parameters, 0.5, step)
        oracle.set_state(start, point, np.zeros(3))
        errors.append(float(np.abs(oracle.trajectory(torque_at, duration) - expected).max()))
    # of first order: a quarter of the step, a quarter of the difference
    assert errors[0] < 5e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("seed", STATES)
def test_a_force_on_the_platform_acts_as_in_pinocchio(seed: int) -> None:
    state, force = State(seed, 0.0724), np.random.default_rng(seed).uniform(-50.0, 50.0, 3)
    oracle = PinocchioDelta(state.parameters, state.payload)
    q = oracle.configuration(state.theta, state.point)
    joints, platform = oracle.forward(q, oracle.velocity(q, state.rate), state.torque, force)
    motion = state.kernel(force)
    assert difference(motion.theta_dd, joints) < 1e-10
    assert difference(motion.point_dd, platform) < 1e-10
    lib.dph_inverse_dynamics(state.robot.struct, state.payload, motion)
    assert difference(motion.torque, state.torque) < 1e-10


@pytest.mark.parametrize("seed", STATES)
def test_a_mass_taken_up_in_motion_keeps_the_momentum(seed: int) -> None:
    state, taken_up = State(seed, 0.0724), 1.5
    oracle = PinocchioDelta(state.parameters, state.payload)
    q = oracle.configuration(state.theta, state.point)
    after = oracle.impact(q, oracle.velocity(q, state.rate), taken_up)
    motion = state.kernel()
    assert lib.dph_take_up(state.robot.struct, state.payload, taken_up, motion)
    assert difference(motion.theta_d, after[oracle.theta]) < 1e-10
