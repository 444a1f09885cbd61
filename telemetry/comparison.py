"""Writes the comparison of two recorded motions as a recording: aligned on time and on the path, with their differences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.reading import FloatArray, Reading, Rows

PATH_TIMELINE = "arc_length_um"
"""Arc length of the planned path so far; a viewer's timeline counts whole numbers."""

PATH_STEP = 1e-4
"""Between two points of the comparison along the path [m]."""

_QUANTITIES = ("path/deviation", "joint/position", "joint/velocity", "joint/acceleration", "joint/torque", "tcp/speed")
_OF_PLANT = ("motor/torque",)
_SHOWN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "rad/s": ("deg/s", 180.0 / np.pi), "rad/s2": ("deg/s2", 180.0 / np.pi)}
"""Unit that is recorded -> unit and factor for people; others stay."""

_COLORS = {"a": (90, 190, 255), "b": (255, 140, 40)}
_DARK_JOINTS = ((35, 85, 120), (120, 95, 20), (15, 95, 70))
_JOINTS = ((130, 205, 250), (250, 215, 100), (90, 225, 175))
_LIMIT = (235, 60, 60)
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)


@dataclass(frozen=True)
class Side:
    """One of the two motions.

    Attributes:
        letter: a or b.
        name: for legends.
        reading: where it is recorded.
        role: setpoint (planned) or actual (executed).
        right_angle_path: (4, 3) [m].
        corner_deviation: prescribed (2,) [m].
    """

    letter: str
    name: str
    reading: Reading
    role: str
    right_angle_path: FloatArray
    corner_deviation: FloatArray

    @cached_property
    def arc_length(self) -> FloatArray:
        """Of the planned path at each frame, all operations one after the other (n,) [m].

        An executed motion is where its plan is at that moment: a robot that lags behind is late, not elsewhere.
        """
        travelled = self.rows("path/arc_length", "setpoint").values[:, 0]
        return np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(travelled), 0.0))])

    def rows(self, quantity: str, role: str | None = None) -> Rows:
        """A recorded quantity.

        Raises:
            EnvironmentProblem: it is not recorded.
        """
        entity = f"{quantity}/{role or self.role}"
        if entity not in self.reading.rows:
            raise EnvironmentProblem(f"{self.reading.path} has no {entity}: record the run again with this version")
        return self.reading.rows[entity]

    def shown(self, quantity: str) -> FloatArray:
        """Values of a quantity in the unit for people (n, series)."""
        factor: FloatArray = self.rows(quantity).values * _unit(self, quantity)[1]
        return factor

    def quantities(self) -> list[str]:
        """What is compared of this motion."""
        return [*_QUANTITIES, *(_OF_PLANT if self.role == "actual" else ())]

    def on_path(self, points: FloatArray, values: FloatArray, times: NDArray[np.int64]) -> FloatArray:
        """Values (n, series) at times (n,) [ns], where the planned path has the arc lengths `points` (m,) [m]: (m, series)."""
        where = np.interp(times, self.rows("path/arc_length", "setpoint").nanoseconds, self.arc_length)
        moving = np.concatenate([[True], np.diff(where) > 0.0])  # where it rests, the moment of arrival counts
        return np.stack([np.interp(points, where[moving], column[moving]) for column in values.T], axis=1)


def _unit(side: Side, quantity: str) -> tuple[str, float]:
    recorded = side.reading.units.get(f"{quantity}/{side.role}", "")
    return _SHOWN.get(recorded, (recorded, 1.0))


