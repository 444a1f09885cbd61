"""Commands to a cell that serves: real processes, real sessions on loopback."""

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from integration.serving_cell import (
    CELL,
    DELTAPH,
    Serving,
    ask,
    following,
    serving,
    session,
)
from integration.waiting import DEADLINE, wait_until

from deltaph.errors import EnvironmentProblem, InfeasibleError
from deltaph.execution import nearest_point
from deltaph.frame import COMMANDS, OUTCOMES, Command
from deltaph.kernel import status_sentence
from deltaph.plan import Plan
from deltaph.scenario import Task, parse_scenario, template
from deltaph.telemetry import (
    EVENT_KINDS,
    CommandClient,
    CommandCounts,
    CommandService,
    FeedFacts,
    PpoRequest,
    Publisher,
    Reply,
    Subscriber,
    layout,
    open_client_session,
    open_router_session,
)
from deltaph.telemetry.commands import MAX_REQUEST, REQUESTS
from deltaph.telemetry.events import sentence
from deltaph.telemetry.session import free_endpoint
from deltaph.variables import variable_table

PAPER = template()
SCENARIO = parse_scenario(PAPER, Path("paper.toml"))
PICK, PLACE = SCENARIO.task.pick, SCENARIO.task.place
DURATION = 0.303


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A cell that the tests of this file share; each leaves it at rest, and running."""
    with serving(tmp_path_factory.mktemp("serving"), PAPER) as cell:
        yield cell
        assert cell.end() == 0


@pytest.fixture
def client(shared: Serving) -> Iterator[CommandClient]:
    with shared.client() as connected:
        yield connected


def target(cell: Serving) -> tuple[float, float, float]:
    """The end of the traverse where the robot is not."""
    with following(cell) as found:
        at = found.values("setpoint", "tcp_position")[-1]
    return PICK if np.allclose(at, PLACE, atol=1e-6) else PLACE


def test_robot_rests_until_it_is_told_and_then_runs_the_plan_to_the_bit(tmp_path: Path) -> None:
    plan = Plan.of(SCENARIO)
    with serving(tmp_path, PAPER) as cell, cell.client() as client, following(cell) as found:
        found.wait_for_time(found.time + 0.2)
        reply = client.ppo(PpoRequest(place=PLACE))
        assert reply.accepted and reply.plan is not None
        assert (reply.plan.count, reply.plan.waits, reply.reason) == (1, False, None)
        assert (reply.plan.duration, reply.plan.corner_deviation_pick) == (plan.duration, plan.corner_deviation[0])
        start = reply.plan.start_time
        assert start is not None and start >= 0.2
        found.wait_for_arrival(reply)
        assert cell.end() == 0
        setpoints = found.of("setpoint")
        before = setpoints[setpoints["time"] <= start + 1e-9]
        assert len(before) and not np.any(before["path.phase"]) and not np.any(before["tcp.velocity.z"])
        ran = setpoints[(setpoints["time"] > start + 1e-9) & (setpoints["time"] < start + plan.duration + 1e-9)]
        sampled = plan.sample(np.arange(1, len(ran) + 1) / 1000.0)
        assert len(ran) == 303
        for axis, letter in enumerate("xyz"):
            np.testing.assert_array_equal(ran[f"tcp.position.{letter}"], sampled["tcp_position"][:, axis])
        assert found.missing() == 0
    assert (cell.report["plans"]["accepted"], cell.report["plans"]["arrived"], cell.report["plans"]["corners_kept"]) == (1, 1, 2)


def test_one_waits_and_begins_when_the_first_arrives_and_a_third_is_busy(shared: Serving, client: CommandClient) -> None:
    end = target(shared)
    other = PICK if end == PLACE else PLACE
    with following(shared) as found:
        client.feed(0.3)  # so that there is time to ask
        found.wait_for_time(found.time + 1.1)
        first = client.ppo(PpoRequest(place=end, dwell=0.1))
        second = client.ppo(PpoRequest(place=other))
        third = client.ppo(PpoRequest(place=end))
        assert first.plan is not None and second.plan is not None
        assert (first.plan.waits, second.plan.waits) == (False, True)
        assert second.plan.count == first.plan.count + 1
        assert first.plan.start_time is None and second.plan.start_time is None  # which depends on the feed
        assert (third.accepted, third.outcome) == (False, "busy")
        assert third.refused is not None and third.refused.status == "busy"
        assert third.reason == status_sentence("busy", 0.0, 0.0)
        client.feed(1.0)
        found.wait_for_arrival(second)
        found.wait_for_time(found.time + 1.1)
        first, second = client.ppo(PpoRequest(place=end, dwell=0.2)), client.ppo(PpoRequest(place=other))
        assert first.plan is not None and second.plan is not None and first.plan.start_time is not None
        assert second.plan.start_time == pytest.approx(first.plan.start_time + 0.2 + DURATION, abs=1e-9)
        found.wait_for_arrival(second)
        found.wait_for_time(second.plan.start_time + 0.1)
        setpoints = found.of("setpoint")
        falls = np.flatnonzero(np.diff(setpoints["path.arc_length"]) < 0.0)
        assert setpoints["time"][falls[-1] + 1] == pytest.approx(second.plan.start_time, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"lift": 0.003}, "lift_too_low"),
        ({"corner_deviation": 0.2}, "lift_too_low"),
        ({"lift": (0.05, 0.03)}, "not_level"),
        ({"place": (0.9, 0.0, -0.8)}, "joint_range"),
        ({"place": (0.0, 0.0, -1.4), "lift": (0.05, 0.65)}, "singular"),
        ({"place": (1e300, 0.0, -0.8)}, "invalid_value"),
    ],
)
def test_refused_with_the_numbers_and_the_sentence_of_the_kernel(
    shared: Serving, client: CommandClient, changes: dict[str, object], status: str
) -> None:
    end = target(shared)
    request = PpoRequest.model_validate({"place": end} | changes)
    given = request.lift or 0.05, request.corner_deviation or 0.006
    pair = [value if isinstance(value, tuple) else (value, value) for value in given]
    with pytest.raises(InfeasibleError) as kernel:
        Plan(SCENARIO.robot, Task(PICK if end == PLACE else PLACE, request.place, *pair), SCENARIO.law)
    reply = client.ppo(request)
    assert (reply.accepted, reply.outcome, reply.reason) == (False, "infeasible", str(kernel.value))
    assert reply.refused is not None and reply.plan is None
    assert (reply.refused.status, reply.refused.phase, reply.refused.joint) == (status, kernel.value.phase, kernel.value.joint)
    assert (reply.refused.required, reply.refused.available) == (kernel.value.required, kernel.value.available)


def test_pick_point_elsewhere_is_refused_by_the_planner(client: CommandClient) -> None:
    reply = client.ppo(PpoRequest(place=(0.0, 0.1, -0.8), pick=(0.0, 0.0, -0.8)))
    assert reply.refused is not None
    assert (reply.refused.status, reply.refused.phase, reply.refused.required) == ("not_at_pick", "idle", 0.1525)
    assert reply.reason == "the robot rests 152.5 mm away from the pick point: at most 0.001 mm"


def test_plan_beyond_the_limits_of_the_drives_is_refused(shared: Serving, client: CommandClient) -> None:
    reply = client.ppo(PpoRequest(place=target(shared), payload=30.0))
    assert reply.refused is not None
    assert (reply.outcome, reply.refused.status) == ("infeasible", "limit_exceeded")
    assert reply.reason is not None and "torque reaches" in reply.reason and "beyond the limit" in reply.reason


def test_hold_stops_on_the_path_and_resume_finishes_within_the_deviation(shared: Serving, client: CommandClient) -> None:
    end = target(shared)
    with following(shared) as found:
        client.feed(0.25)
        found.wait_for_time(found.time + 1.0)
        reply = client.ppo(PpoRequest(place=end))
        wait_until(lambda: 0.08 < found.values("setpoint", "path_arc_length")[-1] < 0.3)
        held = client.hold()
        assert held.feed is not None and (held.feed.value, held.feed.held, held.feed.stopped) == (0.25, True, False)
        found.wait_for_time(held.time + 0.6)
        faster = client.feed(1.0)  # of no effect before it resumes
        assert faster.feed is not None and faster.feed.held
        found.wait_for_time(faster.time + 0.3)
        still = found.of("setpoint")[-200:]
        assert np.ptp(still["path.arc_length"]) == 0.0
        assert 0.0 < still["path.arc_length"][-1] < still["path.length"][-1]
        assert not np.any(np.abs(still["tcp.velocity.x"]) > 1e-9)
        actual = found.values("actual", "tcp_position")[-1]
        np.testing.assert_allclose(actual, found.values("setpoint", "tcp_position")[-1], atol=2e-5)
        client.resume()
        found.wait_for_arrival(reply)
        motion, setpoints = found.of("actual"), found.of("setpoint")
    position, velocity = (layout("actual").values(motion, group) for group in ("tcp_position", "tcp_velocity"))
    np.testing.assert_allclose(layout("setpoint").values(setpoints, "tcp_position")[-1], end, atol=1e-12)
    for point in (PICK, PLACE):
        executed, _, _ = nearest_point(motion["time"], position, velocity, np.add(point, (0.0, 0.0, 0.05)))
        assert executed <= 6.05e-3
    # it begins when the reply says, at the latest
    speed = np.linalg.norm(layout("setpoint").values(setpoints, "tcp_velocity"), axis=1)
    at = int(np.argmin(np.abs(setpoints["time"] - held.time)))
    assert 0.0 < speed[at + 50] < 0.5 * speed[at]
    # bounded jerk while it stops: feed.c has |r''| <= w^2 times the change of the feed, times a speed of 2.4 m/s at most
    stopping = setpoints[np.abs(setpoints["time"] - held.time) < 0.5]
    jumps = np.diff(layout("setpoint").values(stopping, "tcp_acceleration"), axis=0)
    assert np.abs(jumps).max() < 1e-3 * 50.0**2 * 0.25 * 2.4


def test_stop_refuses_until_resume_and_what_runs_goes_on_then(shared: Serving, client: CommandClient) -> None:
    end = target(shared)
    with following(shared) as found:
        client.feed(0.3)
        found.wait_for_time(found.time + 1.0)
        reply = client.ppo(PpoRequest(place=end))
        stopped = client.stop()
        assert stopped.feed is not None and (stopped.feed.held, stopped.feed.stopped) == (True, True)
        assert stopped.discarded == 0
        refused = client.ppo(PpoRequest(place=PICK))
        assert (refused.accepted, refused.outcome, refused.reason) == (False, "stopped", "the cell is stopped: resume it first")
        client.feed(1.0)
        resumed = client.resume()
        assert resumed.feed is not None and (resumed.feed.value, resumed.feed.held, resumed.feed.stopped) == (1.0, False, False)
        found.wait_for_arrival(reply)
        np.testing.assert_allclose(found.values("setpoint", "tcp_position")[-1], end, atol=1e-12)


def test_stop_discards_what_waits_and_the_next_one_begins_where_the_running_one_ends(tmp_path: Path) -> None:
    elsewhere = (0.05, 0.12, -0.8)
    with serving(tmp_path, PAPER) as cell, cell.client() as client, following(cell) as found:
        client.feed(0.3)  # so that there is time to ask
        found.wait_for_time(found.time + 1.1)
        running, waiting = client.ppo(PpoRequest(place=PLACE)), client.ppo(PpoRequest(place=PICK, payload=2.0))
        assert running.plan is not None and waiting.plan is not None and waiting.plan.waits
        assert (client.hold().discarded, client.stop().discarded, client.stop().discarded) == (None, 1, 0)
        refused = client.ppo(PpoRequest(place=elsewhere))
        assert (refused.accepted, refused.outcome) == (False, "stopped")
        client.feed(1.0)
        assert client.resume().discarded is None
        found.wait_for_time(found.time + 1.1)
        setpoints = found.of("setpoint")
        assert np.count_nonzero(np.diff(setpoints["path.arc_length"]) < 0.0) == 0  # nothing has begun after it
        np.testing.assert_allclose(layout("setpoint").values(setpoints, "tcp_position")[-1], PLACE, atol=1e-12)
        following_one = client.ppo(PpoRequest(place=elsewhere))  # from where the running one has ended
        assert following_one.plan is not None and not following_one.plan.waits
        assert following_one.plan.start_time is not None
        assert following_one.plan.count == waiting.plan.count + 1
        found.wait_for_arrival(following_one)
        np.testing.assert_allclose(found.values("setpoint", "tcp_position")[-1], elsewhere, atol=1e-12)
        words = [sentence(event) for event in found.of("event")]
        status = [(plan["plan.status"], plan["plan.count"], plan["plan.cancelled"]) for plan in found.of("plan")]
        assert cell.end() == 0
    assert [said for said in words if "cancelled" in said] == ["plan cancelled before it began, 1 so far"]
    ok, cancelled = (variable_table("planner").items("PlanStatus").index(item) for item in ("ok", "cancelled"))
    assert status == [(ok, 1, 0), (ok, 2, 0), (cancelled, 2, 1), (ok, 3, 1)]
    plans = cell.report["plans"]
    assert (plans["accepted"], plans["cancelled"], plans["refused"], plans["arrived"], plans["corners"]) == (3, 1, 0, 2, 4)
    assert "3 accepted, 0 refused, 1 cancelled, 2 arrived" in " ".join(cell.printed.split())
    assert cell.report["executed"]["tracking_error_tcp_max_m"] < 2e-4  # the load of the discarded one was never in the gripper


def test_while_it_is_stopped_what_is_asked_for_next_is_asked_from_where_the_running_one_ends(tmp_path: Path) -> None:
    """And may be waiting again before the running one arrives."""
    with serving(tmp_path, PAPER) as cell, cell.client() as client, following(cell) as found:
        client.feed(0.3)
        found.wait_for_time(found.time + 1.1)
        client.ppo(PpoRequest(place=PLACE))
        assert client.ppo(PpoRequest(place=(0.05, 0.12, -0.8))).accepted
        assert client.stop().discarded == 1
        assert client.resume().accepted
        back = client.ppo(PpoRequest(place=PICK))
        assert back.plan is not None and back.plan.waits
        assert client.feed(1.0).accepted
        found.wait_for_arrival(back)
        np.testing.assert_allclose(found.values("setpoint", "tcp_position")[-1], PICK, atol=1e-12)
        assert cell.end() == 0
    assert (cell.report["plans"]["arrived"], cell.report["plans"]["cancelled"]) == (2, 1)


def test_stop_discards_what_is_being_planned(tmp_path: Path) -> None:
    """Its own reply says so, and it does not run after `resume`."""
    scenario = PAPER.replace('name = "paper"', 'name = "paper_limited"')
    end, other_end, delay, accepted = PLACE, PICK, 0.0, 0
    with serving(tmp_path, scenario) as cell, cell.client() as client, cell.client() as other, following(cell) as found:
        deadline = found.time + DEADLINE
        while True:  # the planner plans for 30 ms or more, in which the stop has to come
            replies: list[Reply] = []
            asking = threading.Thread(target=lambda into, to: into.append(client.ppo(PpoRequest(place=to))), args=(replies, end))
            asked = found.time
            asking.start()
            found.wait_for_time(asked + delay)
            stopped = other.stop()
            asking.join(DEADLINE)
            assert other.resume().accepted
            (reply,) = replies
            if stopped.discarded:
                break
            delay += 0.005
            if reply.accepted:
                found.wait_for_arrival(reply)
                end, other_end, delay, accepted = other_end, end, 0.0, accepted + 1
            assert found.time < deadline
        assert (stopped.discarded, reply.accepted, reply.outcome) == (1, False, "stopped")
        assert reply.reason == "the cell was stopped before this was planned: resume it and ask again"
        resumed = found.time
        found.wait_for_time(resumed + 0.3)
        setpoints = found.of("setpoint")
        assert not np.any(setpoints["path.phase"][setpoints["time"] > resumed])
        again = client.ppo(PpoRequest(place=end))
        assert again.plan is not None and again.plan.count == accepted + 1
        found.wait_for_arrival(again)
        np.testing.assert_allclose(found.values("setpoint", "tcp_position")[-1], end, atol=1e-12)
        assert cell.end() == 0
    plans = cell.report["plans"]
    assert (plans["accepted"], plans["cancelled"], plans["arrived"]) == (accepted + 1, 1, accepted + 1)


def test_slow_planning_is_waited_for_while_a_hold_is_heard(tmp_path: Path) -> None:
    scenario = PAPER.replace('name = "paper"', 'name = "paper_limited"')
    assert scenario != PAPER
    with serving(tmp_path, scenario) as cell, cell.client() as client, cell.client() as other, following(cell) as found:
        replies: list[Reply] = []
        asking = threading.Thread(target=lambda: replies.append(client.ppo(PpoRequest(place=PLACE))))
        before = found.time
        asking.start()
        assert other.feed(0.9).accepted  # whenever it comes
        assert other.feed(1.0).accepted
        asking.join(DEADLINE)
        (reply,) = replies
        plan = Plan.of(parse_scenario(scenario, Path("paper_limited.toml")))
        assert reply.plan is not None
        assert (reply.plan.duration, reply.plan.corner_deviation_pick) == (plan.duration, plan.corner_deviation[0])
        assert reply.time > before + 0.02  # 40 to 60 slices of a millisecond
        found.wait_for_arrival(reply)
        statuses = set(found.of("plan")["plan.status"].tolist())
        assert statuses == {variable_table("planner").items("PlanStatus").index("ok")}
        assert cell.end() == 0


def test_longer_steps_serve_as_well(tmp_path: Path) -> None:
    scenario = PAPER.replace("communication_step_ms = 1.0", "communication_step_ms = 4.0")
    assert scenario != PAPER
    with serving(tmp_path, scenario) as cell, cell.client() as client, following(cell) as found:
        first, second = client.ppo(PpoRequest(place=PLACE)), client.ppo(PpoRequest(place=PICK, dwell=0.01))
        assert first.plan is not None and second.plan is not None
        assert (first.plan.start_time, second.plan.waits) == (None, True)
        found.wait_for_arrival(second)
        assert cell.end() == 0
    assert (cell.report["plans"]["arrived"], cell.report["plans"]["corners"], cell.report["plans"]["corners_kept"]) == (2, 4, 4)


def test_payload_comes_into_the_gripper_when_its_plan_begins(tmp_path: Path) -> None:
    with serving(tmp_path, PAPER) as cell, cell.client() as client, following(cell) as found:
        light = client.ppo(PpoRequest(place=PLACE))
        heavy = client.ppo(PpoRequest(place=PICK, payload=2.0, dwell=0.2))
        found.wait_for_arrival(heavy)
        actual = found.of("actual")
        assert cell.end() == 0
    assert light.plan is not None and heavy.plan is not None and heavy.plan.start_time is not None
    at_rest = [actual[np.argmin(np.abs(actual["time"] - heavy.plan.start_time - delay))] for delay in (-0.001, 0.19)]
    torque = [float(row["joint[1].torque"] + row["joint[2].torque"] + row["joint[3].torque"]) for row in at_rest]
    assert abs(torque[1]) > abs(torque[0]) + 2.0  # some newton metres hold 2 kg
    assert cell.report["executed"]["tracking_error_tcp_max_m"] < 2e-4  # the planner gave the torque from the same instant on
    assert cell.report["plans"]["corners_kept"] == 4


def test_tripped_plant_does_not_go_on_and_the_exit_code_says_so(tmp_path: Path) -> None:
    scenario = PAPER + "\n[[fault]]\ntime_ms = 200.0\nencoder_offset_deg = 5.0\n"
    with serving(tmp_path, scenario) as cell, cell.client() as client, following(cell) as found:
        wait_until(lambda: found.of("actual")["trip"][-1] != 0)
        reply = client.ppo(PpoRequest(place=PLACE))
        assert (reply.outcome, reply.reason) == (
            "tripped",
            "the plant has tripped: its brakes are on until the cell is started again",
        )
        assert {client.resume().outcome, client.feed(0.5).outcome} == {"tripped"}
        assert client.hold().accepted
        assert client.stop().accepted
        assert cell.end() == 1
    assert (cell.report["executed"]["trip"], cell.report["plans"]["accepted"]) == ("encoder", 0)


def test_every_command_is_an_event_with_its_outcome(shared: Serving, client: CommandClient) -> None:
    end = target(shared)
    with following(shared) as found, session(shared) as raw:
        client.hold()
        client.resume()
        client.ppo(PpoRequest(place=end, lift=0.001))
        assert len(ask(raw, f"deltaph/{CELL}/command/feed", b"nonsense")) == 1
        assert len(ask(raw, f"deltaph/{CELL}/command/h$*d", None)) == 1
        reply = client.ppo(PpoRequest(place=end))
        found.wait_for_arrival(reply)
        kinds = EVENT_KINDS.index("command_accepted"), EVENT_KINDS.index("command_refused")
        said = [sentence(event).partition(", ")[0].partition(":")[0] for event in found.of("event") if event["kind"] in kinds]
    assert sorted(said) == [  # within one step they come in the order of the table
        "command feed refused",
        "command hold accepted",
        "command none refused",
        "command ppo accepted",
        "command ppo refused",
        "command resume accepted",
    ]


MALFORMED = [
    ("ppo", b"", "key place is missing"),
    ("ppo", b"{", "the request is not JSON: EOF while parsing"),
    ("ppo", b"\xff\xfe", "the request is not JSON"),
    ("ppo", b"[1, 2, 3]", "the request is [1, 2, 3]"),
    ("ppo", b'{"place": [0, 0]}', "key place.2 is missing"),
    ("ppo", b'{"place": [0, 0, NaN]}', "place.2 is nan: input should be a finite number"),
    ("ppo", b'{"place": [0, 0, 1e999]}', "place.2 is inf: input should be a finite number"),
    ("ppo", b'{"place": [0, 0, "-0.8"]}', "place.2 is '-0.8': input should be a valid number"),
    ("ppo", b'{"place": [0, 0, true]}', "place.2 is True"),
    ("ppo", b'{"place": [0, 0, -0.8], "lift": -0.1}', "lift is -0.1: input should be greater than or equal to 0"),
    ("ppo", b'{"place": [0, 0, -0.8], "speed": 3}', "unknown key 'speed': known are place, pick, lift"),
    ("ppo", b'{"plaice": [0, 0, -0.8]}', "unknown key 'plaice': known are place, pick, lift"),
    ("ppo", b'{"place": ' + b"[" * 2000 + b"]" * 2000 + b"}", "the request is not JSON: recursion limit exceeded"),
    ("ppo", b" " * (MAX_REQUEST + 1), f"the request has {MAX_REQUEST + 1} bytes: at most {MAX_REQUEST}"),
    ("feed", b"{}", "key value is missing"),
    ("feed", b'{"value": 1.5}', "value is 1.5: input should be less than or equal to 1"),
    ("hold", b'{"now": true}', "unknown key 'now': known are none"),
    ("stop", b"1", "the request is 1"),
]


@pytest.mark.parametrize(("command", "payload", "reason"), MALFORMED, ids=lambda value: repr(value)[:30])
def test_malformed_requests_are_refused_with_the_reason(shared: Serving, command: str, payload: bytes, reason: str) -> None:
    with session(shared) as raw:
        (answer,) = ask(raw, f"deltaph/{CELL}/command/{command}", payload)
    assert answer.ok is not None
    assert str(answer.ok.encoding) == "application/json"
    reply = Reply.model_validate_json(answer.ok.payload.to_bytes())
    assert (reply.command, reply.accepted, reply.outcome) == (command, False, "invalid")
    assert reply.reason is not None and reply.reason.startswith(reason), reply.reason


@pytest.mark.parametrize("name", ["fly", "*", "p*o", "ppo/now"])
def test_query_to_no_single_command_is_an_error_and_moves_nothing(shared: Serving, name: str) -> None:
    with session(shared) as raw, following(shared) as found:
        key = f"deltaph/{CELL}/command/{name}".replace("p*o", "p$*o")
        answers = ask(raw, key, b'{"place": [0.1, 0.0, -0.8]}')
        assert len(answers) == {"*": len(REQUESTS), "p*o": 1}.get(name, 0)
        for answer in answers:
            assert answer.err is not None
            assert f"{key} is no single command: known are deltaph/{CELL}/command/ppo" in answer.err.payload.to_string()
        found.wait_for_time(found.time + 0.05)
        assert not np.any(found.of("setpoint")["path.phase"])
        assert "plan" not in found.messages


numbers = st.one_of(st.floats(), st.integers(), st.floats(-1.0, 1.0))
anything = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
triples = st.lists(numbers, min_size=3, max_size=3)
nearly = st.fixed_dictionaries(
    {"place": triples | anything},
    optional={
        "pick": triples | anything,
        "lift": numbers | st.lists(numbers, min_size=2, max_size=2) | anything,
        "corner_deviation": numbers | anything,
        "payload": numbers | anything,
        "dwell": numbers | anything,
    },
)


def test_whatever_comes_is_answered_once_and_the_cell_goes_on(tmp_path: Path) -> None:
    with serving(tmp_path, PAPER) as cell, session(cell) as raw, following(cell) as found, cell.client() as client:
        before = found.time

        @settings(max_examples=300, deadline=None, database=None, suppress_health_check=list(HealthCheck))
        @given(
            command=st.sampled_from(sorted(REQUESTS)),
            payload=st.binary(max_size=200) | (anything | nearly).map(lambda value: json.dumps(value).encode()),
        )
        def fuzz(command: str, payload: bytes) -> None:
            (answer,) = ask(raw, f"deltaph/{CELL}/command/{command}", payload)
            assert answer.ok is not None
            reply = Reply.model_validate_json(answer.ok.payload.to_bytes())
            assert reply.outcome not in ("failed", "tripped"), reply.reason
            assert reply.accepted or reply.reason

        fuzz()
        assert client.resume().accepted
        assert client.feed(1.0).accepted
        found.wait_for_time(before + 0.5)
        assert found.missing() == 0
        assert cell.end() == 0
    told = sum(sum(outcomes.values()) for outcomes in cell.report["commands"].values())
    assert told >= 302


def test_flood_is_answered_and_does_not_keep_a_hold_from_being_heard(tmp_path: Path) -> None:
    count, answered, complete = 10_000, [], threading.Semaphore(0)
    request = PpoRequest(place=PLACE, lift=0.001).model_dump_json(exclude_none=True).encode()
    with serving(tmp_path, PAPER) as cell, session(cell) as raw, following(cell) as found, cell.client() as client:
        begin = time.monotonic()
        for _ in range(count):
            handler = zenoh.handlers.Callback(answered.append, complete.release)
            raw.get(f"deltaph/{CELL}/command/ppo", handler, payload=request, timeout=DEADLINE)
        held = client.hold()  # is heard in the flood
        for _ in range(count):
            assert complete.acquire(timeout=DEADLINE)
        elapsed = time.monotonic() - begin
        assert held.accepted
        found.wait_for_time(found.time + 0.1)
        assert found.missing() == 0
        steps = np.diff(found.of("setpoint")["sequence"].astype(int))
        assert np.all(steps == 1)
        assert cell.end() == 0
    outcomes = [Reply.model_validate_json(reply.ok.payload.to_bytes()).outcome for reply in answered if reply.ok is not None]
    assert len(outcomes) == count
    assert set(outcomes) == {"busy", "infeasible"}
    counted = cell.report["commands"]["ppo"]
    assert counted == {outcome: outcomes.count(outcome) for outcome in set(outcomes)}
    assert counted["infeasible"] == cell.report["plans"]["refused"] > 0
    assert cell.report["telemetry"]["dropped"] == 0
    assert len(cell.said.splitlines()) < 10 + 2 * elapsed  # nor does it flood the screen


def test_commands_in_quick_succession_are_all_carried_out_in_order(tmp_path: Path) -> None:
    """Those of a plain client, which sends none twice."""
    with serving(tmp_path, PAPER) as cell, session(cell) as raw:

        def sent(command: str, **request: object) -> Reply:
            (answer,) = ask(raw, f"deltaph/{CELL}/command/{command}", json.dumps(request).encode())
            return Reply.model_validate_json(answer.ok.payload.to_bytes())

        first, second = sent("ppo", place=PLACE), sent("ppo", place=PICK)
        assert first.accepted
        assert second.accepted
        assert second.plan is not None
        assert second.plan.waits
        ramp = [sent("feed", value=value / 10) for value in range(10, -1, -1)]
        assert [reply.feed.value for reply in ramp if reply.feed is not None] == [value / 10 for value in range(10, -1, -1)]
        assert all(sent(command).accepted for command in ("stop", "resume", "hold", "resume"))
        assert cell.end() == 0
    assert cell.report["commands"]["feed"] == {"accepted": 11}


def test_stop_is_heard_behind_a_router_while_another_client_sends_junk(tmp_path: Path) -> None:
    meeting = free_endpoint()
    ended = threading.Event()

    def junk() -> None:
        room = threading.Semaphore(64)
        with open_client_session([meeting], DEADLINE) as other:
            while not ended.is_set():
                room.acquire()
                handler = zenoh.handlers.Callback(lambda _: None, room.release)
                other.get(f"deltaph/{CELL}/command/stop", handler, payload=b"junk", timeout=DEADLINE)

    with open_router_session([meeting]), serving(tmp_path, PAPER, "--connect", meeting) as cell:
        flood = threading.Thread(target=junk)
        with CommandClient(CELL, [meeting], timeout=DEADLINE) as client, open_client_session([meeting], DEADLINE) as raw:
            assert client.stop().accepted  # the router knows the cell
            flood.start()
            try:
                for _ in range(20):
                    (answer,) = ask(raw, f"deltaph/{CELL}/command/stop", None)
                    assert Reply.model_validate_json(answer.ok.payload.to_bytes()).accepted
            finally:
                ended.set()
                flood.join(DEADLINE)
        assert cell.end() == 0
    assert cell.report["commands"]["stop"]["accepted"] == 21
    assert cell.report["commands"]["stop"]["invalid"] > 0


class Faulty:
    """A cell whose planning fails in a way that nobody foresaw."""

    time = 0.0

    def override(self, command: Command, value: float | None) -> Reply:
        assert value is None
        feed = FeedFacts(value=1.0, held=True, stopped=False)
        return Reply(command=command, accepted=True, outcome="accepted", time=0.0, feed=feed)

    def ppo(self, request: PpoRequest) -> Reply:
        raise ZeroDivisionError(f"of {request.place[0]}")


def test_what_nobody_foresaw_is_answered_counted_and_not_the_end() -> None:
    said: list[str] = []
    publisher = Publisher(CELL, "{}", listen=[free_endpoint()])
    counts = CommandCounts()
    service = CommandService(publisher.session, CELL, Faulty(), counts, said.append)
    try:
        with CommandClient(CELL, publisher.endpoints, timeout=DEADLINE) as client:
            for _ in range(2):
                reply = client.ppo(PpoRequest(place=(0.5, 0.0, -0.8)))
                assert (reply.outcome, reply.reason) == ("failed", "the cell could not judge it: ZeroDivisionError: of 0.5")
            assert client.hold().accepted
            service.close()
            service.close()
            with pytest.raises(EnvironmentProblem, match="takes no commands"):
                client.hold()
    finally:
        publisher.close()
    assert counts.array[COMMANDS.index("ppo"), OUTCOMES.index("failed")] == 2
    assert counts.array.sum() == 3
    assert said[0] == "command ppo refused (failed): the cell could not judge it: ZeroDivisionError: of 0.5"


def test_nobody_answers_for_another_cell_or_without_serve(tmp_path: Path, shared: Serving) -> None:
    with session(shared) as raw:
        assert ask(raw, "deltaph/another/command/hold", None, timeout=2.0) == []
    with (
        CommandClient("another", [shared.endpoint], timeout=DEADLINE) as client,
        pytest.raises(EnvironmentProblem, match="cell another takes no commands: start it with `deltaph run SCENARIO --serve`"),
    ):
        client.hold()
    endpoint = free_endpoint()
    command = [str(DELTAPH), "run", "paper.toml", "--realtime", "--cycles", "100", "--listen", endpoint, "--wait-subscribers", "1"]
    (tmp_path / "paper.toml").write_text(PAPER, encoding="utf-8")
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            with Subscriber("cell1", [endpoint], timeout=DEADLINE) as subscriber:
                subscriber.wait_for_cell(DEADLINE)
                with (
                    CommandClient("cell1", [endpoint], timeout=DEADLINE) as client,
                    pytest.raises(EnvironmentProblem, match="cell cell1 takes no commands"),
                ):
                    client.hold()
        finally:
            process.kill()


def test_schema_tells_a_foreigner_how_to_command(shared: Serving) -> None:
    with session(shared) as raw:
        (answer,) = ask(raw, f"deltaph/{CELL}/schema", None)
        assert answer.ok is not None
        commands = json.loads(answer.ok.payload.to_bytes())["commands"]
        assert set(commands["requests"]) == {"ppo", "hold", "resume", "stop", "feed"}
        fields = commands["requests"]["ppo"]["schema"]
        assert fields["required"] == ["place"]
        assert set(fields["properties"]) >= {"pick", "lift", "corner_deviation", "payload", "dwell"}
        key = commands["key"].format(cell=CELL, name="feed")
        (answer,) = ask(raw, key, b'{"value": 1}')
        assert answer.ok is not None
        assert set(json.loads(answer.ok.payload.to_bytes())) == set(commands["reply"]["properties"])


def deltaph(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(DELTAPH), *arguments], cwd=cwd, capture_output=True, text=True, timeout=DEADLINE, check=False)


def test_command_line(shared: Serving, tmp_path: Path) -> None:
    where = "--connect", shared.endpoint, "--cell", CELL
    place = ",".join(f"{1000.0 * value:g}" for value in target(shared))
    done = deltaph("command", "ppo", "--place", place, "--corner-deviation", "5,4", "--json", "reply.json", *where, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "accepted: plan" in done.stdout and "corner deviation 5 and 4 mm, starts at" in done.stdout
    assert json.loads((tmp_path / "reply.json").read_text())["plan"]["corner_deviation_place"] == 0.004
    for code, words, arguments in (
        (3, "deltaph: infeasible: corner deviation 6 mm does not fit lift height 3 mm", ("ppo", "--place", place, "--lift", "3")),
        (2, "--place is '1,2': give 3 lengths in mm", ("ppo", "--place", "1,2")),
        (2, "--lift is '1,2,x': give 1 or 2 lengths in mm", ("ppo", "--place", "1,2,3", "--lift", "1,2,x")),
        (2, "VALUE is 2: give a feed from 0", ("feed", "2")),
        (2, "VALUE is nan: give a feed from 0", ("feed", "nan")),
    ):
        result = deltaph("command", *arguments, *where, cwd=tmp_path)
        assert (result.returncode, len(result.stderr.splitlines())) == (code, 1), result.stderr
        assert words in result.stderr
    for command in ("hold", "stop", "resume"):
        result = deltaph("command", command, *where, cwd=tmp_path)
        assert (result.returncode, result.stdout.startswith("accepted: ")) == (0, True), result.stderr
        assert result.stdout.rstrip().endswith(" 0 discarded") == (command == "stop")
    with shared.client() as client, following(shared) as found:
        found.wait_for_time(found.time + DURATION)
        client.feed(1.0)
    nobody = deltaph("command", "hold", "--connect", free_endpoint(), cwd=tmp_path)
    assert nobody.returncode == 2
    assert "nothing answers on" in nobody.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--no-telemetry",), "--serve takes its commands over Zenoh: leave out --no-telemetry"),
        (("--cycles", "3"), "--serve does what it is told, --cycles what the scenario says"),
        (("--csv", "out.csv"), "--serve has no end to write a table at: use --record"),
    ],
)
def test_options_that_do_not_go_with_serve(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    (tmp_path / "paper.toml").write_text(PAPER, encoding="utf-8")
    result = deltaph("run", "paper.toml", "--serve", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert words in result.stderr and len(result.stderr.splitlines()) == 1


@pytest.mark.skipif(signal.getsignal(signal.SIGINT) is signal.SIG_IGN, reason="started with SIGINT ignored, as in the background")
def test_interrupt_ends_it_with_a_summary_and_both_recordings_are_whole(tmp_path: Path) -> None:
    with serving(tmp_path, PAPER, "--record", "own.rrd") as cell:
        recorder = subprocess.Popen(
            [str(DELTAPH), "record", "-o", "other.rrd", "--connect", cell.endpoint, "--cell", CELL],
            cwd=tmp_path,
            stderr=subprocess.PIPE,
            env=os.environ | {"COLUMNS": "200"},
            text=True,
        )
        with cell.client() as client, following(cell) as found:
            found.wait_for_arrival(client.ppo(PpoRequest(place=PLACE)))

            assert client.ppo(PpoRequest(place=PICK, lift=0.0)).outcome == "infeasible"
            wait_until(lambda: (tmp_path / "other.rrd").exists() or recorder.poll() is not None)
        assert cell.end(signal.SIGINT) == 0
        _, said = recorder.communicate(timeout=DEADLINE)
    assert recorder.returncode == 0, said
    assert "ppo 1 accepted, 1 infeasible" in cell.printed
    assert cell.report["plans"] | {"worst": None, "newest": None} == {
        "accepted": 1,
        "refused": 1,
        "cancelled": 0,
        "arrived": 1,
        "corners": 2,
        "corners_kept": 2,
        "worst": None,
        "newest": None,
    }
    (plan,) = cell.report["plans"]["newest"]
    assert (plan["plan"], plan["place_m"], [corner["side"] for corner in plan["corners"]]) == (1, list(PLACE), [0, 1])
    assert cell.report["plans"]["worst"]["executed_m"] == pytest.approx(6.011e-3, abs=1e-5)
    for name in ("own.rrd", "other.rrd"):
        subprocess.run([DELTAPH.with_name("rerun"), "rrd", "verify", tmp_path / name], check=True, capture_output=True)
