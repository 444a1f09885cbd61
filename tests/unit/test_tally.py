"""What a cell without an end counts, beside what a run of the same frames would say."""

from dataclasses import replace

import numpy as np
import pytest
from integration.synthetic_cell import RIGHT_ANGLE_PATH, frames, replaced

from deltaph.execution import nearest_point
from deltaph.frame import Frame
from deltaph.scenario import Task
from deltaph.tally import CHUNK, KEPT, Begun, Tally
from deltaph.variables import variable_table

VERTICES = RIGHT_ANGLE_PATH[1:3]
PRESCRIBED = (0.006, 0.006)
TASK = Task(tuple(RIGHT_ANGLE_PATH[0].tolist()), tuple(RIGHT_ANGLE_PATH[3].tolist()), (0.05, 0.05), PRESCRIBED)


def tool(given: list[Frame]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    groups = [v.group for v in variable_table("plant").of("output") if v.is_float]
    columns = [[k for k, group in enumerate(groups) if group == name] for name in ("tcp_position", "tcp_velocity")]
    rows = np.array([frame.plant_floats for frame in given])
    return np.array([frame.time for frame in given]), rows[:, columns[0]], rows[:, columns[1]]


def repeated(given: list[Frame], times: int) -> list[Frame]:
    """The operation again and again."""
    return [
        replaced(frame, step=k * len(given) + frame.step, time=(k * len(given) + frame.step) / 1000.0)
        for k in range(times)
        for frame in given
    ]


def counted(given: list[Frame], begun: list[Begun], tolerance: float = 0.0) -> Tally:
    tally = Tally(tolerance)
    for plan in begun:
        tally.begin(plan)
    for frame in given:
        tally.take(frame)
    tally.facts()
    return tally


def test_corners_are_those_of_the_whole_motion_wherever_a_chunk_ends() -> None:
    for shift in range(0, CHUNK, 37):  # rest before the motion moves it through the chunks
        motion = frames()
        rest = [replaced(motion[0], step=k, time=k / 1000.0) for k in range(shift)]
        given = rest + [replaced(frame, step=frame.step + shift, time=frame.time + shift / 1000.0) for frame in motion]
        tally = counted(given, [Begun(shift, 1, TASK, 0.0, PRESCRIBED)])
        executed = [nearest_point(*tool(given), vertex)[0] for vertex in VERTICES]
        assert tally.worst is not None
        assert tally.worst.executed == pytest.approx(max(executed), abs=1e-12)
        assert (tally.arrived, tally.corners, tally.kept) == (1, 2, sum(value <= 0.006 for value in executed))


def test_plans_follow_each_other_and_the_worst_is_named() -> None:
    given = repeated(frames(), 5)
    tasks = [replace(TASK, corner_deviation=(0.006 - 0.001 * (k == 2),) * 2) for k in range(5)]
    begun = [Begun(354 * k, k + 1, task, 0.0, PRESCRIBED) for k, task in enumerate(tasks)]
    tally = counted(given, begun, tolerance=1.0)
    assert (tally.arrived, tally.corners, tally.kept) == (5, 10, 10)
    assert tally.worst is not None and tally.worst.plan == 3
    facts = tally.facts()
    assert facts["steps"] == len(given) - 1
    newest = facts["plans"]["newest"]
    assert [plan["plan"] for plan in newest] == [1, 2, 3, 4, 5]
    assert (newest[2]["pick_m"], newest[2]["corner_deviation_m"]) == (list(TASK.pick), [0.005, 0.005])
    for plan in newest:
        for corner, vertex in zip(plan["corners"], VERTICES, strict=True):
            assert np.linalg.norm(corner["nearest_m"] - vertex) == pytest.approx(corner["executed_m"], abs=1e-12)
            assert 0.354 * (plan["plan"] - 1) < corner["time_s"] < 0.354 * plan["plan"]
    assert sum(facts["timing"]["step_histogram_us"]["count"]) == len(given) - 1


def test_a_trip_is_not_laid_on_the_plan_before() -> None:
    given = repeated(frames(), 2)
    trip = [v.name for v in variable_table("plant").of("output") if not v.is_float].index("trip")
    for k, frame in enumerate(given):
        if frame.step >= 354 + 20:
            integers = frame.plant_integers.copy()
            integers[trip] = 1
            given[k] = replaced(frame, plant_integers=integers)
    tally = counted(given, [Begun(0, 1, TASK, 0.0, PRESCRIBED), Begun(354, 2, TASK, 0.0, PRESCRIBED)])
    assert [begun.number for begun, _ in tally.newest] == [1]
    assert tally.corners == 2


def test_plan_that_is_under_way_at_the_end_has_not_arrived() -> None:
    given = [frame for frame in frames() if frame.step < 150]
    tally = counted(given, [Begun(0, 1, TASK, 0.0, PRESCRIBED)])
    assert (tally.arrived, tally.corners, tally.worst) == (0, 0, None)


def test_side_without_a_corner_is_none() -> None:
    tally = counted(frames(), [Begun(0, 1, TASK, 0.0, (0.006, 0.0))])
    assert (tally.arrived, tally.corners) == (1, 1)


def test_memory_does_not_grow() -> None:
    given = [frame for frame in frames() if frame.step % 10 == 0]  # coarse, for many plans
    tally = Tally(0.0)
    for k in range(KEPT + 20):
        tally.begin(Begun(len(given) * k, k + 1, TASK, 0.0, PRESCRIBED))
        for n, frame in enumerate(given):
            step = len(given) * k + n
            tally.take(replaced(frame, step=step, time=step / 100.0))
            assert len(tally._frames) <= CHUNK + 3
    tally.facts()
    assert tally.arrived == KEPT + 20
    assert [begun.number for begun, _ in tally.newest] == list(range(21, KEPT + 21))


def test_nothing_came() -> None:
    facts = counted([], []).facts()
    assert (facts["steps"], facts["plans"]["worst"], facts["executed"]["trip"]) == (0, None, "none")