class Comparison:
    """Writes the recording.

    Args:
        sides: the two motions; differences are the second minus the first.
        markdown: the verdicts side by side.
        facts_json: the same for programs.
    """

    def __init__(self, sides: tuple[Side, Side], markdown: str, facts_json: str) -> None:
        self._sides = sides
        self._markdown = markdown
        self._facts_json = facts_json
        self._common = [quantity for quantity in sides[0].quantities() if quantity in sides[1].quantities()]

    def write(self, path: Path) -> None:
        """Write the file.

        Raises:
            EnvironmentProblem: a recording lacks what is compared.
        """
        with rr.RecordingStream("deltaph-comparison") as stream:
            stream.set_log_time_enabled(False)
            stream.save(path, default_blueprint=self._blueprint())
            stream.send_recording_name(" against ".join(side.name for side in self._sides))
            stream.send_property("comparison", rr.AnyValues(json=self._facts_json))
            stream.log("verdict", rr.TextDocument(self._markdown, media_type=rr.MediaType.MARKDOWN), static=True, strict=True)
            for entity, archetype in self._world():
                stream.log(entity, archetype, static=True, strict=True)
            for quantity in self._common:
                self._write_quantity(stream, quantity)
            self._write_alignment(stream)

    def _write_quantity(self, stream: rr.RecordingStream, quantity: str) -> None:
        unit = _unit(self._sides[0], quantity)[0]
        points = self._points()
        on_time, on_path = [], []
        for side in self._sides:
            rows, values = side.rows(quantity), side.shown(quantity)
            self._style(stream, f"{quantity}/{side.letter}", side, values.shape[1], unit)
            _send(stream, f"{quantity}/{side.letter}", values, rows.nanoseconds)
            reached = points[points <= side.arc_length[-1]]
            along = side.on_path(reached, values, rows.nanoseconds)
            _send(stream, f"{quantity}/{side.letter}", along, reached)
            on_time.append((rows.nanoseconds, values))
            on_path.append(along)
        series = on_time[0][1].shape[1]
        entity = f"difference/{quantity}"
        names = [f"B - A, joint {i + 1} [{unit}]" for i in range(3)] if series == 3 else [f"B - A [{unit}]"]
        colors = list(_JOINTS) if series == 3 else [(230, 230, 230)]
        stream.log(entity, rr.SeriesLines(names=names, colors=colors, widths=[2.0] * series), static=True, strict=True)
        (times, of_a), (times_b, of_b) = on_time
        common = times[(times >= times_b[0]) & (times <= times_b[-1])]
        at = np.stack([np.interp(common, times_b, column) for column in of_b.T], axis=1)
        _send(stream, entity, at - of_a[np.isin(times, common)], common)
        shared = min(map(len, on_path))
        _send(stream, entity, on_path[1][:shared] - on_path[0][:shared], points[:shared])

    def _write_alignment(self, stream: rr.RecordingStream) -> None:
        """How far each has come at a time, when each is at a point, and which deviations are prescribed."""
        points = self._points()
        reached = []
        for side in self._sides:
            times = side.rows("path/arc_length", "setpoint").nanoseconds
            self._style(stream, f"progress/{side.letter}", side, 1, "mm")
            _send(stream, f"progress/{side.letter}", 1e3 * side.arc_length[:, None], times)
            along = points[points <= side.arc_length[-1]]
            milliseconds = side.on_path(along, 1e-6 * (times[:, None] - times[0]), times)
            self._style(stream, f"time_at_point/{side.letter}", side, 1, "ms")
            _send(stream, f"time_at_point/{side.letter}", milliseconds, along)
            reached.append(milliseconds)
            self._write_prescribed(stream, side, times, along)
        shared = min(map(len, reached))
        style = rr.SeriesLines(names=["B - A [ms]"], colors=[(230, 230, 230)], widths=[2.0])
        stream.log("difference/time_at_point", style, static=True, strict=True)
        _send(stream, "difference/time_at_point", reached[1][:shared] - reached[0][:shared], points[:shared])

    def _write_prescribed(self, stream: rr.RecordingStream, side: Side, times: NDArray[np.int64], points: FloatArray) -> None:
        prescribed = 1e3 * np.unique(side.corner_deviation)
        name = f"{side.letter.upper()} prescribed [mm]"
        entity = f"path/deviation/prescribed_{side.letter}"
        style = rr.SeriesLines(names=[name] * len(prescribed), colors=[_LIMIT] * len(prescribed), widths=[1.5] * len(prescribed))
        stream.log(entity, style, static=True, strict=True)
        for ends in (times[[0, -1]], points[[0, -1]]):
            _send(stream, entity, np.tile(prescribed, (2, 1)), ends)

    def _points(self) -> FloatArray:
        """Arc lengths of the comparison along the path, up to the end of the longer one (m,) [m]."""
        longest = max(float(side.arc_length[-1]) for side in self._sides)
        return np.linspace(0.0, PATH_STEP * int(longest / PATH_STEP), int(longest / PATH_STEP) + 1)

    @staticmethod
    def _style(stream: rr.RecordingStream, entity: str, side: Side, series: int, unit: str) -> None:
        """A is thin and bright, drawn above B, which is broad and dark where three joints share a plot."""
        letter = side.letter.upper()
        names = [f"{letter} joint {i + 1} [{unit}]" for i in range(3)] if series == 3 else [f"{letter}: {side.name} [{unit}]"]
        joints = _JOINTS if side.letter == "a" else _DARK_JOINTS
        colors = list(joints) if series == 3 else [_COLORS[side.letter]]
        width = 2.0 if series == 1 or side.letter == "a" else 5.0
        stream.log(entity, rr.SeriesLines(names=names, colors=colors, widths=[width] * series), static=True, strict=True)

    def _world(self) -> Iterator[tuple[str, Any]]:
        yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
        for side in self._sides:
            color, letter = _COLORS[side.letter], side.letter
            position = side.rows("tcp/position").values
            yield f"world/{letter}/path", rr.LineStrips3D([position], colors=[color], radii=[_pixels(2.0)])
            grey = (120, 120, 120)
            yield f"world/{letter}/right_angle", rr.LineStrips3D([side.right_angle_path], colors=[grey], radii=[_pixels(1.0)])
            across = _across(side)
            for name, vertex, deviation in zip(("pick", "place"), side.right_angle_path[1:3], side.corner_deviation, strict=True):
                circle = vertex + deviation * (np.outer(np.cos(_CIRCLE), across) + np.outer(np.sin(_CIRCLE), [0.0, 0.0, 1.0]))
                yield f"world/{letter}/circle/{name}", rr.LineStrips3D([circle], colors=[_LIMIT], radii=[_pixels(1.0)])
                nearest = position[np.argmin(np.linalg.norm(position - vertex, axis=1))]
                label = f"{letter.upper()} {1e3 * np.linalg.norm(nearest - vertex):.2f} mm"
                yield (
                    f"world/{letter}/nearest/{name}",
                    rr.Points3D([nearest], colors=[color], radii=[_pixels(4.0)], labels=[label], show_labels=False),
                )

    def _corner(self, index: int) -> rrb.Spatial3DView:
        """A corner of A's path, seen at right angles."""
        side = self._sides[0]
        deviation = max(float(s.corner_deviation[index]) for s in self._sides)
        up, across = np.array([0.0, 0.0, 1.0]), _across(side)
        target = side.right_angle_path[1 + index] + 1.5 * deviation * ((across if index == 0 else -across) - up)
        eye = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=target + 8.0 * deviation * np.cross(across, up),
            look_target=target,
            eye_up=up,
        )
        name = ("Pick", "Place")[index]
        return rrb.Spatial3DView(
            origin="world", name=f"{name} corner: A blue, B orange, prescribed red", eye_controls=eye, line_grid=False
        )

    def _blueprint(self) -> rrb.Blueprint:
        def plot(name: str, *contents: str, top: float | None = None, legend: bool = True) -> rrb.TimeSeriesView:
            return rrb.TimeSeriesView(
                name=name,
                origin="/",
                contents=list(contents),
                axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
                axis_y=rrb.ScalarAxis(range=(0.0, top)) if top is not None else None,
                plot_legend=rrb.PlotLegend(visible=legend, corner=rrb.Corner2D.LeftTop),
            )

        def unit(quantity: str) -> str:
            return _unit(self._sides[0], quantity)[0]

        near = 1e3 * 6.0 * max(float(side.corner_deviation.max()) for side in self._sides)
        motion = rrb.Vertical(
            plot("Vertex distance [mm]: A blue, B orange, prescribed red", "path/deviation/**", top=near, legend=False),
            plot(f"Tool speed [{unit('tcp/speed')}]", "tcp/speed/**", legend=False),
            plot("Travelled along the path [mm], against sim_time", "progress/**"),
            name="Motion",
        )
        joints = rrb.Vertical(
            *(
                plot(f"{name} [{unit(quantity)}]: A thin and bright, B broad and dark", f"{quantity}/**", legend=number == 0)
                for number, (name, quantity) in enumerate(_named(self._common))
            ),
            name="Joints",
        )
        differences = rrb.Vertical(
            plot("Distance to the nearer vertex, B - A [mm]", "difference/path/deviation", legend=False),
            *(
                plot(f"{name}, B - A [{unit(quantity)}]", f"difference/{quantity}", legend=number == 0)
                for number, (name, quantity) in enumerate(_named(self._common))
            ),
            name="Differences",
        )
        path = rrb.Vertical(
            plot("Time at the same point [ms], against arc_length_um: choose it at the bottom left", "time_at_point/**"),
            plot("Time at the same point, B - A [ms], against arc_length_um", "difference/time_at_point", legend=False),
            name="Along the path",
        )
        left = rrb.Vertical(
            rrb.TextDocumentView(name="A against B", origin="verdict"),
            rrb.Horizontal(self._corner(0), self._corner(1)),
            row_shares=[9, 5],
        )
        return rrb.Blueprint(
            rrb.Horizontal(left, rrb.Tabs(motion, joints, differences, path, active_tab=0)),
            rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
            rrb.SelectionPanel(state="hidden"),
            rrb.BlueprintPanel(state="hidden"),
        )


def _named(quantities: list[str]) -> list[tuple[str, str]]:
    """Titles of the quantities that have three series."""
    return [(quantity.replace("/", " ").capitalize(), quantity) for quantity in quantities if quantity[:5] in ("joint", "motor")]


def _across(side: Side) -> FloatArray:
    """Horizontal direction from pick to place (3,)."""
    direction = side.right_angle_path[2] - side.right_angle_path[1]
    direction = direction * [1.0, 1.0, 0.0]
    unit: FloatArray = direction / np.linalg.norm(direction)
    return unit


def _pixels(count: float) -> Any:
    return rr.components.Radius.ui_points(count)


def _send(stream: rr.RecordingStream, entity: str, values: FloatArray, index: Any) -> None:
    """Rows (n, series) over simulation times [ns] or, where the index is of floats, over arc lengths [m]."""
    if index.dtype == np.int64:
        column = rr.TimeColumn("sim_time", duration=index.astype("timedelta64[ns]"))
    else:
        column = rr.TimeColumn(PATH_TIMELINE, sequence=np.rint(1e6 * index).astype(np.int64))
    stream.send_columns(entity, [column], rr.Scalars.columns(scalars=values), strict=True)
