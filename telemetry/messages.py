"""Message layouts, generated from the variable tables.

A payload is CDR little-endian: the 4-byte header 00 01 00 00, then fields of fixed size that are aligned relative to byte 4. With
the 8-byte fields first there is no padding, so that any language reads a message with the offsets of the schema and nothing else.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltaph.frame import TIMING, Frame, records
from deltaph.telemetry.commands import commands_schema
from deltaph.telemetry.events import EVENT_FLOATS, EVENT_INTEGERS, Event
from deltaph.telemetry.keys import MESSAGE_NAMES, MessageName
from deltaph.variables import Model, Variable, variable_table

HEADER = bytes((0, 1, 0, 0))
"""Encapsulation header of CDR little-endian."""

Records = NDArray[np.void]
"""Decoded messages of one layout: a structured array (n,)."""

_VERSIONS: dict[MessageName, int] = {"timing": 3, "event": 2, "plan": 2}
"""Version of a layout that is not the first. Timing 2 accounts for missed deadlines by cause and counts what sinks did not get,
3 knows no cause `consumer`: who consumes is no part of the loop's process; event 2 has commands; plan 2 counts what was cancelled.
Items that are appended to an enumeration change no layout."""

_HEAD = struct.Struct("<4sQdQ")
_SIZES = {"uint64": 8, "float64": 8, "int32": 4}
_FORMATS = {"uint64": "<u8", "float64": "<f8", "int32": "<i4"}


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message.

    Attributes:
        name: that of the FMU variable.
        type: on the wire.
        offset: from the start of the payload, header included [bytes].
        unit: SI unit, or None for what is not a physical quantity.
        group: name of the array or scalar it belongs to, such as `joint_position`.
        items: of an enumeration, numbered from 0; empty where it is none.
    """

    name: str
    type: Literal["uint64", "float64", "int32"]
    offset: int
    unit: str | None
    description: str
    group: str
    items: tuple[str, ...] = ()

    @property
    def word(self) -> str:
        """The name as an identifier, such as `joint_1_position`."""
        return re.sub(r"[^a-z0-9]+", "_", self.name.lower())

    def schema(self) -> dict[str, Any]:
        """For JSON."""
        facts = {"name": self.name, "type": self.type, "unit": self.unit, "offset": self.offset, "description": self.description}
        return facts | {"enumeration": list(self.items)} if self.items else facts


class _Columns(NamedTuple):
    """Where a block of a message comes from: an array of the frame or event, and columns of it."""

    array: str
    columns: slice | NDArray[np.intp]

    def of(self, frame: Frame | Event) -> NDArray[Any]:
        values: NDArray[Any] = getattr(frame, self.array)[self.columns]
        return values


class Layout:
    """The layout of one message.

    Attributes:
        key: last chunk of the message's key.
        name: such as `Setpoint`.
        encoding: Zenoh encoding, schema suffix included.
        fields: in order.
        size: of the payload, header included [bytes].
        dtype: numpy dtype of the whole payload; its names are the fields'.
    """

    def __init__(self, key: MessageName, fields: tuple[Field, ...], floats: _Columns, integers: _Columns | None) -> None:
        self.key = key
        self.name = key.capitalize()
        self.encoding = f"application/cdr;deltaph.{self.name};v={_VERSIONS.get(key, 1)}"
        self.fields = fields
        self.size = fields[-1].offset + _SIZES[fields[-1].type]
        self.dtype: np.dtype[np.void] = np.dtype(
            {
                "names": [field.name for field in fields],
                "formats": [_FORMATS[field.type] for field in fields],
                "offsets": [field.offset for field in fields],
                "itemsize": self.size,
            }
        )
        self._floats = floats
        self._integers = integers
        counts = [sum(field.type == kind for field in fields) for kind in ("float64", "int32")]
        self._blocks = np.dtype(
            [
                ("header", "S4"),
                ("sequence", "<u8"),
                ("time", "<f8"),
                ("unix_time_ns", "<u8"),
                ("floats", "<f8", (counts[0] - 1,)),
                ("integers", "<i4", (counts[1],)),
            ]
        )

    def encode(self, frame: Frame | Event, sequence: int) -> bytes:
        """The payload for a frame, or for an event."""
        parts = [
            _HEAD.pack(HEADER, sequence, frame.time, frame.unix_time_ns),
            self._floats.of(frame).astype("<f8", copy=False).tobytes(),
        ]
        if self._integers is not None:
            parts.append(self._integers.of(frame).astype("<i4", copy=False).tobytes())
        return b"".join(parts)

    def decode(self, payload: bytes) -> np.void:
        """The record of a payload.

        Raises:
            ValueError: it is not of this layout.
        """
        if len(payload) != self.size or payload[:4] != HEADER:
            raise ValueError(
                f"not a {self.name} message: {len(payload)} bytes that begin with {payload[:4].hex(' ')}, "
                f"instead of {self.size} that begin with {HEADER.hex(' ')}"
            )
        record: np.void = np.frombuffer(payload, self.dtype)[0]
        return record

    def records(self, frames: Sequence[Frame]) -> Records:
        """What decoding the messages of frames would give, with their step as sequence number (n,)."""
        given = records(frames)
        blocks = np.zeros(len(frames), self._blocks)
        blocks["header"] = HEADER
        blocks["sequence"] = given["step"]
        blocks["time"] = given["time"]
        blocks["unix_time_ns"] = given["unix_time_ns"]
        blocks["floats"] = given[self._floats.array][:, self._floats.columns]
        if self._integers is not None:
            blocks["integers"] = given[self._integers.array][:, self._integers.columns]
        return blocks.view(self.dtype)

    def values(self, records: Records, group: str) -> NDArray[Any]:
        """A group of fields: (n, 3), or (n,) where it is a scalar.

        Raises:
            KeyError: the message has no such group.
        """
        names = [field.name for field in self.fields if field.group == group]
        if not names:
            raise KeyError(f"a {self.name} message has no {group!r}")
        return np.stack([records[name] for name in names], axis=-1) if len(names) > 1 else np.array(records[names[0]])

    def as_dict(self, record: np.void) -> dict[str, float | int]:
        """Field name -> value."""
        return dict(zip((field.name for field in self.fields), record.item(), strict=True))

    def schema(self) -> dict[str, Any]:
        """The layout for JSON: all that a foreign reader needs."""
        return {
            "name": self.name,
            "encoding": self.encoding,
            "header": HEADER.hex(" "),
            "size": self.size,
            "fields": [field.schema() for field in self.fields],
            "ros_message": self.ros_message(),
        }

    def ros_message(self) -> str:
        """The same layout as a ROS 2 interface definition (`.msg`); items of enumerations are its constants."""
        lines = []
        for field in self.fields:
            lines += [f"int32 {field.word.upper()}_{item.upper()}={number}" for number, item in enumerate(field.items)]
            lines.append(f"{field.type} {field.word}  # {field.description}" + (f" [{field.unit}]" if field.unit else ""))
        return "\n".join(lines) + "\n"


