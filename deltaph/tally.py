"""What became of a cell without an end, in memory that stays flat: corner deviations as executed, lateness, trips."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltaph.execution import Trace, deadline_facts, nearest_point
from deltaph.frame import TIMING, Frame
from deltaph.pacing import HISTOGRAM_US, histogram
from deltaph.scenario import Task
from deltaph.variables import variable_table

CHUNK = 250
"""Frames that are evaluated at once, which takes some milliseconds."""

KEPT = 100
"""Plans, the newest, of which the report tells what they were and how their corners were passed."""

_OVERLAP = 3  # frames of the last chunk that are looked at again: the nearest point may lie between two chunks

_TIMING = [name for name, _, _ in TIMING]
_PLANNER = [v.name for v in variable_table("planner").of("output") if not v.is_float]
_PLANT = [v.name for v in variable_table("plant").of("output") if not v.is_float]
_TRIP_TIME = [v.name for v in variable_table("plant").of("output") if v.is_float].index("trip_time")


class Begun(NamedTuple):
    """A plan that has begun to run.

    Attributes:
        step: first communication point at which outputs are of it.
        number: of the plan.
        task: what it does.
        payload: that it is made for [kg].
        planned: corner deviations (2,) [m]; 0 where there is no corner.
    """

    step: int
    number: int
    task: Task
    payload: float
    planned: tuple[float, float]

    @property
    def vertices(self) -> NDArray[np.float64]:
        """Of its corners (2, 3) [m]."""
        found = np.array([self.task.pick, self.task.place])
        found[:, 2] += self.task.lift
        return found


@dataclass(frozen=True, slots=True)
class Pass:
    """A corner as it was passed.

    Attributes:
        plan: number of the plan.
        side: 0 at the pick side, 1 at the place side.
        prescribed: corner deviation [m].
        planned: corner deviation [m].
        executed: corner deviation [m].
        time: of the closest approach [s].
        nearest: point of the executed path there (3,) [m].
    """

    plan: int
    side: int
    prescribed: float
    planned: float
    executed: float
    time: float
    nearest: tuple[float, ...]

    @property
    def excess(self) -> float:
        """By how much more than prescribed it is [m]."""
        return self.executed - self.prescribed


class _Approach(NamedTuple):
    """How near the executed path has come to a vertex: distance [m], time [s] and point (3,) [m]."""

    distance: float = np.inf
    time: float = 0.0
    point: tuple[float, ...] = (0.0, 0.0, 0.0)


class Tally:
    """A sink that counts.

    Attributes:
        arrived: plans that ran to their end.
        corners: corners that were passed.
        kept: of those, within what is prescribed and the tolerance.
        worst: the one with the greatest excess; None before the first.
        newest: the last plans that arrived, at most KEPT, with the corners that each passed.

    Args:
        tolerance: on the executed corner deviation [m].
        priority: real-time priority of the step loop, for the report; 0 where it has none.
    """

    def __init__(self, tolerance: float, priority: int = 0) -> None:
        self._begun: deque[Begun] = deque()
        self.arrived = self.corners = self.kept = 0
        self.worst: Pass | None = None
        self.newest: deque[tuple[Begun, list[Pass]]] = deque(maxlen=KEPT)
        self._tolerance = tolerance
        self._priority = priority
        self._frames: list[Frame] = []
        self._running: Begun | None = None
        self._nearest = [_Approach(), _Approach()]
        self._last: Frame | None = None
        self._step_max = self._lateness_max = self._error_max = 0.0
        self._step_us, self._lateness_us = (np.zeros(len(HISTOGRAM_US) + 1, dtype=np.int64) for _ in range(2))

    def begin(self, begun: Begun) -> None:
        """A plan begins; before its first frame, in order."""
        self._begun.append(begun)

    def take(self, frame: Frame) -> None:
        """Count a frame."""
        self._frames.append(frame)
        if len(self._frames) >= CHUNK + _OVERLAP:
            self._evaluate()

    def close(self) -> None:
        """Nothing to finish."""

    def facts(self) -> dict[str, Any]:
        """For the report, after the last frame, under the names of a run's where they mean the same."""
        self._evaluate()
        if self._last is not None and not self._integers(self._last)["path.phase"]:
            self._finish(self._last)
        last = self._last
        integers = {} if last is None else self._integers(last)
        timing = dict.fromkeys(_TIMING, 0.0) if last is None else dict(zip(_TIMING, last.timing.tolist(), strict=True))
        tripped = integers.get("trip", 0)
        worst = self.worst
        return {
            "steps": 0 if last is None else last.step,
            "plans": {
                "accepted": integers.get("plan.count", 0),
                "refused": integers.get("plan.refused", 0),
                "cancelled": integers.get("plan.cancelled", 0),
                "arrived": self.arrived,
                "corners": self.corners,
                "corners_kept": self.kept,
                "worst": worst and _pass_facts(worst),
                "newest": [
                    {
                        "plan": begun.number,
                        "pick_m": list(begun.task.pick),
                        "place_m": list(begun.task.place),
                        "lift_m": list(begun.task.lift),
                        "corner_deviation_m": list(begun.task.corner_deviation),
                        "payload_kg": begun.payload,
                        "corners": [_pass_facts(passed) for passed in corners],
                    }
                    for begun, corners in self.newest
                ],
            },
            "executed": {
                "tracking_error_tcp_max_m": self._error_max,
                "trip": variable_table("plant").items("Trip")[tripped],
                "trip_time_s": float(last.plant_floats[_TRIP_TIME]) if last is not None and tripped else None,
                "trip_axis": integers.get("trip_axis", 0),
            },
            "timing": {
                "step_max_us": 1e6 * self._step_max,
                "step_histogram_us": {"up_to": list(HISTOGRAM_US), "count": self._step_us.tolist()},
                "lateness_max_us": 1e6 * self._lateness_max,
                "lateness_histogram_us": {"up_to": list(HISTOGRAM_US), "count": self._lateness_us.tolist()},
                **deadline_facts(timing, self._priority),
            },
        }

    @staticmethod
    def _integers(frame: Frame) -> dict[str, int]:
        """Integers of both FMUs by name."""
        planner = zip(_PLANNER, frame.planner_integers.tolist(), strict=True)
        return dict(planner) | dict(zip(_PLANT, frame.plant_integers.tolist(), strict=True))

    def _evaluate(self) -> None:
        """Evaluate the frames that have come; the last ones stay for the next time."""
        frames = self._frames
        new = frames if self._last is None else [frame for frame in frames if frame.step > self._last.step]
        if not new:
            return
        self._evaluate_corners(frames)
        trace = Trace(new)
        steps = trace.timing_of("planner_step") + trace.timing_of("plant_step")
        lateness = trace.timing_of("lateness")
        error = trace["planner", "tcp_position"] - trace["plant", "tcp_position"]
        self._step_max = max(self._step_max, float(steps.max()))
        self._lateness_max = max(self._lateness_max, float(lateness.max()))
        self._error_max = max(self._error_max, float(np.linalg.norm(error, axis=1).max()))
        counted = slice(1 if self._last is None else 0, None)  # frame 0 is not a step
        self._step_us += histogram((1e6 * steps[counted]).tolist())
        self._lateness_us += histogram((1e6 * lateness[counted]).tolist())
        self._last = new[-1]
        self._frames = frames[-_OVERLAP:]

    def _evaluate_corners(self, frames: list[Frame]) -> None:
        while self._begun and self._begun[0].step <= frames[-1].step:
            begins = self._begun.popleft()
            before = [frame for frame in frames if frame.step < begins.step]
            self._approach(before)
            self._finish(before[-1] if before else frames[0])  # a trip behind it is the next plan's
            self._running, self._nearest = begins, [_Approach(), _Approach()]
        self._approach(frames)

    def _approach(self, frames: list[Frame]) -> None:
        """How near to its vertices the running plan has come in these frames."""
        running = self._running
        of_it = [] if running is None else [frame for frame in frames if frame.step >= running.step]
        if running is None or len(of_it) < 2:
            return
        trace = Trace(of_it)
        tool = trace["plant", "tcp_position"], trace["plant", "tcp_velocity"]
        for side, vertex in enumerate(running.vertices):
            distance, time, point = nearest_point(trace.time, *tool, vertex)
            if distance < self._nearest[side].distance:
                self._nearest[side] = _Approach(distance, time, tuple(point.tolist()))

    def _finish(self, now: Frame) -> None:
        """The plan that was running has arrived; a plant that has tripped has not gone with it."""
        running, self._running = self._running, None
        if running is None:
            return
        self.arrived += 1
        if self._integers(now)["trip"]:
            return
        corners: list[Pass] = []
        self.newest.append((running, corners))
        for side, (executed, time, point) in enumerate(self._nearest):
            if running.planned[side] == 0.0:
                continue
            prescribed = running.task.corner_deviation[side]
            passed = Pass(running.number, side, prescribed, running.planned[side], executed, time, point)
            corners.append(passed)
            self.corners += 1
            self.kept += passed.excess <= self._tolerance
            if self.worst is None or passed.excess > self.worst.excess:
                self.worst = passed


def _pass_facts(passed: Pass) -> dict[str, Any]:
    return {
        "plan": passed.plan,
        "side": passed.side,
        "prescribed_m": passed.prescribed,
        "planned_m": passed.planned,
        "executed_m": passed.executed,
        "time_s": passed.time,
        "nearest_m": list(passed.nearest),
    }
