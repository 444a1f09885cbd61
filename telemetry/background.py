"""A sink with a thread of its own, so that the step loop never waits for it."""

from __future__ import annotations

import threading
from queue import SimpleQueue

from deltaph.frame import Frame, Sink


class BackgroundSink:
    """Hands frames to another sink in a worker thread, over a queue of limited length.

    Attributes:
        dropped: frames that the sink did not get, because the queue was full or because the sink had failed.

    Args:
        sink: what works in the thread; it is closed by `close`, in the caller's thread.
        capacity: frames that may wait.
    """

    def __init__(self, sink: Sink, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"capacity is {capacity}: at least one frame must be able to wait")
        self.dropped = 0
        self._sink = sink
        self._capacity = capacity
        self._queue: SimpleQueue[Frame | threading.Event | None] = SimpleQueue()
        self._error: BaseException | None = None
        self._lost = 0
        self._closed = False
        self._thread = threading.Thread(target=self._work, name=f"{type(sink).__name__}-worker", daemon=True)
        self._thread.start()

    def take(self, frame: Frame) -> None:
        """Queue a frame, or count it as dropped. Never blocks; to be called from one thread."""
        if self._queue.qsize() >= self._capacity:
            self.dropped += 1
        else:
            self._queue.put(frame)

    def drain(self) -> None:
        """Wait until the sink has taken everything that waits."""
        done = threading.Event()
        self._queue.put(done)
        done.wait()
        self.dropped, self._lost = self.dropped + self._lost, 0

    def close(self) -> None:
        """Drain, end the thread and close the sink. A second call does nothing.

        Raises:
            BaseException: what the sink raised in the thread.
        """
        if self._closed:
            return
        self._closed = True
        self.drain()
        self._queue.put(None)
        self._thread.join()
        try:
            self._sink.close()
        finally:
            if self._error is not None:
                raise self._error

    def _work(self) -> None:
        while (item := self._queue.get()) is not None:
            if isinstance(item, threading.Event):
                item.set()
            elif self._error is not None:
                self._lost += 1
            else:
                try:
                    self._sink.take(item)
                except BaseException as error:  # raised again by close, where somebody listens
                    self._error = error
                    self._lost += 1
