"""Greatest absolute values over continuous time: a dense scan in double, then refinement at 50 digits."""

from collections.abc import Callable, Sequence

import numpy as np

from .delta import Robot, inverse
from .delta_dynamics import joint_torque
from .ppo import Phase, Plan
from .precision import Number, in_double, mp

KINDS = {
    "joint_velocity": 3,
    "joint_acceleration": 3,
    "joint_jerk": 3,
    "joint_torque": 3,
    "tcp_speed": 1,
    "tcp_acceleration": 1,
}
_DERIVATIVE = {"joint_velocity": 1, "joint_acceleration": 2, "joint_jerk": 3}
# Below every scanned bracket, far above the working precision: the root it moves by is about 1e-24.
_STEP = mp.mpf("1e-12")


def _norm(components: Sequence[Number]) -> Number:
    square = sum(component * component for component in components)
    return np.sqrt(square) if isinstance(square, float | np.ndarray) else mp.sqrt(square)


def responses(
    robot: Robot,
    payload: Number,
    phase: Phase,
    rate: Number,
    parameter: Number,
    kind: str,
) -> list[Number]:
    """The quantities of one kind (3 or 1) on the aligned clock, at a parameter of a phase.

    Args:
        robot: the robot.
        payload: mass at the platform [kg].
        phase: the phase, evaluated one-sidedly also at its ends.
        rate: speed factor c of the plan.
        parameter: parameter in [0, 1], a number or an array.
        kind: one of `KINDS`.
    """
    order = 3 if kind == "joint_jerk" else 2
    x, y, z = (s.at_rate(rate) for s in phase.position(parameter, order))
    if kind == "tcp_speed":
        return [_norm([s.derivative(1) for s in (x, y, z)])]
    if kind == "tcp_acceleration":
        return [_norm([s.derivative(2) for s in (x, y, z)])]
    if kind == "joint_torque":
        return list(joint_torque(robot, payload, (x, y, z)))
    return [angle.derivative(_DERIVATIVE[kind]) for angle in inverse(robot, (x, y, z))]


def scan_parameters(count: int = 1500) -> np.ndarray:
    """Parameters in [0, 1], denser towards both ends and the middle, where short transients live."""
    even = np.linspace(0.0, 1.0, count)
    ends = (1 - np.cos(np.pi * np.linspace(0.0, 1.0, count))) / 2
    middle = 0.5 + 0.5 * np.linspace(-1.0, 1.0, count) ** 3
    return np.unique(np.concatenate([even, ends, middle]))


def _refine(value: Callable[[Number], Number], a: float, b: float) -> Number:
    """Local maximum of a function between two parameters: the root of its central difference."""

    def slope(parameter: Number) -> Number:
        return value(parameter + _STEP) - value(parameter - _STEP)

    left, right = mp.mpf(a), mp.mpf(b)
    at_left, at_right = slope(left), slope(right)
    if at_left <= 0 or at_right >= 0:  # no stationary point inside: the end of a phase
        return max(value(left), value(right))
    kept = 0
    for _ in range(60):  # Illinois: false position, halving the weight of an end kept twice
        middle = (left * at_right - right * at_left) / (at_right - at_left)
        at_middle = slope(middle)
        if at_middle > 0:
            moved, left, at_left = middle - left, middle, at_middle
            at_right, kept = (at_right / 2 if kept > 0 else at_right), 1
        else:
            moved, right, at_right = right - middle, middle, at_middle
            at_left, kept = (at_left / 2 if kept < 0 else at_left), -1
        # A parameter right to 1e-16 gives a maximum right to about 1e-30.
        if abs(moved) < mp.mpf("1e-16"):
            break
    return value((left * at_right - right * at_left) / (at_right - at_left))


def peaks(robot: Robot, payload: Number, plan: Plan, kind: str) -> list[Number]:
    """Suprema over the whole PPO of the absolute values of one kind (3 or 1), on the aligned clock."""
    grid = scan_parameters()
    rough, light, rate = in_double(robot), in_double(payload), float(plan.speed_factor)
    scans = [
        np.abs(np.array([r + 0 * grid for r in responses(rough, light, in_double(phase), rate, grid, kind)]))
        for phase in plan.phases
    ]
    found = []
    for i in range(KINDS[kind]):
        best = max(float(scan[i].max()) for scan in scans)
        values = []
        for phase, scan in zip(plan.phases, scans, strict=True):
            level = np.concatenate([[-1.0], scan[i], [-1.0]])
            top = (level[1:-1] >= level[:-2]) & (level[1:-1] >= level[2:]) & (scan[i] >= best * (1 - 1e-3))
            for n in np.flatnonzero(top).tolist():
                a, b = grid[max(n - 1, 0)], grid[min(n + 1, len(grid) - 1)]

                def value(parameter: Number, phase: Phase = phase, i: int = i) -> Number:
                    return abs(responses(robot, payload, phase, plan.speed_factor, parameter, kind)[i])

                values.append(_refine(value, float(a), float(b)))
        found.append(max(values))
    return found
