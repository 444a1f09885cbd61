"""Sequences of parts: moves from a scenario, their schedule, and what is wrong with one said by the number of the part."""

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from deltaph.errors import InfeasibleError, ScenarioError
from deltaph.feed import FeedClock
from deltaph.scenario import Scenario, parse_scenario, scenario_from_json
from deltaph.schedule import schedule

PATH = Path("test.toml")

HEAD = """
schema = 1
title = "three parts"

[task]
lift_mm = 50.0
corner_deviation_mm = [6.0, 5.0]

[payload]
mass_kg = 0.2
"""

PARTS = """
[sequence]
grip_ms = 20.0
release_ms = 9.5
parts = [
    { pick_mm = [-150.0, 0.0, -800.0], place_mm = [150.0, 0.0, -800.0] },
    { pick_mm = [-150, 40, -800], place_mm = [150, 40, -780], lift_place_mm = 30.0, payload_mass_kg = 0.5, release_ms = 0.0 },
    { pick_mm = [-150.0, 80.0, -790.0], place_mm = [150.0, 80.0, -790.0], corner_deviation_mm = 3.0, grip_ms = 30.0 },
]
"""


def sequence(head: str = HEAD, parts: str = PARTS) -> Scenario:
    return parse_scenario(head + parts, PATH)


def test_every_part_is_followed_by_the_empty_way_to_the_next_and_the_last_to_the_first() -> None:
    moves = sequence().moves
    assert [move.name for move in moves] == [
        "part 1", "return 1", "part 2", "return 2", "part 3", "return 3",
    ]  # fmt: skip
    for move, following in zip(moves, [*moves[1:], moves[0]], strict=True):
        assert move.task.place == following.task.pick
    assert [move.payload for move in moves] == [0.2, 0.0, 0.5, 0.0, 0.2, 0.0]
    assert [move.declared_payload for move in moves] == [0.2, 0.0, 0.5, 0.0, 0.2, 0.0]
    assert [move.task.dwell for move in moves] == [0.02, 0.0095, 0.02, 0.0, 0.03, 0.0095]
    assert [move.is_return for move in moves] == [False, True] * 3


def test_a_part_has_what_the_task_has_unless_it_says_otherwise() -> None:
    first, _, second, _, third, _ = (move.task for move in sequence().moves)
    assert first.lift == (0.05, 0.05)
    assert second.lift == (0.05, 0.03)
    assert first.corner_deviation == second.corner_deviation == (0.006, 0.005)
    assert third.corner_deviation == (0.003, 0.003)
    fixed = HEAD.replace("lift_mm", "pick_mm = [-150.0, 0.0, -800.0]\nlift_mm")
    places = "[sequence]\nparts = [ { place_mm = [150.0, 0.0, -800.0] }, { place_mm = [150.0, 40.0, -800.0] } ]"
    assert {move.task.pick for move in sequence(fixed, places).moves if not move.is_return} == {(-0.15, 0.0, -0.8)}


def test_operations_follow_each_other_with_their_rests() -> None:
    run = schedule(sequence())
    assert [operation.plan.dwell_ms for operation in run.operations] == [20, 10, 20, 0, 30, 10]  # rounded up
    for operation, following in pairwise(run.operations):
        assert operation.end_ms == following.begin_ms
        assert following.start_ms == following.begin_ms + following.plan.dwell_ms
        # asked for while the forerunner runs, as early as it can wait
        assert operation.begin_ms < following.request_step <= operation.begin_ms + 1
    assert run.steps == run.operations[-1].end_ms + 50
    assert run.cycle_time == run.operations[-1].end_ms / 1000.0
    assert run.parts_per_minute == pytest.approx(3 * 60.0 / run.cycle_time)


def test_parts_come_and_go_half_way_through_a_rest() -> None:
    run = schedule(sequence())
    changes = [(0.0, 0.0)] + [(0.0005 * (o.begin_ms + o.start_ms), o.move.payload) for o in run.operations]
    assert run.payload_changes == changes
    assert changes[1] == (0.01, 0.2)


