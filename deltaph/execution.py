"""What the machine made of the plan: executed deviation, overshoot, tracking errors, motor load, step times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltaph.frame import TIMING, Frame
from deltaph.importer import Schedule
from deltaph.plan import Plan
from deltaph.variables import Model, variable_table

FloatArray = NDArray[np.float64]


class Trace:
    """The frames of a run as arrays.

    Attributes:
        time: simulation time [s] (frames,).
    """

    def __init__(self, frames: Sequence[Frame]) -> None:
        self.time: FloatArray = np.array([frame.time for frame in frames])
        self.timing: FloatArray = np.stack([frame.timing for frame in frames])
        self._floats = {model: np.stack([getattr(frame, f"{model}_floats") for frame in frames]) for model in ("planner", "plant")}
        self._integers = {
            model: np.stack([getattr(frame, f"{model}_integers") for frame in frames]) for model in ("planner", "plant")
        }

    def __getitem__(self, key: tuple[Model, str]) -> FloatArray:
        """An output group such as ("plant", "tcp_position"): (frames, 3), or (frames,) where it is one scalar."""
        model, group = key
        outputs = variable_table(model).of("output")
        floats = [v.group for v in outputs if v.is_float]
        if group in floats:
            columns = [i for i, name in enumerate(floats) if name == group]
            values = self._floats[model][:, columns]
        else:
            others = [v.group for v in outputs if not v.is_float]
            values = self._integers[model][:, [others.index(group)]]
        return values[:, 0] if values.shape[1] == 1 else values

    def timing_of(self, name: str) -> FloatArray:
        """A column of the timing (frames,)."""
        return self.timing[:, [column for column, _, _ in TIMING].index(name)]


@dataclass(frozen=True, slots=True)
class Execution:
    """The executed motion, SI.

    Attributes:
        corner_deviation: of each operation's two corners in path order [m].
        overshoot: largest excursion outside the right-angle paths [m].
        tracking_error_joint_max: [rad].
        tracking_error_tcp_max: [m].
        motor_torque_max: of each motor [N m].
        motor_torque_rms: of each motor, from the first start to the last arrival [N m].
        motor_load_max: greatest thermal load of each motor; 1 is that of the rated torque.
        motor_work: mechanical energy that each motor gave, per operation [J].
        motor_regenerated: mechanical energy that each motor took back, per operation [J].
        trip: why the plant tripped; `none` where it did not.
        trip_time: when [s].
        trip_axis: 1 to 3, or 0 where none is meant.
    """

    corner_deviation: tuple[float, ...]
    overshoot: float
    tracking_error_joint_max: float
    tracking_error_tcp_max: float
    motor_torque_max: tuple[float, ...]
    motor_torque_rms: tuple[float, ...]
    motor_load_max: tuple[float, ...]
    motor_work: tuple[float, ...]
    motor_regenerated: tuple[float, ...]
    trip: str
    trip_time: float | None
    trip_axis: int


def corner_deviation(time: FloatArray, position: FloatArray, velocity: FloatArray, vertex: FloatArray) -> float:
    """Distance of a vertex from an executed path, interpolated between frames.

    The path is the cubic that has the frames' positions and velocities (Hermite). 200 points a step leave gaps of micrometres;
    their effect on a distance of millimetres is of second order: below a nanometre.

    Args:
        time: (n,) [s].
        position: (n, 3) [m].
        velocity: (n, 3) [m/s].
        vertex: (3,) [m].
    """
    nearest = int(np.argmin(np.linalg.norm(position - vertex, axis=1)))
    first, last = max(nearest - 2, 0), min(nearest + 2, len(time) - 1)
    u = np.linspace(0.0, 1.0, 201)[:, None, None]
    h = np.diff(time[first : last + 1])[:, None]
    p0, p1 = position[first:last], position[first + 1 : last + 1]
    m0, m1 = h * velocity[first:last], h * velocity[first + 1 : last + 1]
    path = (2 * u**3 - 3 * u**2 + 1) * p0 + (u**3 - 2 * u**2 + u) * m0 + (3 * u**2 - 2 * u**3) * p1 + (u**3 - u**2) * m1
    return float(np.linalg.norm(path - vertex, axis=2).min())


def overshoot(position: FloatArray, plan: Plan) -> float:
    """Largest distance of positions (n, 3) [m] from the area that the plan's right-angle path encloses [m]."""
    pick, place = np.array(plan.task.pick), np.array(plan.task.place)
    width = float(np.linalg.norm(place[:2] - pick[:2]))
    x, y = plan.direction
    along = (position[:, :2] - pick[:2]) @ np.array([x, y])
    lateral = (position[:, :2] - pick[:2]) @ np.array([-y, x])
    outside = np.maximum(np.maximum(-along, along - width), 0.0)
    floor = np.where(along < 0.5 * width, pick[2], place[2])
    top = plan.vertices[0, 2]
    vertical = np.maximum(np.maximum(position[:, 2] - top, floor - position[:, 2]), 0.0)
    return float(np.sqrt(outside**2 + lateral**2 + vertical**2).max())


