"""A made-up pick-and-place operation as frames, to test telemetry without FMUs: neither the product's path nor its motion law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltaph.frame import TIMING, Frame, pack, records
from deltaph.telemetry.scene import Move, Scene
from deltaph.variables import Model, variable_table

FloatArray = NDArray[np.float64]

BASE, PLATFORM, UPPER_ARM, FOREARM = 0.200, 0.045, 0.350, 0.800
RIGHT_ANGLE_PATH = np.array([[-0.1525, 0.0, -0.8], [-0.1525, 0.0, -0.75], [0.1525, 0.0, -0.75], [0.1525, 0.0, -0.8]])
DEVIATION = 0.006
DURATION = 0.303
UNIX_TIME_NS = 1_800_000_000_000_000_000

_ANGLES = np.radians([0.0, 120.0, 240.0])
_RADIAL = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(3)])
_TANGENTIAL = np.column_stack([-np.sin(_ANGLES), np.cos(_ANGLES), np.zeros(3)])


def path() -> FloatArray:
    """The right-angle path with parabolic corners of the prescribed deviation (n, 3) [m]."""
    length = (
        2.0 * np.sqrt(2.0) * DEVIATION
    )  # a parabola that leaves both legs `length` from the vertex passes it at length / (2 sqrt 2)
    pick, first, second, place = RIGHT_ANGLE_PATH
    u = np.linspace(0.0, 1.0, 201)[:, None]

    def corner(before: FloatArray, vertex: FloatArray, after: FloatArray) -> FloatArray:
        a = vertex + length * (before - vertex) / np.linalg.norm(before - vertex)
        b = vertex + length * (after - vertex) / np.linalg.norm(after - vertex)
        points: FloatArray = (1 - u) ** 2 * a + 2 * u * (1 - u) * vertex + u**2 * b
        return points

    return np.vstack([[pick], corner(pick, first, second), corner(first, second, place), [place]])


def inverse_kinematics(position: FloatArray) -> FloatArray:
    """Joint positions (n, 3) [rad] of tool centre points (n, 3) [m], from the length of the forearms."""
    x, y, z = position @ _RADIAL.T + PLATFORM, position @ _TANGENTIAL.T, position[:, 2:]
    a, b = 2 * UPPER_ARM * (BASE - x), 2 * UPPER_ARM * z
    k = (BASE - x) ** 2 + UPPER_ARM**2 + y**2 + z**2 - FOREARM**2
    angle: FloatArray = np.arctan2(b, a) + np.arccos(-k / np.hypot(a, b))
    return angle


def elbows(joint_position: FloatArray) -> FloatArray:
    """Elbows (n, 3, 3) [m] for joint positions (n, 3) [rad]."""
    c, s = np.cos(joint_position)[:, :, None], np.sin(joint_position)[:, :, None]
    points: FloatArray = (BASE + UPPER_ARM * c) * _RADIAL - UPPER_ARM * s * [0.0, 0.0, 1.0]
    return points


def scene() -> Scene:
    """What the recorder is given."""
    return Scene(
        title="A made-up operation",
        law="paper",
        scenario_json='{"title": "A made-up operation"}',
        moves=[
            Move(
                right_angle_path=RIGHT_ANGLE_PATH,
                corner_deviation=np.full(2, DEVIATION),
                planned_path=path(),
                corner_paths=[path()[1:202], path()[202:403]],
                corner_times=np.array([0.056, 0.247]),
            )
        ],
        limits={"joint_velocity": (6.0,) * 3, "joint_torque": (80.0, 60.0, 60.0), "joint_jerk": np.inf, "tcp_speed": np.inf},
        joint_range=(-0.7, 1.7),
        base_points=BASE * _RADIAL,
        platform_offsets=PLATFORM * _RADIAL,
        elbows=elbows,
    )


def _table(model: Model, *, floats: bool, values: Mapping[str, FloatArray], count: int) -> NDArray[np.float64]:
    """Outputs in table order (count, outputs); by group, zero where nothing is given."""
    outputs = [v for v in variable_table(model).of("output") if v.is_float == floats]
    table = np.zeros((count, len(outputs)))
    for column, variable in enumerate(outputs):
        if variable.group in values:
            given = values[variable.group]
            table[:, column] = given if variable.index is None else given[:, variable.index]
    return table


def frame_of(*attributes: Any) -> Frame:
    """A frame that can be written."""
    return Frame(bytearray(pack(*attributes)))


def replaced(frame: Frame, **attributes: Any) -> Frame:
    """The same frame but for some attributes."""
    record = records([frame])
    for name, value in attributes.items():
        record[name] = value
    return Frame(bytearray(record.tobytes()))


def random_frame(step: int) -> Frame:
    """A frame in which no two values are equal by accident."""
    random = np.random.default_rng(step)
    arrays = []
    for model in ("planner", "plant"):
        outputs = variable_table(model).of("output")
        floats = sum(v.is_float for v in outputs)
        arrays += [random.normal(size=floats), random.integers(0, 2**31, len(outputs) - floats, dtype=np.int32)]
    planner, plant = tuple(arrays[:2]), tuple(arrays[2:])
    return frame_of(step, 1e-3 * step, UNIX_TIME_NS + step, planner, plant, random.normal(size=len(TIMING)).tolist())


def values_of(frame: Frame) -> dict[str, dict[str, float]]:
    """What each message of a frame has to say, by message and field, without the sequence number."""
    head = {"time": frame.time, "unix_time_ns": frame.unix_time_ns}
    found: dict[str, dict[str, float]] = {}
    for model, floats, integers in (
        ("planner", frame.planner_floats, frame.planner_integers),
        ("plant", frame.plant_floats, frame.plant_integers),
    ):
        outputs = variable_table(model).of("output")
        names = [v.name for v in outputs if v.is_float] + [v.name for v in outputs if not v.is_float]
        found[model] = dict(zip(names, [*floats.tolist(), *integers.tolist()], strict=True))
    planner = found["planner"]
    return {
        "setpoint": head | {name: value for name, value in planner.items() if not name.startswith("plan.")},
        "plan": head | {name: value for name, value in planner.items() if name.startswith("plan.")},
        "actual": head | found["plant"],
        "timing": head | dict(zip((name for name, _, _ in TIMING), frame.timing.tolist(), strict=True)),
    }


def frames(count: int = 354, step: float = 1e-3, noise: float = 0.0) -> list[Frame]:
    """The operation, and rest after it."""
    time = step * np.arange(count)
    points = path()
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    u = np.clip(time / DURATION, 0.0, 1.0)
    travelled = arc[-1] * (10 * u**3 - 15 * u**4 + 6 * u**5)
    tcp = np.column_stack([np.interp(travelled, arc, points[:, axis]) for axis in range(3)])

    def rate(values: FloatArray) -> FloatArray:
        derivative: FloatArray = np.gradient(values, step, axis=0)
        return derivative

    joint, lag = inverse_kinematics(tcp), 2e-5  # the actual motion trails the setpoint by a lag [s]
    actual_tcp = tcp - lag * rate(tcp) + noise * np.random.default_rng(0).normal(size=tcp.shape)
    actual_joint = inverse_kinematics(actual_tcp)
    torque = 8.0 + 0.25 * rate(rate(joint))
    vertices = RIGHT_ANGLE_PATH[1:3]
    setpoint = {
        "joint_position": joint,
        "joint_velocity": rate(joint),
        "joint_acceleration": rate(rate(joint)),
        "joint_torque": torque,
        "tcp_position": tcp,
        "tcp_velocity": rate(tcp),
        "tcp_acceleration": rate(rate(tcp)),
        "path_arc_length": travelled,
        "path_length": np.full(count, arc[-1]),
        "path_vertex_distance": np.linalg.norm(tcp[:, None] - vertices, axis=2).min(axis=1),
        "path_phase": np.where(time < DURATION, 1 + np.minimum(5, (6 * u).astype(int)), 0),
        "plan_status": np.ones(count),
        "plan_duration": np.full(count, DURATION),
        "plan_count": np.ones(count),
    }
    actual = {
        "joint_position": actual_joint,
        "joint_velocity": rate(actual_joint),
        "joint_acceleration": rate(rate(actual_joint)),
        "joint_torque": torque + 0.3,
        "motor_torque": torque / 20.0,
        "motor_speed": 20.0 * rate(actual_joint),
        "tcp_position": actual_tcp,
        "tcp_velocity": rate(actual_tcp),
    }
    kinds = ((True, np.float64), (False, np.int32))
    tables = [
        [_table(model, floats=floats, values=values, count=count).astype(kind) for floats, kind in kinds]
        for model, values in (("planner", setpoint), ("plant", actual))
    ]
    timing = np.full((count, len(TIMING)), 5e-5)
    return [
        frame_of(k, k * step, UNIX_TIME_NS + k * 1_000_000, *((floats[k], others[k]) for floats, others in tables), timing[k])
        for k in range(count)
    ]
