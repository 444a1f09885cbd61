"""What the importer yields at each communication point."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class Frame(NamedTuple):
    """The outputs of both FMUs at one communication point. Arrays are read-only views of rows that are never written again.

    Attributes:
        step: number of the communication point; 0 is the initial state.
        time: simulation time, start + step * communication step [s].
        unix_time_ns: wall clock when the outputs were read [ns].
        planner_floats: Float64 outputs of the planner in table order, SI (n,).
        planner_integers: all other outputs of the planner in table order (m,).
        plant_floats: Float64 outputs of the plant in table order, SI (n,).
        plant_integers: all other outputs of the plant in table order (m,).
        timing: in the order of TIMING (k,).
    """

    step: int
    time: float
    unix_time_ns: int
    planner_floats: NDArray[np.float64]
    planner_integers: NDArray[np.int32]
    plant_floats: NDArray[np.float64]
    plant_integers: NDArray[np.int32]
    timing: NDArray[np.float64]


TIMING: tuple[tuple[str, str, str], ...] = (
    ("planner_step", "s", "Duration of the planner's step that led to this communication point"),
    ("plant_step", "s", "Duration of the plant's step that led to this communication point"),
    ("publish", "s", "Time the step loop spent handing the previous frame to the sinks"),
    ("lateness", "s", "Wake-up after the deadline of this communication point; 0 when not in real time"),
    ("missed_deadlines", "1", "Communication points so far that were reached later than their deadline and the tolerance"),
    ("real_time_factor", "1", "Simulated time over elapsed time since the first step"),
    ("missed_by_planner", "1", "Of those: the planner's step took too long"),
    ("missed_by_plant", "1", "Of those: the plant's step took too long"),
    ("missed_by_publish", "1", "Of those: handing the frame to the sinks took too long"),
    ("missed_by_exchange", "1", "Of those: what the loop does besides took too long"),
    ("missed_by_system", "1", "Of those: woken late by the system"),
    ("missed_by_consumer", "1", "Of those: woken late while the sinks' threads computed"),
    ("slipped_steps", "1", "Whole steps so far by which the deadlines moved, because nothing is caught up"),
    ("dropped_frames", "1", "Frames so far that a sink did not get: its queue was full, or it had failed"),
)
"""Name, unit and description of the columns of `Frame.timing`."""


class Sink(Protocol):
    """Takes frames, in order. `close` is called once, also after an error or an interrupt."""

    def take(self, frame: Frame) -> None:
        """Take one frame; must not block."""
        ...

    def close(self) -> None:
        """Finish: nothing more will come."""
        ...


class ListSink:
    """Keeps every frame."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def take(self, frame: Frame) -> None:
        """Keep the frame."""
        self.frames.append(frame)

    def close(self) -> None:
        """Nothing to finish."""


def columns(frames: Iterable[Frame], what: str) -> NDArray[np.float64]:
    """Stack one array field of many frames: (frames, columns)."""
    return np.stack([getattr(frame, what) for frame in frames])