def test_cycles_repeat_the_sequence() -> None:
    once, twice = schedule(sequence()), schedule(sequence(), cycles=2)
    assert [o.move for o in twice.operations] == [o.move for o in once.operations] * 2
    assert twice.operations[6].begin_ms == once.operations[5].end_ms
    assert twice.cycle_time == once.cycle_time
    assert [o.begin_ms for o in twice.one_pass] == [o.begin_ms for o in once.operations]


def test_a_part_that_cannot_be_planned_is_named() -> None:
    with pytest.raises(InfeasibleError, match=r"^part 3: corner deviation 30 mm does not fit lift height 50 mm"):
        schedule(sequence(HEAD, PARTS.replace("corner_deviation_mm = 3.0", "corner_deviation_mm = 30.0")))
    with pytest.raises(InfeasibleError, match=r"^part 2: the traverse would not be level.*change a lift height by 20 mm"):
        schedule(sequence(HEAD, PARTS.replace("lift_place_mm = 30.0, ", "")))
    beside = PARTS.replace("pick_mm = [-150, 40, -800], place_mm = [150,", "pick_mm = [150, 5, -800], place_mm = [-150,")
    with pytest.raises(InfeasibleError, match=r"^return 1: the corners take .* only 5 mm apart"):
        schedule(sequence(HEAD, beside))
    slow = sequence(HEAD + "[limits]\njoint_velocity_rad_s = 4.25\n")
    with pytest.raises(InfeasibleError, match=r"^part 1: joint \d velocity reaches .* beyond the limit of 4.25"):
        schedule(slow).require_within(slow.limits)


@pytest.mark.parametrize("feed", ["", "[[feed]]\ntime_ms = 100.0\noverride = 0.3\n[[feed]]\ntime_ms = 700.0\noverride = 1.0\n"])
def test_the_planners_clock(feed: str) -> None:
    run = schedule(sequence(HEAD + feed))
    nominal = schedule(sequence())
    begins = [clock for o in nominal.operations for clock in (o.begin_ms, o.start_ms, o.end_ms)]
    times = [time for o in run.operations for time in (o.begin_ms, o.start_ms, o.end_ms)]
    np.testing.assert_allclose(1000.0 * run.clock.at(np.array(times) / 1000.0), begins, atol=1e-9)
    late = np.array(times) - begins
    if feed:  # 0.7 of 600 ms are lost in the end: the filter gives back when it speeds up what it takes when it slows down
        assert late[0] == 0.0
        assert late[-1] == pytest.approx(420.0, abs=1e-6)
    else:
        assert (late == 0.0).all()


def test_a_clock_that_stands_still_goes_on() -> None:
    clock = FeedClock([(100, 0.0), (1100, 1.0)])
    still = 1000.0 * float(clock.at(np.array([0.9]))[0])
    assert still == pytest.approx(100.0 + 2 * 1000.0 / 50.0, abs=1e-6)  # 2/w: what the filter lets pass before it stands
    assert clock.reaches(still - 1.0) < 900.0
    assert clock.reaches(still + 1.0) > 1100.0
    assert clock.reaches(500.0) == pytest.approx(1500.0, abs=1e-6)


@pytest.mark.parametrize("changes", [[], [(100, 0.5)], [(50, 0.2), (310, 1.0)]])
def test_a_paused_clock_stands_and_then_goes_on(changes: list[tuple[int, float]]) -> None:
    clock = FeedClock(changes)
    paused = clock.paused(60.0, 80.0).paused(300.0, 330.5)
    ms = np.arange(0.0, 600.0, 0.5)
    lost = np.zeros_like(ms)
    for begin, end in ((60.0, 80.0), (300.0, 330.5)):
        lost += clock.at(np.clip(ms, begin, end) / 1000.0) - clock.at(np.array([begin / 1000.0]))
    np.testing.assert_allclose(paused.at(ms / 1000.0), clock.at(ms / 1000.0) - lost, atol=1e-12)
    stands = 1000.0 * float(paused.at(np.array([0.07]))[0])
    assert paused.reaches(stands) == pytest.approx(60.0, abs=1e-9)  # the first time it is there
    assert paused.reaches(stands + 1e-6) > 80.0
    assert paused.reaches(500.0) == pytest.approx(clock.reaches(500.0 + 1000.0 * lost[-1]), abs=1e-9)


