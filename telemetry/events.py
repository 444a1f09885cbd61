"""What happened in a cell, as events: derived from consecutive frames here and nowhere else."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from deltaph.frame import COMMANDS, NO_COMMANDS, OUTCOMES, TIMING, Frame
from deltaph.variables import Model, variable_table

EventKind = Literal[
    "plan_accepted",
    "plan_refused",
    "phase",
    "trip",
    "missed_deadline",
    "dropped",
    "command_accepted",
    "command_refused",
    "plan_cancelled",
]

EVENT_KINDS: tuple[EventKind, ...] = get_args(EventKind)
"""Numbered from 0 in this order; only ever appended to."""

EVENT_FLOATS: tuple[tuple[str, str, str], ...] = (
    ("step", "1", "Communication point at which it was seen"),
    ("required", "1", "plan_refused: what the request needs, in the SI unit of the refused quantity"),
    ("available", "1", "plan_refused: what there is, in the same unit"),
    ("duration", "s", "plan_accepted: duration of the plan"),
)
"""Name, unit and description of the Float64 fields of an event; 0 where a kind has no use for one."""

EVENT_INTEGERS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("kind", EVENT_KINDS, "What happened"),
    ("status", variable_table("planner").items("PlanStatus"), "Plans: what became of the last request"),
    ("phase", variable_table("planner").items("Phase"), "phase: the phase of the path from now on"),
    ("trip", variable_table("plant").items("Trip"), "trip: why the plant has tripped"),
    ("axis", (), "trip: the axis, 1 to 3; 0 where none is meant"),
    ("count", (), "How many of this kind so far; of commands: with this outcome; dropped: frames missing before this one"),
    ("command", COMMANDS, "command_accepted, command_refused: which command; none: a query to no single one"),
    ("outcome", OUTCOMES, "command_accepted, command_refused: what became of it; infeasible: plan_refused has the numbers"),
)
"""Name, items and description of the Int32 fields of an event."""

_FLOAT_NAMES = tuple(name for name, _, _ in EVENT_FLOATS)
_INTEGER_NAMES = tuple(name for name, _, _ in EVENT_INTEGERS)
_MISSED = [name for name, _, _ in TIMING].index("missed_deadlines")
_LEVELS: dict[EventKind, str] = {
    "plan_refused": "WARN",
    "trip": "ERROR",
    "missed_deadline": "WARN",
    "dropped": "WARN",
    "command_refused": "WARN",
}


class Event(NamedTuple):
    """One event.

    Attributes:
        time: simulation time [s].
        unix_time_ns: wall clock [ns].
        floats: in the order of EVENT_FLOATS.
        integers: in the order of EVENT_INTEGERS.
    """

    time: float
    unix_time_ns: int
    floats: NDArray[np.float64]
    integers: NDArray[np.int32]

    @property
    def kind(self) -> EventKind:
        """What happened."""
        return EVENT_KINDS[int(self.integers[0])]


def _columns(model: Model, *, floats: bool) -> dict[str, int]:
    names = [v.name for v in variable_table(model).of("output") if v.is_float == floats]
    return {name: column for column, name in enumerate(names)}


class _State(NamedTuple):
    """What of a frame makes events when it changes."""

    step: int
    accepted: int
    refused: int
    cancelled: int
    phase: int
    trip: int
    missed: int


class EventWatch:
    """Compares each frame with the one before; before the first one is rest without a plan."""

    def __init__(self) -> None:
        self._before = _State(-1, 0, 0, 0, 0, 0, 0)
        self._commands = NO_COMMANDS.tobytes()
        self._planner, self._planner_floats = _columns("planner", floats=False), _columns("planner", floats=True)
        self._plant = _columns("plant", floats=False)

    def see(self, frame: Frame) -> list[Event]:
        """The events of a frame, in the order of EVENT_KINDS, but first a loss, which may hide others, and a cancel."""
        planner, plant = frame.planner_integers, frame.plant_integers
        now = _State(
            frame.step,
            int(planner[self._planner["plan.count"]]),
            int(planner[self._planner["plan.refused"]]),
            int(planner[self._planner["plan.cancelled"]]),
            int(planner[self._planner["path.phase"]]),
            int(plant[self._plant["trip"]]),
            int(frame.timing[_MISSED]),
        )
        before, self._before = self._before, now
        commands, self._commands = self._commands, frame.commands.tobytes()
        if now[1:] == before[1:] and now.step == before.step + 1 and self._commands == commands:  # nearly every frame
            return []
        return [*self._compare(before, now, frame), *_decided(commands, frame)]

    def _compare(self, before: _State, now: _State, frame: Frame) -> Iterator[Event]:
        floats = {
            name: float(frame.planner_floats[column]) for name, column in self._planner_floats.items() if name.startswith("plan.")
        }
        status = int(frame.planner_integers[self._planner["plan.status"]])
        if now.step > before.step + 1:
            yield event(frame, "dropped", count=now.step - before.step - 1)
        if now.cancelled != before.cancelled:
            yield event(frame, "plan_cancelled", status=status, count=now.cancelled)
        if now.accepted != before.accepted:
            yield event(frame, "plan_accepted", status=status, count=now.accepted, duration=floats["plan.duration"])
        if now.refused != before.refused:
            required, available = floats["plan.required"], floats["plan.available"]
            yield event(frame, "plan_refused", status=status, count=now.refused, required=required, available=available)
        if now.phase != before.phase:
            yield event(frame, "phase", phase=now.phase)
        if now.trip != before.trip:
            yield event(frame, "trip", trip=now.trip, axis=int(frame.plant_integers[self._plant["trip_axis"]]))
        if now.missed != before.missed:
            yield event(frame, "missed_deadline", count=now.missed)


def _decided(before: bytes, frame: Frame) -> Iterator[Event]:
    """What became of commands since: one event for those that are alike."""
    changed = frame.commands != np.frombuffer(before, NO_COMMANDS.dtype).reshape(NO_COMMANDS.shape)
    for command, outcome in np.argwhere(changed).tolist():
        kind: EventKind = "command_accepted" if OUTCOMES[outcome] == "accepted" else "command_refused"
        yield event(frame, kind, command=command, outcome=outcome, count=int(frame.commands[command, outcome]))


def event(frame: Frame, kind: EventKind, **values: float) -> Event:
    """An event at a frame; fields that are not named are 0."""
    given = values | {"step": frame.step, "kind": EVENT_KINDS.index(kind)}
    floats = np.array([given.get(name, 0.0) for name in _FLOAT_NAMES])
    integers = np.array([given.get(name, 0) for name in _INTEGER_NAMES], dtype=np.int32)
    return Event(frame.time, frame.unix_time_ns, floats, integers)


def level(record: np.void) -> str:
    """How grave a decoded event is: INFO, WARN or ERROR."""
    return _LEVELS.get(EVENT_KINDS[int(record["kind"])], "INFO")


def sentence(record: np.void) -> str:
    """A decoded event in words."""
    items = {name: names[record[name]] for name, names, _ in EVENT_INTEGERS if names}
    count, reason = int(record["count"]), items["status"]
    numbers = f"required {record['required']:.6g}, available {record['available']:.6g}"
    kind = EVENT_KINDS[int(record["kind"])]
    match kind:
        case "plan_accepted":
            return f"plan {count} accepted: {record['duration']:g} s"
        case "plan_refused":
            return f"plan refused, {count} so far: {reason}, {numbers}"
        case "plan_cancelled":
            return f"plan cancelled before it began, {count} so far"
        case "phase":
            return f"phase {items['phase']}"
        case "trip":
            return f"trip {items['trip']}" + (f" of axis {record['axis']}" if record["axis"] else "")
        case "missed_deadline":
            return f"deadline missed, {count} so far"
        case "dropped":
            return f"{count} frames dropped before this one"
        case "command_accepted":
            return f"command {items['command']} accepted, {count} so far"
        case "command_refused":
            return f"command {items['command']} refused, {items['outcome']}: {count} so far"
