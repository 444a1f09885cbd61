"""A sink with a thread of its own, so that the step loop never waits for it."""

from __future__ import annotations

import threading
import time
from collections import deque

from deltaph.frame import Frame, Sink

POLL = 5e-4
"""Between two looks of an idle worker [s]. To wake it would cost the step loop a system call and a fight for the interpreter, tens
of microseconds a frame; that it looks costs the loop nothing."""


class BackgroundSink:
    """Hands frames to another sink in a worker thread, over a queue of limited length.

    Args:
        sink: what works in the thread; `close` closes it, in the caller's thread.
        capacity: frames that may wait.
        poll: between two looks of the idle worker [s].
    """

    def __init__(self, sink: Sink, capacity: int, poll: float = POLL) -> None:
        if capacity < 1:
            raise ValueError(f"capacity is {capacity}: at least one frame must be able to wait")
        self._sink = sink
        self._capacity = capacity
        self._poll = poll
        self._queue: deque[Frame | threading.Event | None] = deque()
        self._refused = 0  # written by the caller's thread
        self._lost = 0  # written by the worker
        self._error: BaseException | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name=type(sink).__name__, daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Frames that the sink did not get: the queue was full, or the sink had failed."""
        return self._refused + self._lost

    def take(self, frame: Frame) -> None:
        """Queue a frame, or count it as dropped. Never blocks; to be called from one thread."""
        if len(self._queue) >= self._capacity:
            self._refused += 1
        else:
            self._queue.append(frame)

    def drain(self) -> None:
        """Wait until the sink has taken all that waits."""
        reached = threading.Event()
        self._queue.append(reached)
        reached.wait()

    def close(self) -> None:
        """Drain, end the thread, close the sink. A second call does nothing.

        Raises:
            BaseException: what the sink raised in the thread.
        """
        if self._closed:
            return
        self.drain()
        self._queue.append(None)
        self._thread.join()
        self._closed = True
        try:
            self._sink.close()
        finally:
            if self._error is not None:
                raise self._error

    def _work(self) -> None:
        while (item := self._next()) is not None:
            if isinstance(item, threading.Event):
                item.set()
            elif self._error is not None:
                self._lost += 1
            else:
                try:
                    self._sink.take(item)
                except BaseException as error:  # close raises it, where somebody listens
                    self._error = error
                    self._lost += 1

    def _next(self) -> Frame | threading.Event | None:
        while not self._queue:
            time.sleep(self._poll)
        return self._queue.popleft()
