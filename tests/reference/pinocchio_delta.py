"""The true mechanism in Pinocchio: three hinges, six rods on ball joints, a free platform (27 velocities), 18 closure conditions.

Nothing of the usual reduction is in here, so that this also checks that the platform does not turn and that a pair of rods
moves as one. Built in code; constraint dynamics is Pinocchio's own, inverse dynamics and impacts solve its matrices exactly.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Vector = NDArray[np.float64]

GRAVITY = 9.80665
HALF_SPACING = 0.05
"""Half the distance of the two rods of a pair [m]; nothing depends on it."""

ROD_AXIAL_INERTIA = 3.6e-6
"""Of one rod [kg m^2]; nothing depends on it, for rods that do not spin never begin to."""

PROXIMAL_MU, PROXIMAL_ITERATIONS = 1e-10, 10
"""The 18 conditions are independent: a few iterations of the proximal solver end at rounding."""


def _turned_to(direction: Vector) -> Vector:
    """A rotation (3, 3) whose first axis is this unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.column_stack([direction, second, np.cross(direction, second)])


class PinocchioDelta:
    """The mechanism of one robot with one payload.

    Attributes:
        model: Pinocchio's; velocities are three hinges with two rods each, then the platform.
    """

    def __init__(self, robot: Mapping[str, float], payload: float) -> None:
        """Build it.

        Args:
            robot: parameters as in fmu_src/robot.toml, without `robot.`, SI.
            payload: at the platform's reference point [kg].
        """
        self._robot = robot
        upper, forearm = robot["upper_arm_length"], robot["forearm_length"]
        self.model: Any = pin.Model()
        self.model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
        self._hinges: list[int] = []
        self._rods: list[int] = []
        ends: list[tuple[int, Vector]] = []
        for i in range(3):
            turn = pin.utils.rotate("z", 2.0 * np.pi / 3.0 * i)
            shoulder = pin.SE3(turn, turn @ np.array([robot["base_radius"], 0.0, 0.0]))
            hinge = self.model.addJoint(0, pin.JointModelRY(), shoulder, f"hinge{i}")
            mass, centre = robot["upper_arm_mass"], robot["upper_arm_com"]
            central = robot["upper_arm_inertia"] - mass * centre**2
            body = pin.Inertia(mass, np.array([centre, 0.0, 0.0]), central * np.eye(3))
            self.model.appendBodyToJoint(hinge, body, pin.SE3.Identity())
            self._hinges.append(hinge)
            for side in (-HALF_SPACING, HALF_SPACING):
                elbow = pin.SE3(np.eye(3), np.array([upper, side, 0.0]))
                rod = self.model.addJoint(hinge, pin.JointModelSpherical(), elbow, f"rod{i}{side:+}")
                across = robot["forearm_inertia"] / 2.0
                inertia = np.diag([ROD_AXIAL_INERTIA, across, across])
                rods = pin.Inertia(robot["forearm_mass"] / 2.0, np.array([forearm / 2.0, 0.0, 0.0]), inertia)
                self.model.appendBodyToJoint(rod, rods, pin.SE3.Identity())
                self._rods.append(rod)
                ends.append((rod, turn @ np.array([robot["platform_radius"], side, 0.0])))
        self._platform = self.model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
        plate = pin.Inertia(robot["platform_mass"] + payload, np.zeros(3), 1e-3 * np.eye(3))
        self.model.appendBodyToJoint(self._platform, plate, pin.SE3.Identity())

        self._data: Any = self.model.createData()
        self._constraints: Any = pin.StdVec_RigidConstraintModel()
        self._constraint_data: Any = pin.StdVec_RigidConstraintData()
        for rod, point in ends:
            rod_end = pin.SE3(np.eye(3), np.array([forearm, 0.0, 0.0]))
            closure = pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D, self.model, rod, rod_end, self._platform, pin.SE3(np.eye(3), point), pin.LOCAL
            )
            self._constraints.append(closure)
            self._constraint_data.append(closure.createData())
        self.theta = np.array([self.model.joints[j].idx_v for j in self._hinges])
        """Places of the hinges among the velocities."""
        self.point = self.model.joints[self._platform].idx_v + np.arange(3)
        """Places of the platform's velocity among the velocities."""
        self.model.armature[self.theta] = robot["drive_inertia"]

    def configuration(self, theta: Vector, point: Vector) -> Vector:
        """Configuration for joint angles (3) [rad] and a platform position (3) [m] that belong together."""
        q = pin.neutral(self.model)
        for i, hinge in enumerate(self._hinges):
            q[self.model.joints[hinge].idx_q] = theta[i]
            turn = pin.utils.rotate("z", 2.0 * np.pi / 3.0 * i)
            arm = turn @ pin.utils.rotate("y", theta[i])
            elbow = turn @ np.array([self._robot["base_radius"], 0.0, 0.0]) + arm @ np.array(
                [self._robot["upper_arm_length"], 0, 0]
            )
            rod = arm.T @ (point + turn @ np.array([self._robot["platform_radius"], 0.0, 0.0]) - elbow)
            place = pin.Quaternion(_turned_to(rod / np.linalg.norm(rod))).coeffs()
            for joint in self._rods[2 * i : 2 * i + 2]:
                start = self.model.joints[joint].idx_q
                q[start : start + 4] = place
        start = self.model.joints[self._platform].idx_q
        q[start : start + 3] = point
        return np.asarray(q)

    def closure_error(self, q: Vector) -> float:
        """Largest distance between a rod's end and its place on the platform [m]."""
        pin.forwardKinematics(self.model, self._data, q)
        gaps = []
        for c in self._constraints:
            one, two = self._data.oMi[c.joint1_id] * c.joint1_placement, self._data.oMi[c.joint2_id] * c.joint2_placement
            gaps.append(np.linalg.norm(one.translation - two.translation))
        return float(max(gaps))

    def _jacobian(self, q: Vector) -> Vector:
        """Closure Jacobian (18, 27)."""
        pin.computeJointJacobians(self.model, self._data, q)

        def row(joint: int, placement: Any) -> Vector:
            """Velocity of a point fixed to a joint (3, 27), in the world."""
            motion = pin.getJointJacobian(self.model, self._data, joint, pin.LOCAL_WORLD_ALIGNED)
            lever = self._data.oMi[joint].rotation @ placement.translation
            return np.asarray(motion[:3] - pin.skew(lever) @ motion[3:])

        rows = [row(c.joint1_id, c.joint1_placement) - row(c.joint2_id, c.joint2_placement) for c in self._constraints]
        return np.vstack(rows)

    def velocity(self, q: Vector, rate: Vector) -> Vector:
        """Velocities (27) that go with joint velocities (3) [rad/s] while no rod spins about its own axis."""
        rows = [self._jacobian(q)]
        right = [np.zeros(len(rows[0]))]
        for i, hinge in enumerate(self.theta):
            pick = np.zeros((3, self.model.nv))
            pick[0, hinge] = 1.0
            for row, joint in enumerate(self._rods[2 * i : 2 * i + 2], start=1):
                start_q, start_v = self.model.joints[joint].idx_q, self.model.joints[joint].idx_v
                axis = pin.Quaternion(np.array(q[start_q : start_q + 4])).matrix()[:, 0]  # in the arm's frame
                pick[row, start_v] = 1.0
                pick[row, hinge] = axis[1]  # the arm itself turns about its y axis
            rows.append(pick)
            right.append(np.array([rate[i], 0.0, 0.0]))
        solution, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)
        return np.asarray(solution)

    def forward(self, q: Vector, v: Vector, torque: Vector, force: Vector) -> tuple[Vector, Vector]:
        """Accelerations of joints (3) [rad/s^2] and platform (3) [m/s^2] under joint torques (3) and a platform force (3)."""
        effort = np.zeros(self.model.nv)
        effort[self.theta], effort[self.point] = torque, force
        pin.initConstraintDynamics(self.model, self._data, self._constraints, self._constraint_data)
        settings = pin.ProximalSettings(1e-14, PROXIMAL_MU, PROXIMAL_ITERATIONS)
        a = pin.constraintDynamics(self.model, self._data, q, v, effort, self._constraints, self._constraint_data, settings)
        # the platform does not turn: its own frame is the world's
        return np.asarray(a[self.theta]).copy(), np.asarray(a[self.point]).copy()

    def inverse(self, q: Vector, v: Vector, acceleration: Vector) -> Vector:
        """Joint torques (3) [N m] for joint accelerations (3) [rad/s^2].

        Of all accelerations those are wanted that keep the closures: a = a_free + B (theta'' - theta''_free), where B moves the
        mechanism like `velocity` does and a_free comes from constraint dynamics without torque.
        """
        pin.initConstraintDynamics(self.model, self._data, self._constraints, self._constraint_data)
        settings = pin.ProximalSettings(1e-14, PROXIMAL_MU, PROXIMAL_ITERATIONS)
        rest = np.zeros(self.model.nv)
        free = np.array(
            pin.constraintDynamics(self.model, self._data, q, v, rest, self._constraints, self._constraint_data, settings)
        )
        a = free + self.velocity(q, acceleration - free[self.theta])
        effort = np.asarray(pin.rnea(self.model, self._data, q, v, a))  # with armature
        jacobian = self._jacobian(q)
        actuation = np.zeros((self.model.nv, 3))
        actuation[self.theta, range(3)] = 1.0
        solution, *_ = np.linalg.lstsq(np.hstack([actuation, jacobian.T]), effort, rcond=None)
        return np.asarray(solution[:3])

    def _mass(self, q: Vector) -> Vector:
        upper = np.triu(pin.crba(self.model, self._data, q))
        return np.asarray(upper + np.triu(upper, 1).T)

    def energy(self, q: Vector, v: Vector) -> float:
        """Kinetic and potential energy [J]."""
        return float(v @ self._mass(q) @ v / 2.0 + pin.computePotentialEnergy(self.model, self._data, q))

    def impact(self, q: Vector, v: Vector, taken_up: float) -> Vector:
        """Velocities (27) just after the platform has taken up a mass [kg] that was at rest: momentum under the closures."""
        mass, jacobian = self._mass(q), self._jacobian(q)
        after = mass.copy()
        after[self.point, self.point] += taken_up
        n = len(jacobian)
        system = np.block([[after, jacobian.T], [jacobian, np.zeros((n, n))]])
        return np.asarray(np.linalg.solve(system, np.concatenate([mass @ v, np.zeros(n)]))[: len(v)])
