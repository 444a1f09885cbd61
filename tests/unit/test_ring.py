"""The ring, both ends in one process: what crosses a process is in test_sink_process."""

import pytest
from integration.synthetic_cell import random_frame

from deltaph.frame import Frame
from deltaph.telemetry.ring import FrameRing

FRAMES = [random_frame(step) for step in range(50)]


def equal(first: Frame, second: Frame) -> bool:
    return bytes(first.record) == bytes(second.record)


def ends(capacity: int) -> tuple[FrameRing, FrameRing]:
    """Both ends of a ring."""
    putting = FrameRing(capacity)
    taking = FrameRing.__new__(FrameRing)
    taking.__setstate__(putting.__getstate__())
    return putting, taking


def everything(ring: FrameRing) -> list[Frame]:
    found: list[Frame] = []
    while frames := ring.take():
        found += frames
    return found


def test_frames_come_out_as_they_went_in_and_in_order() -> None:
    putting, taking = ends(7)
    for first in range(0, len(FRAMES), 5):  # the ends go round at different places
        group = FRAMES[first : first + 5]
        assert all(putting.put(frame) for frame in group)
        found = everything(taking)
        assert len(found) == len(group)
        assert all(map(equal, found, group))


def test_a_full_ring_takes_no_more_until_there_is_room() -> None:
    putting, taking = ends(10)
    assert [putting.put(frame) for frame in FRAMES[:12]] == [True] * 10 + [False] * 2
    assert [frame.step for frame in everything(taking)] == list(range(10))
    assert putting.put(FRAMES[12])
    assert [frame.step for frame in everything(taking)] == [12]


def test_frames_are_kept_while_the_ring_goes_on() -> None:
    putting, taking = ends(3)
    putting.put(FRAMES[0])
    (kept,) = taking.take()
    for frame in FRAMES[1:4]:
        putting.put(frame)
    assert equal(kept, FRAMES[0])
    assert not kept.planner_floats.flags.writeable


def test_capacity_is_at_least_one() -> None:
    with pytest.raises(ValueError, match="capacity is 0"):
        FrameRing(0)