def evaluate(trace: Trace, run: Schedule) -> Execution:
    """Evaluate the frames of a run against its schedule; frames that are missing at the end are not missed."""
    position, velocity = trace["plant", "tcp_position"], trace["plant", "tcp_velocity"]
    step_ms = run.communication_step_ms
    deviations: list[float] = []
    overshoots = [0.0]
    for operation in run.operations:
        first, last = operation.start_ms // step_ms, -(-operation.end_ms // step_ms)
        window = slice(first, min(last, len(trace.time) - 1) + 1)
        if len(trace.time[window]) < 2:
            break
        deviations += [corner_deviation(trace.time[window], position[window], velocity[window], v) for v in operation.plan.vertices]
        overshoots.append(overshoot(position[window], operation.plan))
    overshoots.append(overshoot(position[run.arrival_step :], run.operations[-1].plan) if len(position) > run.arrival_step else 0.0)

    moving = slice(0, run.arrival_step + 1)
    torque = trace["plant", "motor_torque"][moving]
    joint_error = trace["planner", "joint_position"] - trace["plant", "joint_position"]
    tcp_error = trace["planner", "tcp_position"] - position
    arrival = min(run.arrival_step, len(position) - 1)
    trip = trace["plant", "trip"].astype(int)
    return Execution(
        corner_deviation=tuple(deviations),
        overshoot=max(overshoots),
        tracking_error_joint_max=float(np.abs(joint_error).max()),
        tracking_error_tcp_max=float(np.linalg.norm(tcp_error, axis=1).max()),
        motor_torque_max=tuple(np.abs(torque).max(axis=0).tolist()),
        motor_torque_rms=tuple(np.sqrt((torque**2).mean(axis=0)).tolist()),
        motor_load_max=tuple(trace["plant", "motor_load"].max(axis=0).tolist()),
        motor_work=tuple((trace["plant", "motor_work"][arrival] / len(run.operations)).tolist()),
        motor_regenerated=tuple((trace["plant", "motor_regenerated"][arrival] / len(run.operations)).tolist()),
        trip=variable_table("plant").items("Trip")[int(trip[-1])],
        trip_time=float(trace.time[0] + trace["plant", "trip_time"][-1]) if trip[-1] else None,
        trip_axis=int(trace["plant", "trip_axis"][-1]),
    )


def percentiles(seconds: FloatArray) -> dict[str, float]:
    """p50, p99, p999 and max of durations [s], in microseconds."""
    p50, p99, p999 = np.percentile(seconds, (50, 99, 99.9)) * 1e6
    return {"p50": float(p50), "p99": float(p99), "p999": float(p999), "max": float(seconds.max() * 1e6)}