_HEAD_FIELDS = (
    Field("sequence", "uint64", 0, None, "Number of the message; a gap is a loss", "sequence"),
    Field("time", "float64", 0, "s", "Simulation time", "time"),
    Field("unix_time_ns", "uint64", 0, "ns", "Wall clock when the outputs were read", "unix_time_ns"),
)


def _placed(fields: Iterable[Field]) -> tuple[Field, ...]:
    """The head and these fields, one after the other."""
    placed: list[Field] = []
    offset = len(HEADER)
    for field in (*_HEAD_FIELDS, *fields):
        placed.append(replace(field, offset=offset))
        offset += _SIZES[field.type]
    return tuple(placed)


def _items(model: Model, variable: Variable) -> tuple[str, ...]:
    if variable.type == "Boolean":
        return ("false", "true")
    return () if variable.type == "Int32" else variable_table(model).items(variable.type)


def _columns(array: str, outputs: Sequence[Variable], chosen: Sequence[Variable]) -> _Columns:
    found = np.array([outputs.index(variable) for variable in chosen])
    if len(found) and np.array_equal(found, np.arange(found[0], found[-1] + 1)):
        return _Columns(array, slice(int(found[0]), int(found[-1]) + 1))
    return _Columns(array, found)


def _from_outputs(key: MessageName, model: Model, chosen: Sequence[Variable]) -> Layout:
    """A message of some of an FMU's outputs."""
    outputs = variable_table(model).of("output")
    floats = [v for v in chosen if v.is_float]
    integers = [v for v in chosen if not v.is_float]
    fields = [Field(v.name, "float64", 0, v.unit, v.description, v.group) for v in floats]
    fields += [Field(v.name, "int32", 0, None, v.description, v.group, _items(model, v)) for v in integers]
    return Layout(
        key,
        _placed(fields),
        _columns(f"{model}_floats", [v for v in outputs if v.is_float], floats),
        _columns(f"{model}_integers", [v for v in outputs if not v.is_float], integers),
    )


@cache
def layout(key: MessageName) -> Layout:
    """The layout of a message."""
    outputs = variable_table("planner").of("output")
    match key:
        case "setpoint":
            return _from_outputs(key, "planner", [v for v in outputs if not v.name.startswith("plan.")])
        case "plan":
            return _from_outputs(key, "planner", [v for v in outputs if v.name.startswith("plan.")])
        case "actual":
            return _from_outputs(key, "plant", variable_table("plant").of("output"))
        case "timing":
            fields = [Field(name, "float64", 0, unit, description, name) for name, unit, description in TIMING]
            return Layout(key, _placed(fields), _Columns("timing", slice(None)), None)
        case "event":
            fields = [Field(name, "float64", 0, unit, description, name) for name, unit, description in EVENT_FLOATS]
            fields += [Field(name, "int32", 0, None, description, name, items) for name, items, description in EVENT_INTEGERS]
            return Layout(key, _placed(fields), _Columns("floats", slice(None)), _Columns("integers", slice(None)))


def schema_document() -> dict[str, Any]:
    """Every message by the last chunk of its key, and the commands: what the queryable `schema` answers."""
    return {"messages": {key: layout(key).schema() for key in MESSAGE_NAMES}, "commands": commands_schema()}
