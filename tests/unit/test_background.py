import threading

import pytest
from integration.synthetic_cell import random_frame

from deltaph.frame import Frame, ListSink
from deltaph.telemetry import BackgroundSink

FRAMES = [random_frame(step) for step in range(50)]
DEADLINE = 10.0


class Gate(ListSink):
    """Lets a frame through when it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self.entered = threading.Event()
        self.open = threading.Event()
        self.closed_in: threading.Thread | None = None

    def take(self, frame: Frame) -> None:
        self.entered.set()
        assert self.open.wait(DEADLINE)
        super().take(frame)

    def close(self) -> None:
        self.closed_in = threading.current_thread()


class Broken(ListSink):
    """Fails at the third frame."""

    closed = False

    def take(self, frame: Frame) -> None:
        if frame.step == 2:
            raise OSError("the disk is full")
        super().take(frame)

    def close(self) -> None:
        self.closed = True


def test_all_frames_arrive_in_order_in_another_thread() -> None:
    gate = Gate()
    gate.open.set()
    sink = BackgroundSink(gate, capacity=100)
    for frame in FRAMES:
        sink.take(frame)
    sink.close()
    assert [frame.step for frame in gate.frames] == [frame.step for frame in FRAMES]
    assert sink.dropped == 0
    assert gate.closed_in is threading.current_thread()


def test_full_queue_never_blocks_and_is_counted() -> None:
    gate = Gate()
    sink = BackgroundSink(gate, capacity=10)
    sink.take(FRAMES[0])
    assert gate.entered.wait(DEADLINE)  # one is at work, the queue is empty
    for frame in FRAMES[1:]:
        sink.take(frame)
    assert sink.dropped == len(FRAMES) - 11
    gate.open.set()
    sink.close()
    assert [frame.step for frame in gate.frames] == list(range(11))


def test_drain_waits_for_what_was_taken() -> None:
    gate = Gate()
    sink = BackgroundSink(gate, capacity=100)
    for frame in FRAMES:
        sink.take(frame)
    gate.open.set()
    sink.drain()
    assert len(gate.frames) == len(FRAMES)
    sink.close()


def test_error_in_the_thread_comes_out_of_close() -> None:
    broken = Broken()
    sink = BackgroundSink(broken, capacity=100)
    for frame in FRAMES:
        sink.take(frame)
    with pytest.raises(OSError, match="the disk is full"):
        sink.close()
    assert broken.closed
    assert [frame.step for frame in broken.frames] == [0, 1]
    assert sink.dropped == len(FRAMES) - 2
    sink.close()


def test_capacity_is_at_least_one() -> None:
    with pytest.raises(ValueError, match="capacity is 0"):
        BackgroundSink(ListSink(), 0)
