"""The reference against itself: kinematics and dynamics of the Delta robot."""

import dataclasses

import pytest
from reference import golden
from reference.delta import Robot, at_rest, forward, inverse, jacobian, rod_end
from reference.delta_dynamics import (
    forward_dynamics,
    joint_torque,
    kinetic_energy,
    motion,
    potential_energy,
    rod_multipliers,
    torque_from_multipliers,
)
from reference.precision import Number, agree, mp
from reference.taylor import Taylor

STATES = golden.load("mechanism.toml")["state"]
SOME_STATES = ["s01", "s05", "s06"]
ROBOT: Robot = golden.robot(golden.load("cases.toml"))


def state_motion(name: str) -> tuple[Taylor, Taylor, Taylor]:
    state = STATES[name]
    return motion(state["position"], state["velocity"], state["acceleration"])


# Kinematics


@pytest.mark.parametrize("name", STATES)
def test_forward_and_inverse_kinematics_undo_each_other(name: str) -> None:
    p = STATES[name]["position"]
    angles = [s.coefficients[0] for s in inverse(ROBOT, at_rest(p))]
    assert all(agree(a, b) for a, b in zip(forward(ROBOT, angles), p, strict=True))
    theta = STATES[name]["joint_position"]
    again = inverse(ROBOT, at_rest(forward(ROBOT, theta)))
    assert all(agree(s.coefficients[0], t) for s, t in zip(again, theta, strict=True))


@pytest.mark.parametrize("name", STATES)
def test_inverse_kinematics_agrees_with_the_half_angle_form_elbow_outwards(name: str) -> None:
    p = at_rest(STATES[name]["position"])
    length, forearm = ROBOT.upper_arm_length, ROBOT.forearm_length
    for u, angle in zip(ROBOT.directions, inverse(ROBOT, p), strict=True):
        x, y, z = (s.coefficients[0] for s in rod_end(ROBOT, u, p))
        across = x * u[0] + y * u[1] - ROBOT.base_radius
        square = x**2 + y**2 + ROBOT.base_radius**2 - 2 * ROBOT.base_radius * (x * u[0] + y * u[1]) + z**2
        k = (square + length**2 - forearm**2) / (2 * length)  # across cos - z sin = k
        half = mp.atan((-z - mp.sqrt(across**2 + z**2 - k**2)) / (across + k))
        assert agree(angle.coefficients[0], 2 * half)


def test_turning_the_position_by_120_degrees_permutes_the_arms() -> None:
    x, y, z = (mp.mpf(v) for v in ("0.11", "-0.07", "-0.79"))
    c, s = mp.mpf(-1) / 2, mp.sqrt(3) / 2
    angles = [a.coefficients[0] for a in inverse(ROBOT, at_rest((x, y, z)))]
    turned = [a.coefficients[0] for a in inverse(ROBOT, at_rest((c * x - s * y, s * x + c * y, z)))]
    assert all(agree(a, b) for a, b in zip(turned, [angles[2], angles[0], angles[1]], strict=True))


def test_jacobian_is_the_derivative_of_forward_kinematics() -> None:
    theta = STATES["s06"]["joint_position"]
    columns, step = jacobian(ROBOT, forward(ROBOT, theta)), mp.mpf("1e-13")
    for i, column in enumerate(columns):
        turn = [step * (j == i) for j in range(3)]
        ahead = forward(ROBOT, [t + dt for t, dt in zip(theta, turn, strict=True)])
        behind = forward(ROBOT, [t - dt for t, dt in zip(theta, turn, strict=True)])
        assert all(agree((a - b) / (2 * step), c, 24) for a, b, c in zip(ahead, behind, column, strict=True))


# Dynamics


@pytest.mark.parametrize("name", STATES)
def test_two_routes_to_the_joint_torque_agree(name: str) -> None:
    moving, payload = state_motion(name), STATES[name]["payload"]
    routes = (joint_torque(ROBOT, payload, moving), torque_from_multipliers(ROBOT, payload, moving))
    assert all(agree(a, b) for a, b in zip(*routes, strict=True))


