"""The memory of a run's frames."""

import weakref

import numpy as np
import pytest
from integration.synthetic_cell import random_frame

from deltaph.frame import BLOCK_FRAMES, Frame, Frames, RecentFrames, columns, record_dtype

GIVEN = [random_frame(step) for step in range(5)]


def kept(given: list[Frame], room: int) -> Frames:
    frames = Frames(room)
    for frame in given:
        planner, plant = (frame.planner_floats, frame.planner_integers), (frame.plant_floats, frame.plant_integers)
        frames.append(frame.time, frame.unix_time_ns, planner, plant, frame.timing.tolist())
    return frames


def test_frames_come_back_as_they_were_given() -> None:
    frames = kept(GIVEN, 7)
    assert len(frames) == len(GIVEN)
    for found, given in zip(frames, GIVEN, strict=True):
        for name in record_dtype().names or ():
            np.testing.assert_array_equal(getattr(found, name), getattr(given, name))
    assert frames[-1].step == 4
    assert [frame.step for frame in frames[1:3]] == [1, 2]
    with pytest.raises(IndexError):
        frames[5]


def test_columns_are_those_of_a_list_of_frames() -> None:
    frames = kept(GIVEN, 7)
    for name in record_dtype().names or ():
        np.testing.assert_array_equal(columns(frames, name), columns(GIVEN, name))
        assert columns(frames, name).dtype == columns(GIVEN, name).dtype


def test_a_frame_cannot_be_written() -> None:
    frame = kept(GIVEN, 5)[0]
    with pytest.raises(ValueError, match="read-only"):
        frame.plant_floats[0] = 1.0


def test_recent_frames_live_as_long_as_somebody_keeps_one_of_their_block() -> None:
    recent = RecentFrames()
    kept, blocks = [], []
    for n in range(5 * BLOCK_FRAMES):
        given = GIVEN[n % len(GIVEN)]
        planner, plant = (given.planner_floats, given.planner_integers), (given.plant_floats, given.plant_integers)
        frame = recent.append(float(n), n, planner, plant, given.timing.tolist())
        assert (frame.step, frame.time) == (n, float(n))
        if n % BLOCK_FRAMES == 0:
            assert isinstance(frame.record, memoryview)
            blocks.append(weakref.ref(frame.record.obj))
        if n == BLOCK_FRAMES + 7:
            kept.append(frame)
        del frame
    alive = [block() is not None for block in blocks]
    assert alive == [False, True, False, False, True]  # the one that is kept, and the one that is written
    np.testing.assert_array_equal(kept[0].plant_floats, GIVEN[(BLOCK_FRAMES + 7) % len(GIVEN)].plant_floats)
    kept.clear()
    assert blocks[1]() is None
