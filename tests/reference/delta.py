"""Kinematics of the Delta robot from its loop closure |p + r u_i - E_i(theta_i)|^2 = l^2, i = 1, 2, 3.

Base frame: origin in the plane of the shoulder axes, z up, arm 1 towards +x, arms at 0, 120, 240 degrees.
Joint angles from horizontal, positive downwards; the elbows point outwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .precision import Number, Vector, arctangent2, combine, cosine, mp, resolution, sine
from .taylor import Taylor

Motion = tuple[Taylor, Taylor, Taylor]  # a position [m] or three joint angles [rad] as series of time
Direction = tuple[Number, Number]  # horizontal (x, y)
UNITS: tuple[Vector, Vector, Vector] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


@dataclass(frozen=True)
class Robot:
    """Geometry [m], masses [kg] and inertias [kg m^2]; the forearm values are those of a leg's pair of rods.

    `upper_arm_inertia` is about the shoulder axis, `forearm_inertia` transverse about the pair's centre,
    `drive_inertia` that of rotor and gear reflected to the joint; `gravity` in m/s^2.
    """

    base_radius: Number
    platform_radius: Number
    upper_arm_length: Number
    forearm_length: Number
    upper_arm_mass: Number
    upper_arm_centre: Number
    upper_arm_inertia: Number
    forearm_mass: Number
    forearm_inertia: Number
    platform_mass: Number
    drive_inertia: Number
    gravity: Number
    arm_angles: Vector = (mp.mpf(0), 2 * mp.pi / 3, 4 * mp.pi / 3)

    @property
    def directions(self) -> tuple[Direction, Direction, Direction]:
        """Horizontal unit vectors u_i of the arms (3, 2)."""
        first, second, third = ((cosine(a), sine(a)) for a in self.arm_angles)
        return first, second, third


def arm_point(robot: Robot, direction: Direction, angle: Taylor, distance: Number) -> Motion:
    """Point of an upper arm at a distance [m] from the shoulder, on the line to the elbow."""
    s, c = angle.sine_cosine()
    radius = c * distance + robot.base_radius
    return radius * direction[0], radius * direction[1], -s * distance


def rod_end(robot: Robot, direction: Direction, position: Motion) -> Motion:
    """Where a forearm meets the platform, p + r u_i."""
    r = robot.platform_radius
    return position[0] + direction[0] * r, position[1] + direction[1] * r, position[2]


def subtract(a: Motion, b: Motion) -> Motion:
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def square(a: Motion) -> Taylor:
    """Squared length."""
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


def joint_angle(robot: Robot, direction: Direction, position: Motion) -> Taylor:
    """One joint angle [rad]: Newton's method on the loop closure, first its value, then its series.

    |Q - E(theta)|^2 - l^2 is a sinusoid of theta, smallest where the arm points at Q. The root with the
    elbow outwards lies in the half period before it; started from the inflection there, Newton converges
    monotonically.
    """
    end = rod_end(robot, direction, position)
    order = position[0].order

    def closure(angle: Taylor) -> Taylor:
        elbow = arm_point(robot, direction, angle, robot.upper_arm_length)
        gap: Taylor = square(subtract(end, elbow)) - robot.forearm_length**2
        return gap

    def slope(angle: Taylor) -> Taylor:
        """Slope d closure / d theta = -2 (Q - E) . dE/dtheta."""
        s, c = angle.sine_cosine()
        elbow = arm_point(robot, direction, angle, robot.upper_arm_length)
        gap = subtract(end, elbow)
        across = gap[0] * direction[0] + gap[1] * direction[1]
        result: Taylor = (across * s + gap[2] * c) * (2 * robot.upper_arm_length)
        return result

    outward = end[0].coefficients[0] * direction[0] + end[1].coefficients[0] * direction[1]
    towards = arctangent2(-end[2].coefficients[0], outward - robot.base_radius)
    angle = towards - arctangent2(towards * 0 + 1, towards * 0)
    for _ in range(100):
        trial = Taylor.constant(angle, order)
        step = closure(trial).coefficients[0] / slope(trial).coefficients[0]
        angle = angle - step
        if np.max(np.abs(step)) < resolution(step):
            break
    else:
        raise ValueError("position out of reach")
    series = Taylor.constant(angle, order)
    for _ in range(order.bit_length()):  # each step doubles the number of right coefficients
        series = series - closure(series) / slope(series)
    return series


def inverse(robot: Robot, position: Motion) -> Motion:
    """Joint angles [rad] along a motion of the platform, as series of the same order."""
    first, second, third = (joint_angle(robot, u, position) for u in robot.directions)
    return first, second, third


def at_rest(position: Sequence[Number], order: int = 0) -> Motion:
    """A platform position (3) [m] as a constant series."""
    return (
        Taylor.constant(position[0], order),
        Taylor.constant(position[1], order),
        Taylor.constant(position[2], order),
    )


def forward(robot: Robot, angles: Sequence[Number]) -> Vector:
    """Platform position (3) [m] below the elbows for joint angles (3) [rad], by root finding."""
    arms = zip(robot.directions, angles, strict=True)
    elbows = [arm_point(robot, u, Taylor([angle]), robot.upper_arm_length) for u, angle in arms]

    def closures(x: Number, y: Number, z: Number) -> list[Number]:
        platform = at_rest((x, y, z))
        ends = [rod_end(robot, u, platform) for u in robot.directions]
        rods = [subtract(end, elbow) for end, elbow in zip(ends, elbows, strict=True)]
        return [square(rod).coefficients[0] - robot.forearm_length**2 for rod in rods]

    lowest = min(elbow[2].coefficients[0] for elbow in elbows)
    start = (mp.mpf(0), mp.mpf(0), lowest - mp.mpf("0.9") * robot.forearm_length)
    x, y, z = mp.findroot(closures, start, tol=mp.mpf(10) ** (2 * (8 - mp.dps)))
    if z > lowest:
        raise ValueError("forward kinematics found the assembly above the elbows")
    return x, y, z


def rates_per_position(robot: Robot, position: Sequence[Number]) -> tuple[Vector, Vector, Vector]:
    """Columns d theta / d p_k (3, 3) [rad/m] from the series of the inverse along each axis."""
    columns = []
    for k in range(3):
        moved = at_rest(position, order=1)
        moved[k].coefficients[1] = moved[k].coefficients[1] + 1
        first, second, third = (angle.coefficients[1] for angle in inverse(robot, moved))
        columns.append((first, second, third))
    return columns[0], columns[1], columns[2]


def jacobian(robot: Robot, position: Sequence[Number]) -> tuple[Vector, Vector, Vector]:
    """Columns d p / d theta_i (3, 3) [m/rad]: the inverse of d theta / d p."""
    columns = rates_per_position(robot, position)
    first, second, third = (combine(columns, unit) for unit in UNITS)
    return first, second, third
