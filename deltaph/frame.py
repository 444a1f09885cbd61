"""What the importer yields at each communication point."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache
from typing import Any, Literal, Protocol, get_args, overload

import numpy as np
from numpy.typing import NDArray

from deltaph.variables import variable_table

Command = Literal["none", "ppo", "hold", "resume", "stop", "feed"]
Outcome = Literal["none", "accepted", "infeasible", "busy", "stopped", "tripped", "invalid", "failed"]

COMMANDS: tuple[Command, ...] = get_args(Command)
"""What a cell that serves can be told; numbered from 0 in this order, only ever appended to. `none` is a query to no single one."""

OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
"""What became of a command; numbered from 0 in this order, only ever appended to."""

NO_COMMANDS = np.zeros((len(COMMANDS), len(OUTCOMES)), dtype=np.int32)
NO_COMMANDS.setflags(write=False)

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
    ("slipped_steps", "1", "Whole steps so far by which the deadlines moved, because nothing is caught up"),
    ("dropped_frames", "1", "Frames so far that a sink did not get: there was no room, or it had failed"),
)
"""Name, unit and description of the columns of `Frame.timing`."""


_HEAD = struct.Struct("=qdq")
_TIMING = struct.Struct(f"={len(TIMING)}d")

Buffer = bytes | bytearray | memoryview

Outputs = tuple[NDArray[np.float64], NDArray[np.int32]]
"""Of an FMU in table order: the Float64 ones, SI, and all others."""


@cache
def record_dtype() -> np.dtype[np.void]:
    """How a frame lies in memory, some 1 KB: its attributes in an order that leaves no gaps."""
    outputs = {model: variable_table(model).of("output") for model in ("planner", "plant")}
    floats = {model: sum(v.is_float for v in of_model) for model, of_model in outputs.items()}
    return np.dtype(
        [
            ("step", "i8"),
            ("time", "f8"),
            ("unix_time_ns", "i8"),
            *((f"{model}_floats", "f8", (floats[model],)) for model in outputs),
            ("timing", "f8", (len(TIMING),)),
            *((f"{model}_integers", "i4", (len(outputs[model]) - floats[model],)) for model in outputs),
            ("commands", "i4", NO_COMMANDS.shape),
        ]
    )


@cache
def _place(name: str) -> tuple[np.dtype[Any], int, int, tuple[int, ...]]:
    """Where an array of a frame lies: type, count, offset, shape."""
    fields = record_dtype().fields
    assert fields is not None
    field, offset = fields[name][:2]
    return field.base, int(np.prod(field.shape)), offset, field.shape


class Frame:
    """The outputs of both FMUs at one communication point: one record, of which the attributes are views.

    Attributes:
        record: the whole of it, as `record_dtype` has it.

    Args:
        record: likewise; not to be written any more.
    """

    __slots__ = ("record",)

    def __init__(self, record: Buffer) -> None:
        self.record = record

    @property
    def step(self) -> int:
        """Number of the communication point; 0 is the initial state."""
        return int(_HEAD.unpack_from(self.record)[0])

    @property
    def time(self) -> float:
        """Simulation time, start + step * communication step [s]."""
        return float(_HEAD.unpack_from(self.record)[1])

    @property
    def unix_time_ns(self) -> int:
        """Wall clock when the outputs were read [ns]."""
        return int(_HEAD.unpack_from(self.record)[2])

    @property
    def planner_floats(self) -> NDArray[np.float64]:
        """Float64 outputs of the planner in table order, SI (n,)."""
        return self._array("planner_floats")

    @property
    def planner_integers(self) -> NDArray[np.int32]:
        """All other outputs of the planner in table order (m,)."""
        return self._array("planner_integers")

    @property
    def plant_floats(self) -> NDArray[np.float64]:
        """Float64 outputs of the plant in table order, SI (n,)."""
        return self._array("plant_floats")

    @property
    def plant_integers(self) -> NDArray[np.int32]:
        """All other outputs of the plant in table order (m,)."""
        return self._array("plant_integers")

    @property
    def timing(self) -> NDArray[np.float64]:
        """In the order of TIMING (k,)."""
        return self._array("timing")

    @property
    def commands(self) -> NDArray[np.int32]:
        """How many commands so far had which outcome (COMMANDS, OUTCOMES)."""
        return self._array("commands")

    def _array(self, name: str) -> NDArray[Any]:
        dtype, count, offset, shape = _place(name)
        return np.frombuffer(self.record, dtype, count, offset).reshape(shape)


def pack(
    step: int,
    time: float,
    unix_time_ns: int,
    planner: Outputs,
    plant: Outputs,
    timing: Sequence[float],
    commands: NDArray[np.int32] = NO_COMMANDS,
) -> bytes:
    """The record of a frame with these attributes. The arrays are of the types that `record_dtype` has."""
    head, times = _HEAD.pack(step, time, unix_time_ns), _TIMING.pack(*timing)
    parts: Any = head, planner[0], plant[0], times, planner[1], plant[1], commands  # arrays are buffers, says Python 3.12
    return b"".join(parts)


def records(frames: Sequence[Frame]) -> NDArray[np.void]:
    """Frames as one structured array (frames,), copied."""
    return np.frombuffer(bytearray().join(frame.record for frame in frames), record_dtype())


class Sink(Protocol):
    """Takes frames, in order. `close` is called once, also after an error or an interrupt."""

    def take(self, frame: Frame) -> None:
        """Take one frame; must not block."""
        ...

    def close(self) -> None:
        """Finish: nothing more will come."""
        ...


class FrameStore(Protocol):
    """Where the importer keeps frames."""

    def append(self, time: float, unix_time_ns: int, planner: Outputs, plant: Outputs, timing: Sequence[float]) -> Frame:
        """Copy the outputs of both FMUs into the next record; returns the frame that shows it."""
        ...


class Frames(Sequence[Frame]):
    """The frames of a run, in memory that is allocated and touched before the first step.

    Attributes:
        commands: of the frames to come; copied into each.

    Args:
        count: frames that fit.
        first: step of the first one.
    """

    def __init__(self, count: int, first: int = 0) -> None:
        self.commands = NO_COMMANDS
        self._first = first
        self._length = 0
        self._records = np.empty(count, record_dtype())
        memory = self._records.view(np.uint8)
        memory.fill(0)  # memory of the system is none yet: the first write to a page is a fault
        self._memory = memoryview(memory)  # type: ignore[arg-type]
        self._shown = self._memory.toreadonly()

    def append(self, time: float, unix_time_ns: int, planner: Outputs, plant: Outputs, timing: Sequence[float]) -> Frame:
        """Copy the outputs of both FMUs into the next record; returns the frame that shows it."""
        n = self._length
        self._memory[self._place(n)] = pack(self._first + n, time, unix_time_ns, planner, plant, timing, self.commands)
        self._length = n + 1
        return Frame(self._shown[self._place(n)])

    def column(self, what: str) -> NDArray[Any]:
        """One attribute of all frames (frames, ...), not copied."""
        return self._records[: self._length][what]

    def __len__(self) -> int:
        return self._length

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        if isinstance(index, slice):
            return [Frame(self._shown[self._place(n)]) for n in range(*index.indices(self._length))]
        if not -self._length <= index < self._length:
            raise IndexError(index)
        return Frame(self._shown[self._place(index % self._length)])

    @staticmethod
    def _place(n: int) -> slice:
        size = record_dtype().itemsize
        return slice(n * size, (n + 1) * size)


BLOCK_FRAMES = 256
"""A block is some 0.3 MB, which takes the step loop some 0.1 ms to allocate and touch."""


class RecentFrames:
    """The frames of a run without an end, in blocks that are freed when the last frame of theirs is: sinks decide what is kept.

    Attributes:
        commands: of the frames to come; copied into each.
    """

    def __init__(self) -> None:
        self.commands = NO_COMMANDS
        self._block = Frames(BLOCK_FRAMES)
        self._next = 0

    def append(self, time: float, unix_time_ns: int, planner: Outputs, plant: Outputs, timing: Sequence[float]) -> Frame:
        """Copy the outputs of both FMUs into the next record; returns the frame that shows it."""
        if len(self._block) == BLOCK_FRAMES:
            self._block = Frames(BLOCK_FRAMES, self._next)
        self._next += 1
        self._block.commands = self.commands
        return self._block.append(time, unix_time_ns, planner, plant, timing)


def columns(frames: Sequence[Frame], what: str) -> NDArray[Any]:
    """One attribute of many frames (frames, ...)."""
    if isinstance(frames, Frames):
        return frames.column(what)
    return records(frames)[what]
