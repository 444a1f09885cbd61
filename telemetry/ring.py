"""A bounded buffer of frames in memory that two processes share, after Dijkstra (EWD 123): two semaphores, and nobody waits."""

from __future__ import annotations

import ctypes
import multiprocessing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltaph.frame import NO_COMMANDS, Frame, record_dtype

CONTEXT = multiprocessing.get_context("spawn")
"""How processes are started: with nothing of this one, whose threads and locks a fork would copy halfway."""

_BATCH = 256  # frames that are copied out at once


class FrameRing:
    """Frames on their way from one process, which puts, to another, which takes; it is handed over when that one is started.

    All memory is there and touched from the beginning. Neither end ever waits for the other: one that is stopped or killed leaves
    the other as it was.

    Args:
        capacity: frames that may wait.

    Raises:
        ValueError: not even one may.
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"capacity is {capacity}: at least one frame must be able to wait")
        self._memory = CONTEXT.RawArray(ctypes.c_byte, capacity * record_dtype().itemsize)
        self._filled = CONTEXT.Semaphore(0)
        self._free = CONTEXT.Semaphore(capacity)
        self._attach()

    def _attach(self) -> None:
        self._records = np.frombuffer(memoryview(self._memory), record_dtype())
        self._columns = [self._records[name] for name in record_dtype().names or ()]
        self._at = 0  # where this end goes on
        self._commands = NO_COMMANDS

    def __getstate__(self) -> tuple[Any, ...]:
        return self._memory, self._filled, self._free

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._memory, self._filled, self._free = state
        self._attach()

    def put(self, frame: Frame) -> bool:
        """Copy a frame in; False where there is no room."""
        if not self._free.acquire(block=False):
            return False
        at = self._at
        for column, value in zip(self._columns, frame, strict=True):
            column[at] = value
        self._at = (at + 1) % len(self._records)
        self._filled.release()
        return True

    def take(self) -> list[Frame]:
        """Copy out the frames that wait, in order, at most some hundreds."""
        room = min(_BATCH, len(self._records) - self._at)
        count = 0
        while count < room and self._filled.acquire(block=False):
            count += 1
        if not count:
            return []
        block = self._records[self._at : self._at + count].copy()
        block.setflags(write=False)
        self._at = (self._at + count) % len(self._records)
        for _ in range(count):
            self._free.release()
        names = block.dtype.names or ()
        scalars = (block[name].tolist() for name in names[:3])
        arrays = (block[name] for name in names[3:-1])
        return list(map(Frame._make, zip(*scalars, *arrays, self._shared(block[names[-1]]), strict=True)))

    def _shared(self, commands: NDArray[np.int32]) -> list[NDArray[np.int32]]:
        """Counts of commands (n, ...) as a frame has them: the same array as long as no more come."""
        found = []
        for at, same in enumerate((commands == np.concatenate([self._commands[None], commands[:-1]])).all(axis=(1, 2)).tolist()):
            if not same:
                self._commands = commands[at].copy()
                self._commands.setflags(write=False)
            found.append(self._commands)
        return found
