"""Which entity of a recording shows which fields of the messages. Entities, series names and units come from the layouts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from typing import Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from deltaph.telemetry.keys import MessageName
from deltaph.telemetry.messages import Records, layout
from deltaph.telemetry.scene import Scene

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]

PLANNED: Color = (120, 150, 200)
EXECUTED: Color = (255, 150, 40)
LIMIT: Color = (235, 60, 60)
JOINTS: tuple[Color, ...] = ((86, 180, 233), (240, 200, 60), (40, 190, 140))
AXES: tuple[Color, ...] = ((230, 90, 90), (110, 200, 90), (90, 140, 240))

_HEAD = ("sequence", "time", "unix_time_ns")
_ENTITIES = {"path/vertex_distance": "path/deviation"}
_DERIVED = ("joint_tracking_error", "tcp_tracking_error")  # recorded as setpoint - actual; the plant's own figures are the same


@dataclass(frozen=True, slots=True)
class Signal:
    """An entity with one row of scalars per frame.

    Attributes:
        entity: such as `joint/position/setpoint`.
        message: where its values come from.
        group: the message's fields.
        names: of the series, with unit.
    """

    entity: str
    message: MessageName
    group: str
    names: tuple[str, ...]

    @property
    def style(self) -> rr.SeriesLines:
        """Joints differ by colour; a setpoint is broad and dark, an actual value thin and bright above it."""
        setpoint = self.entity.endswith("/setpoint")
        if len(self.names) == 1:
            colors: Sequence[Color] = (PLANNED if setpoint else EXECUTED,)
        else:
            colors = AXES if self.entity.startswith("tcp") else JOINTS
        if setpoint:
            colors = [(r // 2 + 20, g // 2 + 20, b // 2 + 20) for r, g, b in colors]
        return rr.SeriesLines(names=list(self.names), colors=list(colors), widths=[5.0 if setpoint else 1.5] * len(self.names))


def _recorded(message: MessageName) -> Iterator[Signal]:
    """The Float64 fields of a message, group by group."""
    fields = [f for f in layout(message).fields if f.type == "float64" and f.name not in _HEAD and f.group not in _DERIVED]
    for group, members in groupby(fields, key=lambda field: field.group):
        names = [(field.name, field.unit) for field in members]
        entity = re.sub(r"\[\d\]|\.[xyz]$", "", names[0][0]).replace(".", "/")
        entity = f"timing/{entity}" if message == "timing" else f"{_ENTITIES.get(entity, entity)}/{message}"
        yield Signal(entity, message, group, tuple(f"{name} {message} [{unit}]" for name, unit in names))


@cache
def signals() -> tuple[Signal, ...]:
    """All that is recorded as it stands in the messages."""
    return tuple(signal for message in ("setpoint", "actual", "timing") for signal in _recorded(message))


DEVIATION = Signal("path/deviation/actual", "actual", "tcp_position", ("path.vertex_distance actual [m]",))
SPEED = {
    message: Signal(f"tcp/speed/{message}", message, "tcp_velocity", (f"tcp.speed {message} [m/s]",)) for message in ("setpoint", "actual")
}
ERRORS = (
    Signal("joint/tracking_error", "actual", "joint_position", tuple(f"joint[{i}].tracking_error [rad]" for i in (1, 2, 3))),
    Signal("tcp/tracking_error", "actual", "tcp_position", tuple(f"tcp.tracking_error.{axis} [m]" for axis in "xyz")),
)


def limits(scene: Scene) -> dict[str, FloatArray]:
    """Entity -> values of the limits that are recorded: one where all are equal, the lower ones beside the upper ones."""
    units = {"joint_velocity": "rad/s"}
    found = {"path/deviation/limit": np.unique(scene.corner_deviation)}
    for quantity, value in scene.limits.items():
        ...
    return found
