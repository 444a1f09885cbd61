"""Events are what changes from one frame to the next, with the numbers that belong to it."""

import json
import struct

import pytest
from integration.synthetic_cell import frames, replaced

from deltaph.frame import COMMANDS, OUTCOMES, TIMING, Frame
from deltaph.telemetry import EVENT_KINDS, layout, schema_document
from deltaph.telemetry.events import EventWatch, level, sentence
from deltaph.variables import Model, variable_table

FORMATS = {"uint64": "<Q", "float64": "<d", "int32": "<i"}


def put(frame: Frame, model: Model, name: str, value: float) -> None:
    outputs = [v for v in variable_table(model).of("output") if v.is_float == variable_table(model)[name].is_float]
    kind = "floats" if variable_table(model)[name].is_float else "integers"
    getattr(frame, f"{model}_{kind}")[[v.name for v in outputs].index(name)] = value


def rest() -> list[Frame]:
    """Frames in which nothing happens after the first."""
    return frames(6)


def seen(offered: list[Frame]) -> list[tuple[int, str, str, str]]:
    """Step, kind, level and words of the events, as a reader of the bytes gets them."""
    watch, event = EventWatch(), layout("event")
    found = [event.decode(event.encode(one, 0)) for frame in offered for one in watch.see(frame)]
    return [(int(r["step"]), EVENT_KINDS[r["kind"]], level(r), sentence(r)) for r in found]


def test_nothing_happens_in_frames_that_are_alike() -> None:
    assert seen(rest()) == [
        (0, "plan_accepted", "INFO", "plan 1 accepted: 0.303 s"),
        (0, "phase", "INFO", "phase lift"),
    ]


def test_refused_plan_comes_with_its_numbers() -> None:
    offered = rest()
    for frame in offered[3:]:
        put(frame, "planner", "plan.refused", 2)
        put(frame, "planner", "plan.status", variable_table("planner").items("PlanStatus").index("lift_too_low"))
        put(frame, "planner", "plan.required", 0.07)
        put(frame, "planner", "plan.available", 0.05)
    assert seen(offered)[2:] == [(3, "plan_refused", "WARN", "plan refused, 2 so far: lift_too_low, required 0.07, available 0.05")]


def test_cancelled_plan_comes_before_the_one_in_its_place() -> None:
    offered = rest()
    for frame in offered[3:]:
        put(frame, "planner", "plan.cancelled", 1)
        put(frame, "planner", "plan.count", 2)
    assert seen(offered)[2:] == [
        (3, "plan_cancelled", "INFO", "plan cancelled before it began, 1 so far"),
        (3, "plan_accepted", "INFO", "plan 2 accepted: 0.303 s"),
    ]


def test_trip_comes_with_its_axis() -> None:
    offered = rest()
    for frame in offered[4:]:
        put(frame, "plant", "trip", variable_table("plant").items("Trip").index("overspeed"))
        put(frame, "plant", "trip_axis", 2)
    assert seen(offered)[2:] == [(4, "trip", "ERROR", "trip overspeed of axis 2")]


def test_missed_deadlines_are_counted() -> None:
    offered = rest()
    column = [name for name, _, _ in TIMING].index("missed_deadlines")
    for frame in offered:
        frame.timing[column] = 0.0
    for frame, missed in zip(offered[2:], (1, 1, 3, 3), strict=True):
        frame.timing[column] = missed
    assert seen(offered)[2:] == [
        (2, "missed_deadline", "WARN", "deadline missed, 1 so far"),
        (4, "missed_deadline", "WARN", "deadline missed, 3 so far"),
    ]


def test_commands_are_counted_by_what_became_of_them() -> None:
    offered = rest()
    counts = offered[0].commands.copy()
    counts[COMMANDS.index("hold"), OUTCOMES.index("accepted")] = 1
    counts[COMMANDS.index("ppo"), OUTCOMES.index("busy")] = 3
    more = counts.copy()
    more[COMMANDS.index("none"), OUTCOMES.index("invalid")] = 1
    offered[2:] = [replaced(frame, commands=more if frame.step == 5 else counts) for frame in offered[2:]]
    assert seen(offered)[2:] == [
        (2, "command_refused", "WARN", "command ppo refused, busy: 3 so far"),
        (2, "command_accepted", "INFO", "command hold accepted, 1 so far"),
        (5, "command_refused", "WARN", "command none refused, invalid: 1 so far"),
    ]


@pytest.mark.parametrize(("kept", "step", "lost"), [((0, 1, 5), 5, 3), ((0, 2, 3), 2, 1)])
def test_frames_that_are_missing_are_counted(kept: tuple[int, ...], step: int, lost: int) -> None:
    offered = rest()
    assert seen([offered[k] for k in kept])[2:] == [(step, "dropped", "WARN", f"{lost} frames dropped before this one")]


def test_reader_with_nothing_but_the_schema_gets_every_value() -> None:
    frame = frames(2)[0]
    accepted = EventWatch().see(frame)[0]
    payload = layout("event").encode(accepted, sequence=9)
    schema = json.loads(json.dumps(schema_document()))["messages"]["event"]
    assert (len(payload), payload[:4].hex(" ")) == (schema["size"], schema["header"])
    read = {f["name"]: struct.unpack_from(FORMATS[f["type"]], payload, f["offset"])[0] for f in schema["fields"]}
    assert {name: value for name, value in read.items() if value} == {
        "sequence": 9,
        "unix_time_ns": frame.unix_time_ns,
        "duration": 0.303,
        "status": 1,
        "count": 1,
    }
    assert next(f for f in schema["fields"] if f["name"] == "kind")["enumeration"] == list(EVENT_KINDS)