def test_returns_are_as_high_as_the_higher_neighbour_and_bend_as_their_points_ask() -> None:
    for move in sequence().moves:
        begin, end = move.task.pick[2] + move.task.lift[0], move.task.place[2] + move.task.lift[1]
        assert math.isclose(begin, end, abs_tol=1e-12)
    moves = [move.task for move in sequence().moves]
    assert moves[1].pick[2] + moves[1].lift[0] == pytest.approx(-0.75)
    assert moves[3].pick[2] + moves[3].lift[0] == pytest.approx(-0.74)  # from -0.75 to -0.74
    assert moves[1].corner_deviation == (0.005, 0.006)
    assert moves[3].corner_deviation == (0.005, 0.003)
    assert moves[5].corner_deviation == (0.003, 0.006)


def test_a_part_that_is_picked_up_where_the_last_one_was_put_down_needs_no_return() -> None:
    parts = """
[sequence]
grip_ms = 20.0
release_ms = 10.0
parts = [
    { pick_mm = [-150.0, 0.0, -800.0], place_mm = [0.0, 150.0, -800.0] },
    { pick_mm = [0.0, 150.0, -800.0], place_mm = [150.0, 0.0, -800.0] },
]
"""
    moves = sequence(HEAD, parts).moves
    assert [(move.name, move.task.dwell) for move in moves] == [("part 1", 0.02), ("part 2", 0.03), ("return 2", 0.01)]


def test_the_scenario_that_a_cell_publishes_is_the_scenario() -> None:
    published = scenario_from_json(sequence().json)
    assert published.moves == sequence().moves
    assert json.loads(published.json) == json.loads(sequence().json)


def test_what_a_gripper_does_not_know_the_planner_is_not_told() -> None:
    moves = sequence(HEAD + "declared_mass_kg = 0.1\n").moves
    assert [move.declared_payload for move in moves] == [0.1, 0.0] * 3
    assert [move.payload for move in moves] == [0.2, 0.0, 0.5, 0.0, 0.2, 0.0]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("payload_mass_kg", "payload_mas_kg", "part 2 of the sequence: unknown key payload_mas_kg: did you mean payload_mass_kg?"),
        ("grip_ms = 30.0", "grip_ms = -1.0", "part 3 of the sequence: grip_ms is -1.0: input should be greater than or equal to 0"),
        ("grip_ms = 20.0", "gripp_ms = 20.0", "unknown key sequence.gripp_ms: did you mean grip_ms?"),
        ("{ pick_mm = [-150.0, 0.0, -800.0], ", "{ ", "part 1 of the sequence has no pick_mm: say it there, or in [task]"),
        ("lift_place_mm = 30.0", "lift_mm = 50.0, lift_place_mm = 30.0", "part 2 of the sequence: give either lift_mm or"),
        ("lift_mm = 50.0", "pick_mm = [0.0, 0.0, -800.0]\nlift_mm = 50.0", "task.pick_mm is not used: every part"),
        ("[payload]", "[expect]\npart_per_minute = { min = 1.0 }\n[payload]", "did you mean parts_per_minute?"),
    ],
)
def test_wrong_sequences_are_refused_with_the_part_and_the_way_out(old: str, new: str, says: str) -> None:
    text = HEAD + PARTS
    assert old in text
    with pytest.raises(ScenarioError) as refusal:
        parse_scenario(text.replace(old, new), PATH)
    assert says in str(refusal.value)


def test_an_empty_sequence_and_rates_without_one_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"sequence\.parts is"):
        sequence(HEAD, "[sequence]\nparts = []")
    points = "pick_mm = [-150.0, 0.0, -800.0]\nplace_mm = [150.0, 0.0, -800.0]\nlift_mm"
    with pytest.raises(ScenarioError, match=r"expect\.parts_per_minute is of a sequence"):
        sequence(HEAD.replace("lift_mm", points), "[expect]\nparts_per_minute = { min = 1.0 }")
