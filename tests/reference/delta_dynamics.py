"""Dynamics of the Delta robot by virtual work (d'Alembert) on an equivalent system of point masses.

Each rigid body is replaced by points with the same mass, centre and inertia: the upper arm and each
forearm pair by two equal points at their centre +- the radius of gyration (a rod has no inertia about its
own axis and carries no spin), the platform with its payload by one. Accelerations are Taylor coefficients
in time.
"""

from collections.abc import Sequence

from .delta import (
    UNITS,
    Motion,
    Robot,
    arm_point,
    at_rest,
    forward,
    inverse,
    rates_per_position,
    rod_end,
    subtract,
)
from .precision import Number, Vector, combine, dot, mp, square_root
from .taylor import Taylor

MassPoint = tuple[Number, Motion]  # (mass [kg], position)


def _forearm_fractions(robot: Robot) -> tuple[Number, Number]:
    """Places of a rod's two points (0 at the elbow, 1 at the platform): centre +- radius of gyration."""
    gyration = square_root(robot.forearm_inertia / robot.forearm_mass) / robot.forearm_length
    half = gyration * 0 + 0.5
    return half - gyration, half + gyration


def _upper_arm_distances(robot: Robot) -> tuple[Number, Number]:
    """Distances of the upper arm's two points from the shoulder [m]."""
    centre = robot.upper_arm_centre
    gyration = square_root(robot.upper_arm_inertia / robot.upper_arm_mass - centre**2)
    return centre - gyration, centre + gyration


def mass_points(robot: Robot, payload: Number, position: Motion, angles: Motion) -> list[MassPoint]:
    """All points (13) of the robot for a platform position and joint angles, taken as independent."""
    points: list[MassPoint] = [(robot.platform_mass + payload, position)]
    for u, angle in zip(robot.directions, angles, strict=True):
        half = robot.upper_arm_mass / 2
        points.extend((half, arm_point(robot, u, angle, a)) for a in _upper_arm_distances(robot))
        elbow = arm_point(robot, u, angle, robot.upper_arm_length)
        rod = subtract(rod_end(robot, u, position), elbow)
        for fraction in _forearm_fractions(robot):
            point = (elbow[0] + rod[0] * fraction, elbow[1] + rod[1] * fraction, elbow[2] + rod[2] * fraction)
            points.append((robot.forearm_mass / 2, point))
    return points


def _virtual_work(robot: Robot, moving: Sequence[MassPoint], varied: Sequence[MassPoint]) -> Number:
    """Work sum m (a + g k) . dr over the points; `varied` holds dr as its first-order coefficients."""
    work: Number = 0
    for (mass, point), (_, variation) in zip(moving, varied, strict=True):
        force = [mass * x.derivative(2) for x in point]
        force[2] = force[2] + mass * robot.gravity
        work = work + dot(force, [x.coefficients[1] for x in variation])
    return work


def _vary(value: Sequence[Number], k: int) -> Motion:
    """A series that moves coordinate k of a vector (3) at unit rate."""
    varied = at_rest(value, order=1)
    varied[k].coefficients[1] = varied[k].coefficients[1] + 1
    return varied


def _values(motion: Motion) -> list[Number]:
    return [x.coefficients[0] for x in motion]


def joint_torque(robot: Robot, payload: Number, position: Motion) -> Vector:
    """Joint torques (3) [N m] along a platform motion (series of order >= 2), rigid robot, no friction.

    The platform coordinates p_k are the virtual displacements, theta follows by inverse kinematics:
    sum_i tau_i dtheta_i/dp_k = sum m (a + g k) . dr/dp_k + J_drive sum_i theta_i'' dtheta_i/dp_k.
    """
    angles = inverse(robot, position)
    moving = mass_points(robot, payload, position, angles)
    rows = []  # (dtheta/dp_k, virtual work per dp_k)
    for k in range(3):
        moved = _vary(_values(position), k)
        moved_angles = inverse(robot, moved)
        rates = [angle.coefficients[1] for angle in moved_angles]
        work = _virtual_work(robot, moving, mass_points(robot, payload, moved, moved_angles))
        work = work + robot.drive_inertia * dot([angle.derivative(2) for angle in angles], rates)
        rows.append((rates, work))
    columns = [[rates[i] for rates, _ in rows] for i in range(3)]
    return combine(columns, [work for _, work in rows])


