"""The true mechanism in MuJoCo: three hinges, six rods on ball joints, a free platform, six closures. Built in code.

MuJoCo's own accelerations soften the closures; its mass matrix, bias force and Jacobians are exact, so that they are solved here
without softness. A trajectory that MuJoCo integrates itself is of first order in the step and converges to the rigid one.
"""

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

GRAVITY = 9.80665
HALF_SPACING = 0.05
ROD_AXIAL_INERTIA = 3.6e-6
STIFFEST = 0.9999
"""Impedance of the closures: the greatest that MuJoCo takes."""


def _turn_z(angle: float) -> Vector:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _quaternion(turn: Vector) -> Vector:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, turn.ravel())
    return quaternion


def _turned_to(direction: Vector) -> Vector:
    """A rotation (3, 3) whose first axis is this unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.column_stack([direction, second, np.cross(direction, second)])


class MujocoDelta:
    """The mechanism of one robot with one payload.

    Attributes:
        model: MuJoCo's.
        data: its state.
    """

    def __init__(self, robot: Mapping[str, float], payload: float, step: float = 1e-4) -> None:
        """Build it.

        Args:
            robot: parameters as in fmu_src/robot.toml, without `robot.`, SI.
            payload: at the platform's reference point [kg].
            step: of MuJoCo's integrator [s].
        """
        self._robot = robot
        spec: Any = mujoco.MjSpec()
        spec.option.gravity = [0.0, 0.0, -GRAVITY]
        spec.option.timestep = step
        spec.option.iterations, spec.option.tolerance = 100, 0.0
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        upper, forearm = robot["upper_arm_length"], robot["forearm_length"]
        plate = spec.worldbody.add_body(name="platform")
        plate.add_freejoint(name="platform")
        plate.mass, plate.inertia = robot["platform_mass"] + payload, [1e-3] * 3
        plate.explicitinertial = True
        self._ends: list[tuple[str, Vector]] = []
        for i in range(3):
            turn = _turn_z(2.0 * np.pi / 3.0 * i)
            shoulder = turn @ np.array([robot["base_radius"], 0.0, 0.0])
            arm = spec.worldbody.add_body(name=f"arm{i}", pos=shoulder, quat=_quaternion(turn))
            arm.add_joint(name=f"hinge{i}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0], armature=robot["drive_inertia"])
            mass, centre = robot["upper_arm_mass"], robot["upper_arm_com"]
            arm.mass, arm.ipos, arm.explicitinertial = mass, [centre, 0.0, 0.0], True
            arm.inertia = [robot["upper_arm_inertia"] - mass * centre**2] * 3
            for k, side in enumerate((-HALF_SPACING, HALF_SPACING)):
                name = f"rod{i}{k}"
                rod = arm.add_body(name=name, pos=[upper, side, 0.0])
                rod.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_BALL)
                rod.mass, rod.ipos, rod.explicitinertial = robot["forearm_mass"] / 2.0, [forearm / 2.0, 0.0, 0.0], True
                rod.inertia = [ROD_AXIAL_INERTIA, robot["forearm_inertia"] / 2.0, robot["forearm_inertia"] / 2.0]
                point = turn @ np.array([robot["platform_radius"], side, 0.0])
                self._ends.append((name, point))
                spec.body(name).add_site(name=f"{name}_end", pos=[forearm, 0.0, 0.0])
                plate.add_site(name=f"{name}_place", pos=point)
                spec.add_equality(
                    type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=f"{name}_end", name2=f"{name}_place",
                    solref=[2.0 * step, 1.0], solimp=[STIFFEST, STIFFEST, 0.001, 0.5, 2.0],
                )  # fmt: skip
        self.model: Any = spec.compile()
        self.data: Any = mujoco.MjData(self.model)
        self._theta = np.array([self.model.joint(f"hinge{i}").dofadr[0] for i in range(3)])
        self._point = self.model.joint("platform").dofadr[0] + np.arange(3)

    def _sides(self) -> list[tuple[int, str, int]]:
        return [(sign, f"{name}_{what}", i) for i, (name, _) in enumerate(self._ends) for sign, what in ((1, "end"), (-1, "place"))]

    def _closures(self, *, rate: bool) -> Vector:
        """Jacobian of the closures (18, 27), or its time derivative."""
        result, jacobian = np.zeros((3 * len(self._ends), self.model.nv)), np.empty((3, self.model.nv))
        function = mujoco.mj_jacDot if rate else mujoco.mj_jac
        for sign, site, i in self._sides():
            body, place = self.model.site(site).bodyid[0], self.data.site(site).xpos
            function(self.model, self.data, jacobian, None, place, body)
            result[3 * i : 3 * i + 3] += sign * jacobian
        return result

    def set_state(self, theta: Vector, point: Vector, rate: Vector) -> None:
        """Take a joint state (3) [rad], (3) [rad/s] with its platform position (3) [m]; no rod spins about its own axis."""
        qpos = self.data.qpos
        start = self.model.joint("platform").qposadr[0]
        qpos[start : start + 7] = [*point, 1.0, 0.0, 0.0, 0.0]
        rods: list[tuple[int, int, Vector]] = []
        for i in range(3):
            qpos[self.model.joint(f"hinge{i}").qposadr[0]] = theta[i]
            c, s = np.cos(theta[i]), np.sin(theta[i])
            turn, bend = _turn_z(2.0 * np.pi / 3.0 * i), np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
            elbow = turn @ (np.array([self._robot["base_radius"], 0, 0]) + bend @ np.array([self._robot["upper_arm_length"], 0, 0]))
            rod = bend.T @ turn.T @ (point + turn @ np.array([self._robot["platform_radius"], 0.0, 0.0]) - elbow)
            place = _turned_to(rod / np.linalg.norm(rod))
            for k in range(2):
                joint = self.model.joint(f"rod{i}{k}")
                qpos[joint.qposadr[0] : joint.qposadr[0] + 4] = _quaternion(place)
                rods.append((i, joint.dofadr[0], place[:, 0]))
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        picks = np.zeros((9, self.model.nv))
        for i, hinge in enumerate(self._theta):
            picks[i, hinge] = 1.0
        for row, (i, dof, axis) in enumerate(rods, start=3):
            picks[row, dof], picks[row, self._theta[i]] = 1.0, axis[1]
        right = np.concatenate([np.zeros(3 * len(self._ends)), rate, np.zeros(6)])
        self.data.qvel[:] = np.linalg.lstsq(np.vstack([self._closures(rate=False), picks]), right, rcond=None)[0]
        mujoco.mj_forward(self.model, self.data)

    def forward(self, torque: Vector, force: Vector) -> tuple[Vector, Vector]:
        """Accelerations of joints (3) and platform (3) at the state, the closures solved exactly."""
        n, closures = self.model.nv, self._closures(rate=False)
        mass = np.empty((n, n))
        mujoco.mj_fullM(self.model, self.data, mass)
        effort = -np.array(self.data.qfrc_bias)
        effort[self._theta] += torque
        effort[self._point] += force
        gamma = self._closures(rate=True) @ self.data.qvel
        system = np.block([[mass, closures.T], [closures, np.zeros((len(closures),) * 2)]])
        solution = np.linalg.solve(system, np.concatenate([effort, -gamma]))
        return solution[self._theta], solution[self._point]

    def trajectory(self, torque: Callable[[float], Vector], duration: float) -> Vector:
        """Joint angles (3) [rad] after a time [s] under torques (3) [N m] of time, as MuJoCo integrates them."""
        step = self.model.opt.timestep
        for k in range(round(duration / step)):
            self.data.qfrc_applied[self._theta] = torque((k + 0.5) * step)
            mujoco.mj_step(self.model, self.data)
        return np.array([self.data.joint(f"hinge{i}").qpos[0] for i in range(3)])
