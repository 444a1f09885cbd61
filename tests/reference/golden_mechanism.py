"""Rows of the mechanism's golden file: kinematics and dynamics at fixed states."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .delta import Robot, forward, inverse, jacobian
from .delta_dynamics import forward_dynamics, joint_torque, rod_multipliers
from .golden import TOLERANCE, Row
from .precision import Number, mp
from .taylor import Taylor

AXES, JOINTS = ("x", "y", "z"), ("1", "2", "3")
ROUTES = {
    "inverse.joint_position": "root of the loop closure at the position",
    "inverse.joint_velocity": "Taylor arithmetic on the loop closure",
    "inverse.joint_acceleration": "Taylor arithmetic on the loop closure",
    "inverse.joint_jerk": "Taylor arithmetic on the loop closure",
    "inverse.jacobian": "dp/dtheta; inverse of dtheta/dp from Taylor arithmetic",
    "inverse.joint_torque": "virtual work of point masses",
    "inverse.rod_force": "lambda l of the rod pair; platform varied with the arms held; tension positive",
    "forward.position": "root finding on the three loop closures",
    "forward.velocity": "linear solve of dtheta = (dtheta/dp) dp",
    "forward.acceleration": "linear solve of the inverse dynamics",
    "forward.joint_acceleration": "Taylor arithmetic on the solved motion",
    "forward.rod_force": "lambda l of the rod pair; platform varied with the arms held; tension positive",
}


def _named(kind: str, labels: Sequence[str], values: Sequence[Number]) -> dict[tuple[str, str], Number]:
    return {(kind, f".{label}"): value for label, value in zip(labels, values, strict=True)}


def state_values(state: Mapping[str, Any], robot: Robot) -> dict[tuple[str, str], Number]:
    """All quantities of one state by (kind, component suffix)."""
    payload = state["payload"]
    given = (state["position"], state["velocity"], state["acceleration"], state["jerk"])
    x, y, z = (Taylor([p, v, a / 2, j / 6]) for p, v, a, j in zip(*given, strict=True))
    angles = inverse(robot, (x, y, z))
    values: dict[tuple[str, str], Number] = {}
    for order, kind in enumerate(("position", "velocity", "acceleration", "jerk")):
        values |= _named(f"inverse.joint_{kind}", JOINTS, [angle.derivative(order) for angle in angles])
    for joint, column in zip(JOINTS, jacobian(robot, state["position"]), strict=True):
        values |= _named("inverse.jacobian", [f"{axis}.{joint}" for axis in AXES], column)
    values |= _named("inverse.joint_torque", JOINTS, joint_torque(robot, payload, (x, y, z)))
    forces = [m * robot.forearm_length for m in rod_multipliers(robot, payload, (x, y, z))]
    values |= _named("inverse.rod_force", JOINTS, forces)

    theta, rate, torque = state["joint_position"], state["joint_velocity"], state["joint_torque"]
    solved = forward_dynamics(robot, payload, theta, rate, torque)
    values |= _named("forward.position", AXES, forward(robot, theta))
    values |= _named("forward.velocity", AXES, [s.derivative(1) for s in solved])
    values |= _named("forward.acceleration", AXES, [s.derivative(2) for s in solved])
    accelerations = [angle.derivative(2) for angle in inverse(robot, solved)]
    values |= _named("forward.joint_acceleration", JOINTS, accelerations)
    forces = [m * robot.forearm_length for m in rod_multipliers(robot, payload, solved)]
    values |= _named("forward.rod_force", JOINTS, forces)
    return values


def mechanism_rows(states: Mapping[str, Any], robot: Robot) -> Iterator[Row]:
    """All rows; the absolute tolerance is 1e-12 of the kind's largest value over the states."""
    by_state = {name: state_values(state, robot) for name, state in states["state"].items()}
    scale = dict.fromkeys(ROUTES, mp.mpf(0))
    for values in by_state.values():
        for (kind, _), value in values.items():
            scale[kind] = max(scale[kind], abs(value))
    for name, values in by_state.items():
        for (kind, suffix), value in values.items():
            absolute = mp.nstr(scale[kind] * mp.mpf(TOLERANCE), 2)
            yield Row(name, kind + suffix, value, ROUTES[kind], absolute=absolute)