def rod_multipliers(robot: Robot, payload: Number, position: Motion) -> Vector:
    """Lagrange multipliers lambda_i (3) [N/m] of phi_i = (|s_i|^2 - l^2) / 2, positive in tension.

    Virtual displacements of the platform with the arms held: sum_i lambda_i s_i = -sum m (a + g k) . dr/dp_k.
    """
    angles = inverse(robot, position)
    moving = mass_points(robot, payload, position, angles)
    held = at_rest(_values(angles), order=1)
    right = []
    for k in range(3):
        varied = mass_points(robot, payload, _vary(_values(position), k), held)
        right.append(-_virtual_work(robot, moving, varied))
    return combine([_values(rod) for rod in _rods(robot, position, angles)], right)


def torque_from_multipliers(robot: Robot, payload: Number, position: Motion) -> Vector:
    """Joint torques (3) [N m] by a second route: arms moved with the platform held, rods cut at both ends.

    tau_i = sum m (a + g k) . dr/dtheta_i + J_drive theta_i'' - lambda_i s_i . dE_i/dtheta_i.
    """
    angles = inverse(robot, position)
    moving = mass_points(robot, payload, position, angles)
    held = at_rest(_values(position), order=1)
    multipliers = rod_multipliers(robot, payload, position)
    torques = []
    for i in range(3):
        turned = _vary(_values(angles), i)
        work = _virtual_work(robot, moving, mass_points(robot, payload, held, turned))
        elbow = arm_point(robot, robot.directions[i], turned[i], robot.upper_arm_length)
        rod = _values(_rods(robot, position, angles)[i])
        pull = dot(rod, [x.coefficients[1] for x in elbow])
        torques.append(work + robot.drive_inertia * angles[i].derivative(2) - multipliers[i] * pull)
    return torques[0], torques[1], torques[2]


def _rods(robot: Robot, position: Motion, angles: Motion) -> list[Motion]:
    """Forearm vectors s_i from elbow to platform."""
    return [
        subtract(rod_end(robot, u, position), arm_point(robot, u, angle, robot.upper_arm_length))
        for u, angle in zip(robot.directions, angles, strict=True)
    ]


def kinetic_energy(robot: Robot, payload: Number, position: Motion) -> Number:
    """Kinetic energy [J] of the points and drives along a platform motion (series of order >= 1)."""
    angles = inverse(robot, position)
    energy: Number = sum(robot.drive_inertia * angle.coefficients[1] ** 2 / 2 for angle in angles)
    for mass, point in mass_points(robot, payload, position, angles):
        energy = energy + mass * sum(x.coefficients[1] ** 2 for x in point) / 2
    return energy


def potential_energy(robot: Robot, payload: Number, position: Motion) -> Number:
    """Potential energy [J] in gravity, zero at the plane of the shoulder axes."""
    points = mass_points(robot, payload, position, inverse(robot, position))
    return robot.gravity * sum(mass * point[2].coefficients[0] for mass, point in points)


def motion(position: Sequence[Number], velocity: Sequence[Number], acceleration: Sequence[Number]) -> Motion:
    """The platform series p + v t + a t^2 / 2 from three vectors (3)."""
    terms = zip(position, velocity, acceleration, strict=True)
    x, y, z = (Taylor([p, v, mp.mpf(a) / 2]) for p, v, a in terms)
    return x, y, z


def forward_dynamics(
    robot: Robot,
    payload: Number,
    angles: Sequence[Number],
    rates: Sequence[Number],
    torques: Sequence[Number],
) -> Motion:
    """Platform motion (series of order 2) caused by torques (3) [N m] in a joint state (3) [rad], [rad/s].

    The torque is affine in the platform acceleration: four inverse dynamics give the equation to solve. The
    joint acceleration is the second derivative of the inverse kinematics of the returned motion.
    """
    position = forward(robot, angles)
    # d theta = sum_k (d theta / d p_k) d p_k
    velocity = combine(rates_per_position(robot, position), rates)
    still = joint_torque(robot, payload, motion(position, velocity, (0, 0, 0)))
    columns = []
    for unit in UNITS:
        pushed = joint_torque(robot, payload, motion(position, velocity, unit))
        columns.append([a - b for a, b in zip(pushed, still, strict=True)])
    acceleration = combine(columns, [t - s for t, s in zip(torques, still, strict=True)])
    return motion(position, velocity, acceleration)
