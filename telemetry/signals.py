"""What a recording plots: which entity shows which fields. Entities, series names and units come from the message layouts."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from deltaph.telemetry.keys import MessageName
from deltaph.telemetry.messages import Records, layout
from deltaph.telemetry.scene import Scene

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]

PLANNED: Color = (130, 200, 255)
EXECUTED: Color = (225, 120, 30)
LIMIT: Color = (235, 60, 60)
JOINTS: tuple[Color, ...] = ((86, 180, 233), (240, 200, 60), (40, 190, 140))
AXES: tuple[Color, ...] = ((230, 90, 90), (110, 200, 90), (90, 140, 240))

_HEAD = ("sequence", "time", "unix_time_ns")
_ENTITIES = {"path/vertex_distance": "path/deviation"}
_JOINED = ("joint_tracking_error", "tcp_tracking_error")  # recorded as setpoint - actual; the plant extrapolates the setpoint


@dataclass(frozen=True, slots=True)
class Signal:
    """An entity with one row of scalars per frame.

    Attributes:
        entity: such as `joint/position/setpoint`.
        message: where its values come from.
        names: of the series, with unit.
        values: records (n,) -> SI values (n,) or (n, series).
    """

    entity: str
    message: MessageName
    names: tuple[str, ...]
    values: Callable[[Records], FloatArray]


@dataclass(frozen=True, slots=True)
class Limit:
    """Constant lines beside a signal.

    Attributes:
        entity: such as `joint/velocity/limit`.
        names: of the lines, with unit.
        values: SI.
    """

    entity: str
    names: tuple[str, ...]
    values: tuple[float, ...]


def style(entity: str, names: Sequence[str]) -> rr.SeriesLines:
    """How an entity's lines look: joints differ by colour; actual values are broad and dark, setpoints thin and bright.

    The viewer draws in the order of names, so that a setpoint lies above its actual value.
    """
    role = entity.rpartition("/")[2]
    if entity.startswith("timing"):
        return rr.SeriesLines(names=list(names), widths=[1.5])
    if role in ("limit", "limit_below"):
        colors: Sequence[Color] = [LIMIT] * len(names)
    elif len(names) == 1:
        colors = [PLANNED if role == "setpoint" else EXECUTED]
    else:
        colors = AXES if entity.startswith("tcp") else JOINTS
    if role == "actual" and len(names) > 1:
        colors = [(r // 2, g // 2, b // 2) for r, g, b in colors]
    return rr.SeriesLines(names=list(names), colors=list(colors), widths=[5.0 if role == "actual" else 1.5] * len(names))


def _group(message: MessageName, group: str, records: Records) -> FloatArray:
    return layout(message).values(records, group)


def _speed(message: MessageName, records: Records) -> FloatArray:
    speed: FloatArray = np.linalg.norm(layout(message).values(records, "tcp_velocity"), axis=1)
    return speed


def _fields(message: MessageName) -> Iterator[Signal]:
    """The Float64 fields of a message, group by group."""
    fields = [f for f in layout(message).fields if f.type == "float64" and f.name not in _HEAD and f.group not in _JOINED]
    for group, members in groupby(fields, key=lambda field: field.group):
        names = [(field.name, field.unit) for field in members]
        entity = re.sub(r"\[\d\]|\.[xyz]$", "", names[0][0]).replace(".", "/")
        entity = f"timing/{entity}" if message == "timing" else f"{_ENTITIES.get(entity, entity)}/{message}"
        yield Signal(entity, message, tuple(f"{name} {message} [{unit}]" for name, unit in names), partial(_group, message, group))


def signals(scene: Scene) -> list[Signal]:
    """All that comes from one message: its fields, the tool's speed, and the executed path's distance to the nearer vertex."""
    found = [signal for message in ("setpoint", "actual", "timing") for signal in _fields(message)]
    found += [Signal(f"tcp/speed/{m}", m, (f"tcp.speed {m} [m/s]",), partial(_speed, m)) for m in ("setpoint", "actual")]
    found.append(
        Signal(
            "path/deviation/actual",
            "actual",
            ("path.vertex_distance actual [m]",),
            lambda records: scene.vertex_distance(layout("actual").values(records, "tcp_position")),
        )
    )
    return found


TRACKING_ERRORS = {
    "joint/tracking_error": ("joint_position", tuple(f"joint[{i}].tracking_error [rad]" for i in (1, 2, 3))),
    "tcp/tracking_error": ("tcp_position", tuple(f"tcp.tracking_error.{axis} [m]" for axis in "xyz")),
}
"""Entity -> the group of which setpoint and actual value are subtracted, and the names of the series."""


def limits(scene: Scene) -> Iterator[Limit]:
    """The limits of what is recorded: one line where all joints have the same, and for joints the same below zero."""
    units = {signal.entity.rpartition("/")[0]: signal.names[0].rpartition(" ")[2] for signal in signals(scene)}
    prescribed = ("path/deviation", tuple(np.unique(scene.corner_deviation).tolist()))
    given = [(quantity.replace("_", "/", 1), tuple(np.unique(value).tolist())) for quantity, value in scene.limits.items()]
    for entity, values in (prescribed, *given):
        finite = tuple(value for value in values if np.isfinite(value))
        if entity not in units or not finite:
            continue
        names = tuple(f"{entity.replace('/', '.')} limit {units[entity]}" for _ in finite)
        yield Limit(f"{entity}/limit", names, finite)
        if entity.startswith("joint"):
            yield Limit(f"{entity}/limit_below", names, tuple(-value for value in finite))