@pytest.mark.parametrize("name", SOME_STATES)
def test_joint_torque_satisfies_the_euler_lagrange_equations(name: str) -> None:
    state, payload, step = STATES[name], STATES[name]["payload"], mp.mpf("1e-14")
    p, v, a = state["position"], state["velocity"], state["acceleration"]

    def energy(position: list[Number], velocity: list[Number]) -> Number:
        return kinetic_energy(ROBOT, payload, motion(position, velocity, (0, 0, 0)))

    def height_energy(position: list[Number]) -> Number:
        return potential_energy(ROBOT, payload, at_rest(position))

    def moved(vector: list[Number], k: int, by: Number) -> list[Number]:
        return [x + by * (i == k) for i, x in enumerate(vector)]

    def momentum(k: int, t: Number) -> Number:
        """dT/dv_k at time t; exact, T being quadratic in v."""
        position = [x + y * t + z * t**2 / 2 for x, y, z in zip(p, v, a, strict=True)]
        velocity = [y + z * t for y, z in zip(v, a, strict=True)]
        return (energy(position, moved(velocity, k, 1)) - energy(position, moved(velocity, k, -1))) / 2

    torque = joint_torque(ROBOT, payload, state_motion(name))
    for k in range(3):
        rate = (momentum(k, step) - momentum(k, -step)) / (2 * step)
        ahead, behind = moved(p, k, step), moved(p, k, -step)
        slope = (energy(ahead, v) - energy(behind, v)) / (2 * step)
        weight = (height_energy(ahead) - height_energy(behind)) / (2 * step)
        moving = at_rest(p, order=1)
        moving[k].coefficients[1] = mp.mpf(1)
        rates = [angle.coefficients[1] for angle in inverse(ROBOT, moving)]
        generalised = sum(t * r for t, r in zip(torque, rates, strict=True))
        assert agree(generalised, rate - slope + weight, 20)


@pytest.mark.parametrize("name", STATES)
def test_forward_dynamics_undoes_inverse_dynamics(name: str) -> None:
    state = STATES[name]
    theta, rates, torques = state["joint_position"], state["joint_velocity"], state["joint_torque"]
    solved = forward_dynamics(ROBOT, state["payload"], theta, rates, torques)
    torque = joint_torque(ROBOT, state["payload"], solved)
    assert all(agree(a, b) for a, b in zip(torque, torques, strict=True))
    angles = inverse(ROBOT, solved)
    assert all(agree(s.coefficients[1], r) for s, r in zip(angles, rates, strict=True))


def test_two_points_carry_the_energy_of_a_continuous_rod() -> None:
    slender = ROBOT.forearm_mass * ROBOT.forearm_length**2 / 12
    # Nothing but forearms; the upper arm needs some mass to have a radius of gyration.
    tiny, zero = mp.mpf("1e-60"), mp.mpf(0)
    robot = dataclasses.replace(ROBOT, platform_mass=zero, drive_inertia=zero, forearm_inertia=slender)
    robot = dataclasses.replace(robot, upper_arm_mass=tiny, upper_arm_inertia=tiny)
    moving = state_motion("s03")
    expected = mp.mpf(0)
    for u, angle in zip(robot.directions, inverse(robot, moving), strict=True):
        rate, theta = angle.coefficients[1], angle.coefficients[0]
        length = robot.upper_arm_length
        elbow = [-u[0] * mp.sin(theta), -u[1] * mp.sin(theta), -mp.cos(theta)]
        ends = [(length * rate * e, s.coefficients[1]) for e, s in zip(elbow, moving, strict=True)]

        def power(f: Number, ends: list[tuple[Number, Number]] = ends) -> Number:
            return sum(((1 - f) * a + f * b) ** 2 for a, b in ends)

        expected += robot.forearm_mass / 2 * mp.quad(power, [0, 1])
    assert agree(kinetic_energy(robot, mp.mpf(0), moving), expected)


def test_upper_arm_points_carry_its_inertia_and_weight() -> None:
    tiny, moving = mp.mpf("1e-60"), state_motion("s04")
    robot = dataclasses.replace(ROBOT, platform_mass=tiny, forearm_mass=tiny, forearm_inertia=tiny / 100)
    angles = inverse(robot, moving)
    inertia = robot.upper_arm_inertia + robot.drive_inertia
    energy = inertia / 2 * sum(angle.coefficients[1] ** 2 for angle in angles)
    assert agree(kinetic_energy(robot, mp.mpf(0), moving), energy)
    height = -robot.upper_arm_centre * sum(mp.sin(angle.coefficients[0]) for angle in angles)
    assert agree(potential_energy(robot, mp.mpf(0), moving), robot.upper_arm_mass * robot.gravity * height)


def test_rods_of_a_platform_at_rest_carry_its_weight_and_half_their_own() -> None:
    position = at_rest([mp.mpf(v) for v in ("0.05", "-0.1", "-0.8")], order=2)
    payload = mp.mpf(1)
    multipliers = rod_multipliers(ROBOT, payload, position)
    upward = mp.mpf(0)
    for angle, multiplier in zip(inverse(ROBOT, position), multipliers, strict=True):
        elbow_height = -ROBOT.upper_arm_length * mp.sin(angle.coefficients[0])
        rod = position[2].coefficients[0] - elbow_height
        upward -= multiplier * rod
    weight = (ROBOT.platform_mass + payload + 3 * ROBOT.forearm_mass / 2) * ROBOT.gravity
    assert agree(upward, weight)
