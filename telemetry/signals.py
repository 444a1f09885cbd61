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
CORNER: Color = (225, 120, 255)
LIMIT: Color = (235, 60, 60)
JOINTS: tuple[Color, ...] = ((86, 180, 233), (240, 200, 60), (40, 190, 140))
AXES: tuple[Color, ...] = ((230, 90, 90), (110, 200, 90), (90, 140, 240))

_HEAD = ("sequence", "time", "unix_time_ns")
_ENTITIES = {"path/vertex_distance": "path/deviation"}
_SHOWN = {
    "m": ("mm", 1e3),
    "rad": ("deg", 180.0 / np.pi),
}
"""SI unit -> unit and factor for people; others stay."""

PLOT = "plot/"
"""Prefix of what is shown in a unit for people; the same entity without it is SI."""

MISSED_DEADLINES = "event/missed_deadline"
"""Events of their own entity: on a busy machine they would bury the others."""

POSITION_STEPS, ERROR_STEPS = 5, 3
"""Communication steps between two rows of a plot: a screen does not show more, and the SI entity has all of them."""

_NEAR = 6.0
"""The distance to a vertex is plotted up to this many prescribed deviations."""

_PLOTTED = ("path/deviation", "joint/position")
_HELD = re.compile(r"timing/(missed_|slipped_|dropped_|lateness)|path/length/|trip_time/")
STEP_TIMES = ("planner_step", "plant_step", "publish", "lateness")
_JOINED = ("joint_tracking_error", "tcp_tracking_error")  # recorded as setpoint - actual; the plant extrapolates the setpoint


@dataclass(frozen=True, slots=True)
class Signal:
    """An entity with rows of scalars: one per frame, but for plots and for what is held.

    Attributes:
        entity: such as `joint/position/setpoint`.
        message: where its values come from.
        names: of the series, with unit.
        values: records (n,) -> values (n,) or (n, series), SI but for plots.
        chosen: records (n,) and values -> which of them become rows (n,); None is all.
    """

    entity: str
    message: MessageName
    names: tuple[str, ...]
    values: Callable[[Records], FloatArray]
    chosen: Callable[[Records, FloatArray], NDArray[np.bool_]] | None = None


def is_held(entity: str) -> bool:
    """Whether a signal keeps its value for so long that it has rows only where it changes, and a last one.

    An entity costs 15 bytes a row beside its values, compressed: counters at full rate would be a sixth of a recording.
    """
    return _HELD.match(entity) is not None


@dataclass(frozen=True, slots=True)
class Limit:
    """Constant lines beside a signal.

    Attributes:
        entity: such as `joint/velocity/limit`.
        names: of the lines, with unit.
        values: in the unit of the names.
    """

    entity: str
    names: tuple[str, ...]
    values: tuple[float, ...]


_WITHOUT_SETPOINT = ("motor/", "rod/", "joint/work/")
_WIDTHS = {"actual": (5.0, 7.0, 3.5), "setpoint": (1.5, 2.8, 1.2)}
"""Of the joints' lines: where joints 2 and 3 move alike, joint 2 shows as a rim of joint 3."""


def color_of_plan(scene: Scene) -> Color:
    """Of what is planned at the corners: PH corners have their own."""
    return CORNER if scene.moves[0].corner_paths else PLANNED


