"""A bounded buffer of frames in memory that two processes share, after Dijkstra (EWD 123): two semaphores, and nobody waits."""

from __future__ import annotations

import ctypes
import multiprocessing
from typing import Any

from deltaph.frame import Frame, record_dtype

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
        self._bytes = memoryview(self._memory).cast("B")
        self._size = record_dtype().itemsize
        self._count = len(self._bytes) // self._size
        self._at = 0  # where this end goes on

    def __getstate__(self) -> tuple[Any, ...]:
        return self._memory, self._filled, self._free

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._memory, self._filled, self._free = state
        self._attach()

    def put(self, frame: Frame) -> bool:
        """Copy a frame in; False where there is no room."""
        if not self._free.acquire(False):
            return False
        begin = self._at * self._size
        self._bytes[begin : begin + self._size] = frame.record
        self._at = (self._at + 1) % self._count
        self._filled.release()
        return True

    def take(self) -> list[Frame]:
        """Copy out the frames that wait, in order, at most some hundreds."""
        room = min(_BATCH, self._count - self._at)
        count = 0
        while count < room and self._filled.acquire(block=False):
            count += 1
        begin, size = self._at * self._size, self._size
        block = memoryview(bytes(self._bytes[begin : begin + count * size]))
        self._at = (self._at + count) % self._count
        for _ in range(count):
            self._free.release()
        return [Frame(block[k * size : (k + 1) * size]) for k in range(count)]
