"""What the importer yields at each communication point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol, get_args, overload

import numpy as np
from numpy.typing import NDArray

from deltaph.variables import Model, variable_table

Command = Literal["none", "ppo", "hold", "resume", "stop", "feed"]
Outcome = Literal["none", "accepted", "infeasible", "busy", "stopped", "tripped", "invalid", "failed"]

COMMANDS: tuple[Command, ...] = get_args(Command)
"""What a cell that serves can be told; numbered from 0 in this order, only ever appended to. `none` is a query to no single one."""

OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
"""What became of a command; numbered from 0 in this order, only ever appended to."""

NO_COMMANDS = np.zeros((len(COMMANDS), len(OUTCOMES)), dtype=np.int32)
NO_COMMANDS.setflags(write=False)


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
        commands: how many commands so far had which outcome (COMMANDS, OUTCOMES); the same array as long as no more come.
    """

    step: int
    time: float
    unix_time_ns: int
    planner_floats: NDArray[np.float64]
    planner_integers: NDArray[np.int32]
    plant_floats: NDArray[np.float64]
    plant_integers: NDArray[np.int32]
    timing: NDArray[np.float64]
    commands: NDArray[np.int32] = NO_COMMANDS


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


_MODELS: tuple[Model, ...] = ("planner", "plant")


Outputs = tuple[NDArray[np.float64], NDArray[np.int32]]
"""Of an FMU at a communication point: Float64 and others, in table order."""


class FrameStore(Protocol):
    """Where the importer keeps frames."""

    def append(self, time: float, unix_time_ns: int, planner: Outputs, plant: Outputs, timing: Sequence[float]) -> Frame:
        """Copy the outputs of both FMUs into the next row; returns the frame that shows it."""
        ...


class Frames(Sequence[Frame]):
    """The frames of a run, in memory that is allocated and touched before the first step: some 1.2 KB each.

    Args:
        count: frames that fit.
        first: step of the first one.
    """

    def __init__(self, count: int, first: int = 0) -> None:
        self._first = first
        self._arrays: dict[str, NDArray[np.float64] | NDArray[np.int32]] = {"timing": np.empty((count, len(TIMING)))}
        for model in _MODELS:
            outputs = variable_table(model).of("output")
            floats = sum(v.is_float for v in outputs)
            self._arrays[f"{model}_floats"] = np.empty((count, floats))
            self._arrays[f"{model}_integers"] = np.empty((count, len(outputs) - floats), dtype=np.int32)
        self._time, self._unix_time_ns = np.empty(count), np.empty(count, dtype=np.int64)
        for array in (*self._arrays.values(), self._time, self._unix_time_ns):
            array.fill(0)  # memory of the system is none yet: the first write to a page is a fault
        self._views = {name: array.view() for name, array in self._arrays.items()}
        for view in self._views.values():
            view.setflags(write=False)
        self._length = 0

    def append(
        self,
        time: float,
        unix_time_ns: int,
        planner: Outputs,
        plant: Outputs,
        timing: Sequence[float],
        commands: NDArray[np.int32] = NO_COMMANDS,
    ) -> Frame:
        """Copy the outputs of both FMUs into the next row; returns the frame that shows it."""
        n = self._length
        arrays = self._arrays
        arrays["planner_floats"][n], arrays["planner_integers"][n] = planner
        arrays["plant_floats"][n], arrays["plant_integers"][n] = plant
        arrays["timing"][n] = timing
        self._time[n], self._unix_time_ns[n] = time, unix_time_ns
        self._length = n + 1
        return self._frame(n, commands)

    def column(self, what: str) -> NDArray[np.float64]:
        """One field of all frames (frames, ...), not copied."""
        if what == "time":
            return self._time[: self._length]
        if what == "commands":
            return np.broadcast_to(NO_COMMANDS, (self._length, *NO_COMMANDS.shape))
        return self._views[what][: self._length]  # type: ignore[return-value]

    def __len__(self) -> int:
        return self._length

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        if isinstance(index, slice):
            return [self._frame(n) for n in range(*index.indices(self._length))]
        if not -self._length <= index < self._length:
            raise IndexError(index)
        return self._frame(index % self._length)

    def _frame(self, n: int, commands: NDArray[np.int32] = NO_COMMANDS) -> Frame:
        views = {name: view[n] for name, view in self._views.items()}
        return Frame(self._first + n, float(self._time[n]), int(self._unix_time_ns[n]), **views, commands=commands)


BLOCK_FRAMES = 256
"""A block is some 0.3 MB, which takes the step loop some 0.1 ms to allocate and touch."""


class RecentFrames:
    """The frames of a run without an end, in blocks that are freed when the last frame of theirs is: sinks decide what is kept.

    Attributes:
        commands: of the frames to come.
    """

    def __init__(self) -> None:
        self.commands = NO_COMMANDS
        self._block = Frames(BLOCK_FRAMES)
        self._next = 0

    def append(self, time: float, unix_time_ns: int, planner: Outputs, plant: Outputs, timing: Sequence[float]) -> Frame:
        """Copy the outputs of both FMUs into the next row; returns the frame that shows it."""
        if len(self._block) == BLOCK_FRAMES:
            self._block = Frames(BLOCK_FRAMES, self._next)
        self._next += 1
        return self._block.append(time, unix_time_ns, planner, plant, timing, self.commands)


def columns(frames: Sequence[Frame], what: str) -> NDArray[np.float64]:
    """One field of many frames (frames, ...)."""
    if isinstance(frames, Frames):
        return frames.column(what)
    return np.array([getattr(frame, what) for frame in frames])
