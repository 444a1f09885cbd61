"""What a recording shows that telemetry, which knows no kinematics, has to be given."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class Move:
    """A planned pick-and-place operation, SI, base frame. A return, from a place to a pick point, has its pick side first, too.

    Attributes:
        name: for people; empty where there is only one.
        start: where its scene's clock is when it begins, with the rest before the motion [s].
        right_angle_path: pick point, vertex above it, vertex above the place point, place point (4, 3) [m].
        corner_deviation: prescribed, at the two vertices (2,) [m].
        planned_path: points of the planned path (n, 3) [m].
        corner_paths: points of its PH corners, each (n, 3) [m]; empty where the law has none.
        corner_times: when the plan passes the two vertices (2,) [s].
    """

    name: str = ""
    start: float = 0.0
    right_angle_path: FloatArray
    corner_deviation: FloatArray
    planned_path: FloatArray
    corner_paths: Sequence[FloatArray] = ()
    corner_times: FloatArray

    def __post_init__(self) -> None:
        shapes = {"right_angle_path": (4, 3), "corner_deviation": (2,), "corner_times": (2,)}
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"{name} has the shape {np.shape(getattr(self, name))} instead of {shape}")
        for points in (self.planned_path, *self.corner_paths):
            if np.ndim(points) != 2 or np.shape(points)[1] != 3:
                raise ValueError(f"a path has the shape {np.shape(points)} instead of (n, 3)")

    @cached_property
    def vertices(self) -> FloatArray:
        """The vertices of the two corners (2, 3) [m]."""
        return np.asarray(self.right_angle_path, dtype=np.float64)[1:3]

    @cached_property
    def across(self) -> FloatArray:
        """Horizontal direction from pick to place (3,), a unit vector; x where one is above the other."""
        direction = (self.vertices[1] - self.vertices[0]) * [1.0, 1.0, 0.0]
        length = np.linalg.norm(direction)
        unit: FloatArray = direction / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
        return unit

    def seen_from(self, corner: int, points: FloatArray) -> FloatArray:
        """Points (..., 3) [m] in the plane of a corner, relative to its vertex: right and down (..., 2) [mm]."""
        relative = points - self.vertices[corner]
        seen: FloatArray = 1e3 * np.stack([relative @ self.across, -(relative @ UP)], axis=-1)
        return seen


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is known before the run, SI, base frame.

    Attributes:
        title: of the recording.
        law: name of the motion law.
        scenario_json: the scenario.
        moves: the operations in order of time, at least one.
        served: whether moves come from commands: none is known before the end of the recording, where `Recorder.summary` is given
            another scene with those that were run; until then `moves` only tell where to look.
        period: after which the moves repeat [s]; None where what comes after them repeats the last one, there or back.
        clock: times (n,) [s] -> where the clock of the moves is then (n,) [s]; the time, unless they are slowed down.
        tolerance: how far beyond the prescribed deviation an executed path may be [m].
        limits: `joint_velocity`, `joint_acceleration`, `joint_torque`, `motor_torque` or `tcp_speed` -> one value or one per
            joint, SI; infinite where there is none. Limits of what is not recorded are ignored.
        joint_range: least and greatest joint position [rad].
        peaks: quantity, named as in `limits` -> greatest planned value, SI.
        coinciding_joints: joints (1 to 3) that the plan moves alike, so that the line of the last hides those of the others.
        base_points: shoulders (3, 3) [m].
        platform_offsets: from the tool centre point to the forearms' joints on the platform (3, 3) [m].
        elbows: joint positions (n, 3) [rad] -> elbows (n, 3 arms, 3) [m].
        rod_spacing: half the distance between the two rods of a forearm, for the drawing [m].
        payload: what the robot carries, as (from when on the clock [s], mass [kg]); it repeats with the moves.
    """

    title: str
    law: str
    scenario_json: str
    moves: Sequence[Move]
    served: bool = False
    period: float | None = None
    clock: Callable[[FloatArray], FloatArray] = lambda time: time
    tolerance: float = 0.0
    limits: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    joint_range: tuple[float, float] = (-np.inf, np.inf)
    peaks: Mapping[str, float] = field(default_factory=dict)
    coinciding_joints: tuple[int, ...] = ()
    base_points: FloatArray
    platform_offsets: FloatArray
    elbows: Callable[[FloatArray], FloatArray]
    rod_spacing: float = 0.03
    payload: Sequence[tuple[float, float]] = ((0.0, 0.0),)

    def __post_init__(self) -> None:
        if not self.moves:
            raise ValueError("a scene has at least one move")
        for name in ("base_points", "platform_offsets"):
            if np.shape(getattr(self, name)) != (3, 3):
                raise ValueError(f"{name} has the shape {np.shape(getattr(self, name))} instead of (3, 3)")

    def name_of(self, number: int) -> str:
        """What a move is called."""
        return self.moves[number].name or f"move {number + 1}"

    @property
    def corner_deviation(self) -> FloatArray:
        """Prescribed, at the two vertices of each move (moves, 2) [m]."""
        return np.array([move.corner_deviation for move in self.moves])

    def move_at(self, time: FloatArray) -> NDArray[np.intp]:
        """Number of the move that runs at times (n,) [s]; the first before, the last after, unless they repeat."""
        starts = [move.start for move in self.moves]
        return np.maximum(np.searchsorted(starts, self._in_pass(time), side="right") - 1, 0)

    def carried(self, time: FloatArray) -> FloatArray:
        """The mass that the robot carries at times (n,) [s] (n,) [kg]."""
        times, masses = np.array(self.payload).T
        found: FloatArray = masses[np.maximum(np.searchsorted(times, self._in_pass(time), side="right") - 1, 0)]
        return found

    def _in_pass(self, time: FloatArray) -> FloatArray:
        """Where the clock is at times (n,), counted from the last time that the moves began to repeat (n,) [s]."""
        # times are start + n·step: half a microsecond is far above their rounding and far below a step
        clock = self.clock(time) + 5e-7
        return clock if self.period is None else clock % self.period

    def vertex_distance(self, time: FloatArray, position: FloatArray) -> FloatArray:
        """Distance of positions (n, 3) [m] at times (n,) [s] to the nearer vertex of the move that runs (n,) [m]."""
        vertices = np.stack([move.vertices for move in self.moves])[self.move_at(time)]
        distance: FloatArray = np.linalg.norm(position[:, None, :] - vertices, axis=2).min(axis=1)
        return distance


@dataclass(frozen=True, slots=True)
class CornerMark:
    """The closest approach to a vertex in one pass.

    Attributes:
        move: number of the move.
        corner: 0 on the pick side, 1 on the place side.
        planned: smallest distance of the planned path [m].
        executed: of the executed path [m].
        nearest: the executed path's point there (3,) [m].
        time: when [s].
    """

    move: int
    corner: int
    planned: float
    executed: float
    nearest: Sequence[float]
    time: float = 0.0
