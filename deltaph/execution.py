"""What the machine made of the plan: executed deviation, overshoot, tracking errors, motor load, step times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltaph.feed import FeedClock
from deltaph.frame import TIMING, Frame, columns
from deltaph.pacing import CAUSES
from deltaph.plan import Plan
from deltaph.schedule import Operation, Schedule
from deltaph.variables import Model, variable_table

FloatArray = NDArray[np.float64]


class Trace:
    """The frames of a run as arrays.

    Attributes:
        time: simulation time [s] (frames,).
    """

    def __init__(self, frames: Sequence[Frame]) -> None:
        self.time: FloatArray = columns(frames, "time")
        self.timing: FloatArray = columns(frames, "timing")
        self._floats = {model: columns(frames, f"{model}_floats") for model in ("planner", "plant")}
        self._integers = {model: columns(frames, f"{model}_integers") for model in ("planner", "plant")}

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
class CornerPass:
    """How one corner was passed, and why not as planned; SI.

    Attributes:
        operation: number of the operation.
        move: its name.
        side: 0 above a pick point, 1 above a place point, which a return passes first.
        prescribed: corner deviation [m].
        planned: corner deviation [m].
        bound: what made it smaller than prescribed; empty where nothing did.
        executed: corner deviation [m].
        reached: whether the tool came as far as the corner; if not, `executed` is how far away it remained.
        time: of the closest approach to the vertex [s].
        nearest: the executed path's point there (3,) [m].
        tracking_error: distance of the tool from its setpoint there [m].
        lag: by how much of it the tool is behind along the planned path; negative where it is ahead [m].
        joint_tracking_error: setpoint - actual of the joints there (3,) [rad].
    """

    operation: int
    move: str
    side: int
    prescribed: float
    planned: float
    bound: str
    executed: float
    reached: bool
    time: float
    nearest: tuple[float, ...]
    tracking_error: float
    lag: float
    joint_tracking_error: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Execution:
    """The executed motion, SI.

    Attributes:
        corner_deviation: of each operation's two corners in path order [m].
        corners: the same corners, with the reasons.
        arrival: when the planner had done all it was asked for; None where the frames end before [s].
        overshoot: largest excursion outside the right-angle paths [m].
        tracking_error_joint_max: [rad].
        tracking_error_tcp_max: [m].
        motor_torque_max: of each motor, from the beginning of the run to the last arrival [N m].
        motor_torque_rms: likewise [N m].
        motor_load_max: greatest thermal load of each motor; 1 is that of the rated torque.
        motor_work: mechanical energy that each motor gave, per operation [J].
        motor_regenerated: mechanical energy that each motor took back, per operation [J].
        trip: why the plant tripped; `none` where it did not.
        trip_time: when [s].
        trip_axis: 1 to 3, or 0 where none is meant.
    """

    corner_deviation: tuple[float, ...]
    corners: tuple[CornerPass, ...]
    arrival: float | None
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


def nearest_point(
    time: FloatArray, position: FloatArray, velocity: FloatArray, vertex: FloatArray
) -> tuple[float, float, FloatArray]:
    """Where an executed path, interpolated between frames, comes closest to a vertex.

    The path is the cubic that has the frames' positions and velocities (Hermite). 200 points a step leave gaps of micrometres;
    their effect on a distance of millimetres is of second order: below a nanometre.

    Args:
        time: (n,) [s].
        position: (n, 3) [m].
        velocity: (n, 3) [m/s].
        vertex: (3,) [m].

    Returns:
        distance [m], time [s] and point (3,) [m].
    """
    nearest = int(np.argmin(np.linalg.norm(position - vertex, axis=1)))
    first, last = max(nearest - 2, 0), min(nearest + 2, len(time) - 1)
    u = np.linspace(0.0, 1.0, 201)[:, None, None]
    h = np.diff(time[first : last + 1])[:, None]
    p0, p1 = position[first:last], position[first + 1 : last + 1]
    m0, m1 = h * velocity[first:last], h * velocity[first + 1 : last + 1]
    path = (2 * u**3 - 3 * u**2 + 1) * p0 + (u**3 - 2 * u**2 + u) * m0 + (3 * u**2 - 2 * u**3) * p1 + (u**3 - u**2) * m1
    distance = np.linalg.norm(path - vertex, axis=2)
    part, step = np.unravel_index(int(distance.argmin()), distance.shape)
    at = time[first + step] + float(u[part, 0, 0]) * h[step, 0]
    return float(distance[part, step]), float(at), path[part, step]


PATH_STEP = 1e-4
"""Between two points at which the planned path is compared with a point of the executed one: 0.5 mm at 5 m/s [s]."""


def _corner_passes(
    operation: Operation, clock: FeedClock, planned: NDArray[np.void], time: FloatArray, tool: tuple[FloatArray, FloatArray]
) -> Iterator[tuple[float, float, FloatArray, float, float, bool]]:
    """How the two corners of an operation were passed, in path order.

    Args:
        operation: its plan.
        clock: the planner's.
        planned: setpoints of its plan, PATH_STEP apart.
        time: of its frames, from the start of the run on (n,) [s].
        tool: executed position (n, 3) [m] and velocity (n, 3) [m/s].

    Yields:
        distance [m], time [s] and point (3,) [m] of the closest approach; tracking error [m] and lag [m] there; whether the
        corner was reached.
    """
    for vertex in operation.plan.vertices:
        executed, at, point = nearest_point(time, *tool, vertex)
        setpoint = operation.plan.sample(clock.at(np.array([at])) - operation.clock_ms / 1000.0)[0]
        here, corner = (
            float(planned["arc_length"][np.argmin(np.linalg.norm(planned["tcp_position"] - place, axis=1))])
            for place in (point, vertex)
        )
        error = float(np.linalg.norm(setpoint["tcp_position"] - point))
        # A tool that stops short is nearly as far from the vertex as it is short; one that cuts the corner passes beside it.
        # Where a vertex is an end of the path, both are nought: twice the distance between points of the plan is no difference.
        yield executed, at, point, error, float(setpoint["arc_length"]) - here, corner - here < 0.5 * executed + 1e-3


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


def _arrival(trace: Trace) -> int | None:
    """The frame with which the planner has done all it was asked for; None where it has not."""
    busy = np.flatnonzero(trace["planner", "plan_busy"])
    done = int(busy[-1]) + 1 if len(busy) else 0
    return done if done < len(trace.time) else None


def evaluate(trace: Trace, run: Schedule) -> Execution:
    """Evaluate the frames of a run against its schedule; frames that are missing at the end are not missed."""
    position, velocity = trace["plant", "tcp_position"], trace["plant", "tcp_velocity"]
    joint_error = trace["planner", "joint_position"] - trace["plant", "joint_position"]
    corners: list[CornerPass] = []
    paths = {id(o.plan): o.plan.sample(o.plan.grid(1000.0 * PATH_STEP)) for o in run.one_pass}
    overshoots = [0.0]
    for number, operation in enumerate(run.operations):
        window = slice(math.floor(operation.start_ms / run.communication_step_ms), run.step_at(operation.end_ms) + 1)
        if len(trace.time[window]) < 2:
            break
        plan, time = operation.plan, trace.time[window] - trace.time[0]
        passes = _corner_passes(operation, run.clock, paths[id(plan)], time, (position[window], velocity[window]))
        for corner, (executed, at, point, error, lag, reached) in enumerate(passes):
            corners.append(
                CornerPass(
                    operation=number,
                    move=operation.move.name,
                    side=corner ^ operation.move.is_return,
                    prescribed=plan.task.corner_deviation[corner],
                    planned=plan.corner_deviation[corner],
                    bound=plan.corner_bound[corner],
                    executed=executed,
                    reached=reached,
                    time=float(trace.time[0]) + at,
                    nearest=tuple(point.tolist()),
                    tracking_error=error,
                    lag=lag,
                    joint_tracking_error=tuple(float(np.interp(at, time, joint)) for joint in joint_error[window].T),
                )
            )
        overshoots.append(overshoot(position[window], plan))
    last = run.arrival_step
    overshoots.append(overshoot(position[last:], run.operations[-1].plan) if len(position) > last else 0.0)

    torque = trace["plant", "motor_torque"][: last + 1]
    count, arrived = len(run.operations), min(last, len(position) - 1)
    arrival = _arrival(trace)
    trip = trace["plant", "trip"].astype(int)
    return Execution(
        corner_deviation=tuple(corner.executed for corner in corners),
        corners=tuple(corners),
        arrival=float(trace.time[arrival]) if arrival is not None else None,
        overshoot=max(overshoots),
        tracking_error_joint_max=float(np.abs(joint_error).max()),
        tracking_error_tcp_max=float(np.linalg.norm(trace["planner", "tcp_position"] - position, axis=1).max()),
        motor_torque_max=tuple(np.abs(torque).max(axis=0).tolist()),
        motor_torque_rms=tuple(np.sqrt((torque**2).mean(axis=0)).tolist()),
        motor_load_max=tuple(trace["plant", "motor_load"].max(axis=0).tolist()),
        motor_work=tuple((trace["plant", "motor_work"][arrived] / count).tolist()),
        motor_regenerated=tuple((trace["plant", "motor_regenerated"][arrived] / count).tolist()),
        trip=variable_table("plant").items("Trip")[int(trip[-1])],
        trip_time=float(trace.time[0] + trace["plant", "trip_time"][-1]) if trip[-1] else None,
        trip_axis=int(trace["plant", "trip_axis"][-1]),
    )


def percentiles(seconds: FloatArray) -> dict[str, float]:
    """p50, p99, p999 and max of durations [s], in microseconds."""
    p50, p99, p999 = np.percentile(seconds, (50, 99, 99.9)) * 1e6
    return {"p50": float(p50), "p99": float(p99), "p999": float(p999), "max": float(seconds.max() * 1e6)}


def deadline_facts(timing: Mapping[str, float], priority: int) -> dict[str, Any]:
    """Of deadlines and frames: the part of `timing` that is the same in the JSON reports of a run and of a cell that served.

    Args:
        timing: of the last frame, by name as in TIMING.
        priority: real-time priority of the step loop; 0 where it has none.
    """
    return {
        "realtime_priority": priority,
        "real_time_factor": timing["real_time_factor"],
        "missed_deadlines": int(timing["missed_deadlines"]),
        "missed_by": {cause: int(timing[f"missed_by_{cause}"]) for cause in CAUSES},
        "slipped_steps": int(timing["slipped_steps"]),
        "dropped_frames": int(timing["dropped_frames"]),
    }