def style(entity: str, names: Sequence[str], scene: Scene) -> rr.SeriesLines:
    """How an entity's lines look: joints differ by colour; actual values are broad and dark, setpoints thin and bright.

    The viewer draws in the order of names, so that a setpoint lies above its actual value. Where many rows share a pixel it draws
    their least and greatest values: the mean, which it would draw, has no peaks.
    """
    lines = partial(rr.SeriesLines, aggregation_policy=rr.components.AggregationPolicy.MinMax)
    role = entity.rpartition("/")[2]
    if "timing" in entity:
        held = rr.components.InterpolationMode.StepAfter if is_held(entity) else None
        colors = (*JOINTS, CORNER)[: len(names)]
        return lines(names=list(names), colors=list(colors), widths=[1.5] * len(names), interpolation_mode=held)
    if role in ("limit", "limit_below"):
        return lines(names=list(names), colors=[LIMIT] * len(names), widths=[1.5] * len(names))
    if len(names) == 1:
        planned = color_of_plan(scene) if "path/deviation" in entity else PLANNED
        color = planned if role == "setpoint" else EXECUTED
        return lines(names=list(names), colors=[color], widths=[5.0 if role == "actual" else 1.5])
    colors = AXES if "tcp" in entity else JOINTS
    if entity.startswith(_WITHOUT_SETPOINT):
        role = "setpoint"
    if role == "actual":
        colors = tuple((r // 2, g // 2, b // 2) for r, g, b in colors)
    return lines(names=list(names), colors=list(colors), widths=list(_WIDTHS.get(role, _WIDTHS["setpoint"])))


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
    """All that comes from one message: its fields, the tool's speed, and the executed path's distance to the nearer vertex.

    Then the same in units for people, where they use others.
    """
    found = [signal for message in ("setpoint", "actual", "timing") for signal in _fields(message)]
    found += [Signal(f"tcp/speed/{m}", m, (f"tcp.speed {m} [m/s]",), partial(_speed, m)) for m in ("setpoint", "actual")]
    if not scene.served:  # the vertices are known while it runs
        found.append(
            Signal(
                "path/deviation/actual",
                "actual",
                ("path.vertex_distance actual [m]",),
                lambda records: scene.vertex_distance(records["time"], layout("actual").values(records, "tcp_position")),
            )
        )
    plotted = [_plotted(signal, scene) for signal in found if signal.entity.rpartition("/")[0] in _PLOTTED]
    return [*found, *plotted, _step_times()]


def every(steps: int, records: Records) -> NDArray[np.bool_]:
    """Which of records (n,) are at every so many communication steps (n,)."""
    chosen: NDArray[np.bool_] = records["sequence"] % steps == 0
    return chosen


def _plotted(signal: Signal, scene: Scene) -> Signal:
    """A signal in the unit for people: the deviation in full near the vertices, the rest as the eye sees it."""
    near = 1e3 * _NEAR * max(float(scene.corner_deviation.max()), 1e-3)

    def chosen(records: Records, values: FloatArray) -> NDArray[np.bool_]:
        return values < near if signal.entity.startswith("path") else every(POSITION_STEPS, records)

    unit, factor = shown_unit(signal.names[0])
    names = tuple(f"{name.rpartition(' ')[0]} [{unit}]" for name in signal.names)
    return Signal(PLOT + signal.entity, signal.message, names, lambda records: factor * signal.values(records), chosen)


def _step_times() -> Signal:
    """What a step takes, in one entity: an entity costs as much as two of its values."""

    def values(records: Records) -> FloatArray:
        return 1e3 * np.stack([records[name] for name in STEP_TIMES], axis=-1)

    return Signal(f"{PLOT}timing", "timing", tuple(f"{name} [ms]" for name in STEP_TIMES), values)


def shown_unit(name: str) -> tuple[str, float]:
    """Unit for people and the factor to it, of a series' name that ends in the SI unit."""
    si = name.rpartition("[")[2].rstrip("]")
    return _SHOWN.get(si, (si, 1.0))


@dataclass(frozen=True, slots=True)
class TrackingError:
    """Setpoint minus actual value, of two messages with the same number.

    Attributes:
        entity: such as `joint/tracking_error`.
        group: of which setpoint and actual value are subtracted.
        names: of the series, with unit.
        factor: to the unit of the names.
    """

    entity: str
    group: str
    names: tuple[str, ...]
    factor: float = 1.0


def _tracking_errors() -> Iterator[TrackingError]:
    for body, names, unit in (
        ("joint", [f"joint[{i}].tracking_error" for i in (1, 2, 3)], "rad"),
        ("tcp", [f"tcp.tracking_error.{axis}" for axis in "xyz"], "m"),
    ):
        yield TrackingError(f"{body}/tracking_error", f"{body}_position", tuple(f"{name} [{unit}]" for name in names))
        shown, factor = _SHOWN[unit]
        shown_names = tuple(f"{name} [{shown}]" for name in names)
        yield TrackingError(f"{PLOT}{body}/tracking_error", f"{body}_position", shown_names, factor)


TRACKING_ERRORS = tuple(_tracking_errors())


def limits(scene: Scene) -> Iterator[Limit]:
    """The limits of what is recorded: one line where all joints have the same, and for joints and motors the same below zero."""
    units = {signal.entity.rpartition("/")[0]: signal.names[0].rpartition(" ")[2] for signal in signals(scene)}
    lines: list[tuple[str, str, tuple[float, ...]]] = [
        ("path/deviation", "limit", () if scene.served else tuple(np.unique(scene.corner_deviation).tolist())),
        ("joint/position", "limit", scene.joint_range[1:]),
        ("joint/position", "limit_below", scene.joint_range[:1]),
    ]
    for quantity, value in scene.limits.items():
        entity, values = quantity.replace("_", "/", 1), tuple(np.unique(value).tolist())
        lines.append((entity, "limit", values))
        if entity.startswith(("joint", "motor")):
            lines.append((entity, "limit_below", tuple(-v for v in values)))
    for entity, role, values in lines:
        finite = tuple(value for value in values if np.isfinite(value))
        if entity not in units or not finite:
            continue
        names = tuple(f"{entity.replace('/', '.')} limit {units[entity]}" for _ in finite)
        yield Limit(f"{entity}/{role}", names, finite)
        if entity in _PLOTTED:
            unit, factor = shown_unit(names[0])
            shown_names = tuple(f"{name.rpartition(' ')[0]} [{unit}]" for name in names)
            yield Limit(f"{PLOT}{entity}/{role}", shown_names, tuple(factor * value for value in finite))
