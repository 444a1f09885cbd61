"""Writes the comparison of two recorded motions as a recording: aligned on time and on the path, with their differences."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from deltaph.telemetry.axes import labelled
from deltaph.telemetry.compared_corners import compared_corners, corner_view
from deltaph.telemetry.corner import excess
from deltaph.telemetry.destination import written_to
from deltaph.telemetry.focus import LONG, Range, around, time_axis
from deltaph.telemetry.scene import FloatArray
from deltaph.telemetry.side import COLORS, Side

PATH_TIMELINE = "arc_length_um"
"""Arc length of the planned path so far; a viewer's timeline counts whole numbers."""

PATH_STEP = 5e-4
"""Between two points of the comparison along the path [m]: in the slowest corner the tool moves further in a step of 1 ms."""


_DARK_JOINTS = ((35, 85, 120), (120, 95, 20), (15, 95, 70))
_JOINTS = ((130, 205, 250), (250, 215, 100), (90, 225, 175))
_WIDTHS = {"a": (5.0, 7.0, 3.5), "b": (1.5, 2.8, 1.2)}
"""Of the joints' lines: where joints 2 and 3 move alike, joint 2 shows as a rim of joint 3."""

_LINES = partial(rr.SeriesLines, aggregation_policy=rr.components.AggregationPolicy.MinMax)

_LIMIT = (235, 60, 60)
_GREY = (230, 230, 230)

_NEAR = 6.0
"""The distance to a vertex is shown up to this many prescribed deviations."""

_BAR = 1e-3
"""Width of a bar where differences are shown along the path [m]."""


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
        self._near = 1e3 * _NEAR * max(float(side.scene.corner_deviation.max()) for side in sides)
        self._spans: dict[str, tuple[float, float]] = {}  # least and greatest value of each entity
        self._common_time = _common_time(sides)
        self._worst = _worst(sides, self._common_time)
        self._are_together = _are_together(sides)
        self._common = [quantity for quantity in sides[0].quantities() if quantity in sides[1].quantities()]

    def write(self, path: Path) -> None:
        """Write the file.

        Raises:
            EnvironmentProblem: a recording lacks what is compared.
            OSError: the file cannot be written.
        """
        stream = rr.RecordingStream("deltaph-comparison")
        stream.set_log_time_enabled(False)
        with written_to(path, stream):
            stream.send_recording_name(" against ".join(side.name for side in self._sides))
            stream.send_property("comparison", rr.AnyValues(json=self._facts_json))
            stream.log("verdict", rr.TextDocument(self._markdown, media_type=rr.MediaType.MARKDOWN), static=True, strict=True)
            for entity, archetype in compared_corners(self._sides):
                stream.log(entity, archetype, static=True, strict=True)
            for quantity in self._common:
                self._write_quantity(stream, quantity)
            for side in self._sides:
                self._write_prescribed(stream, side)
            if not self._are_together:
                self._write_alignment(stream)
            stream.send_blueprint(self._blueprint())

    def _write_quantity(self, stream: rr.RecordingStream, quantity: str) -> None:
        unit = self._sides[0].unit(quantity)[0]
        points = self._points()
        on_time, on_path = [], []
        for side in self._sides:
            rows, values = side.rows(quantity), side.shown(quantity)
            self._style(stream, f"{quantity}/{side.letter}", side, values.shape[1], unit)
            self._send(stream, f"{quantity}/{side.letter}", values, rows.nanoseconds)
            reached = points[points <= side.arc_length[-1]]
            along = side.on_path(reached, values, rows.nanoseconds)
            self._send(stream, f"{quantity}/{side.letter}", along, reached)
            on_time.append((rows.nanoseconds, values))
            on_path.append(along)
        series = on_time[0][1].shape[1]
        entity = f"difference/{quantity}"
        names = [f"B - A, joint {i + 1} [{unit}]" for i in range(3)] if series == 3 else [f"B - A [{unit}]"]
        colors, widths = (_JOINTS, _WIDTHS["b"]) if series == 3 else ([_GREY], (2.0,))
        stream.log(entity, _LINES(names=names, colors=list(colors), widths=list(widths)), static=True, strict=True)
        (times, of_a), (times_b, of_b) = on_time
        common = times[(times >= times_b[0]) & (times <= times_b[-1])]
        at = np.stack([np.interp(common, times_b, column) for column in of_b.T], axis=1)
        self._send(stream, entity, at - of_a[np.isin(times, common)], common)
        self._write_along(stream, quantity, on_path)

    def _write_alignment(self, stream: rr.RecordingStream) -> None:
        """How far each has come at a time, and when each is at a point."""
        points = self._points()
        reached = []
        for side in self._sides:
            times = side.rows("path/arc_length", "setpoint").nanoseconds
            self._style(stream, f"progress/{side.letter}", side, 1, "mm")
            self._send(stream, f"progress/{side.letter}", 1e3 * side.arc_length[:, None], times)
            along = points[points <= side.arc_length[-1]]
            milliseconds = side.on_path(along, 1e-6 * (times[:, None] - times[0]), times)
            self._style(stream, f"time_at_point/{side.letter}", side, 1, "ms")
            self._send(stream, f"time_at_point/{side.letter}", milliseconds, along)
            reached.append(milliseconds)
        style = _LINES(names=["B - A [ms]"], colors=[_GREY], widths=[2.0])
        stream.log("difference/time_at_point", style, static=True, strict=True)
        self._write_along(stream, "time_at_point", reached)

    def _write_along(self, stream: rr.RecordingStream, quantity: str, values: list[FloatArray]) -> None:
        """The difference at the points of the path that both reach, as rows, and as bars where there is one of it."""
        shared = min(map(len, values))
        a, b, points = values[0][:shared], values[1][:shared], self._points()[:shared]
        difference = b - a
        self._send(stream, f"difference/{quantity}", difference, points)
        if quantity == "path/deviation":  # half way, where the nearer vertex is another one, it says nothing of a corner
            difference = np.where(np.minimum(a, b) < self._near, difference, 0.0)
        if difference.shape[1] == 1:
            first, last = self._shown_path()
            bars = np.flatnonzero((points >= first) & (points <= last))[:: round(_BAR / PATH_STEP)]
            factor = 1e3 if quantity == "tcp/speed" else 1.0  # mm/s: the viewer chooses the range, and would write no more than 0
            chart = rr.BarChart(factor * difference[bars, 0], abscissa=1e3 * (points[bars] - first), color=COLORS["b"])
            stream.log(f"along_path/{quantity}", chart, static=True, strict=True)

    def _shown_path(self) -> tuple[float, float]:
        """From which whole millimetre to where the differences along the path are shown as bars [m]."""
        shown = self._shown_time()
        if shown is None:
            return 0.0, np.inf
        ends = [
            np.interp(shown, 1e-9 * side.rows("path/arc_length", "setpoint").nanoseconds, side.arc_length) for side in self._sides
        ]
        return 1e-3 * round(1e3 * min(first for first, _ in ends)), float(max(last for _, last in ends))

    def _shown_time(self, *, narrow: bool = False) -> Range | None:
        """From when to when plots show the motions; None is all, where neither is long. Where one is not, the time of that one."""
        if self._worst is not None:
            return around(self._worst, narrow=narrow)
        return self._common_time

    def _write_prescribed(self, stream: rr.RecordingStream, side: Side) -> None:
        """Which deviations are prescribed."""
        times = side.rows("path/arc_length", "setpoint").nanoseconds
        points = self._points()
        points = points[points <= side.arc_length[-1]]
        prescribed = 1e3 * np.unique(side.scene.corner_deviation)
        name = f"{side.letter.upper()} prescribed [mm]"
        entity = f"path/deviation/prescribed_{side.letter}"
        style = _LINES(names=[name] * len(prescribed), colors=[_LIMIT] * len(prescribed), widths=[1.5] * len(prescribed))
        stream.log(entity, style, static=True, strict=True)
        for ends in (times[[0, -1]], points[[0, -1]]):
            self._send(stream, entity, np.tile(prescribed, (2, 1)), ends)

    def _points(self) -> FloatArray:
        """Arc lengths of the comparison along the path, up to the end of the longer one (m,) [m]."""
        longest = max(float(side.arc_length[-1]) for side in self._sides)
        return np.linspace(0.0, PATH_STEP * int(longest / PATH_STEP), int(longest / PATH_STEP) + 1)

    @staticmethod
    def _style(stream: rr.RecordingStream, entity: str, side: Side, series: int, unit: str) -> None:
        """A is broad, and dark where three joints share a plot; B is thin and bright, and drawn above it."""
        letter = side.letter.upper()
        names = [f"{letter} joint {i + 1} [{unit}]" for i in range(3)] if series == 3 else [f"{letter}: {side.name} [{unit}]"]
        joints = _DARK_JOINTS if side.letter == "a" else _JOINTS
        colors, widths = (joints, _WIDTHS[side.letter]) if series == 3 else ([side.color], _WIDTHS[side.letter][:1])
        stream.log(entity, _LINES(names=names, colors=list(colors), widths=list(widths)), static=True, strict=True)

    def _send(self, stream: rr.RecordingStream, entity: str, values: FloatArray, index: Any) -> None:
        """Rows (n, series) over simulation times [ns] or, where the index is of floats, over arc lengths [m]."""
        if index.dtype == np.int64:
            column = rr.TimeColumn("sim_time", duration=index.astype("timedelta64[ns]"))
            low, high = self._spans.get(entity, (np.inf, -np.inf))
            self._spans[entity] = min(low, float(values.min())), max(high, float(values.max()))
        else:
            column = rr.TimeColumn(PATH_TIMELINE, sequence=np.rint(1e6 * index).astype(np.int64))
        stream.send_columns(entity, [column], rr.Scalars.columns(scalars=values), strict=True)

    def _plot(
        self, name: str, entity: str, *, within: Range | None = None, legend: bool = False, narrow: bool = False
    ) -> rrb.TimeSeriesView:
        """A plot of an entity and what is below it over time, within a range or over all values. Three share the height."""
        if within is None:
            spans = [span for found, span in self._spans.items() if found == entity or found.startswith(f"{entity}/")]
            within = labelled(min(low for low, _ in spans), max(high for _, high in spans), 9)
        return rrb.TimeSeriesView(
            name=name,
            origin="/",
            contents=[f"{entity}/**"],
            axis_x=time_axis(self._shown_time(narrow=narrow)),
            axis_y=rrb.ScalarAxis(range=within),
            plot_legend=rrb.PlotLegend(visible=legend, corner=rrb.Corner2D.RightBottom),
        )

    def _blueprint(self) -> rrb.Blueprint:
        def unit(quantity: str) -> str:
            return self._sides[0].unit(quantity)[0].replace(".", "·").replace("2", "²")

        where = f", around {self._worst:.1f} s" if self._worst is not None else ", while there are both"
        where = where if self._common_time is not None else ""
        first, last = (1e3 * end for end in self._shown_path())
        counted = f" from {first:.0f} mm on" if first else ""
        travelled = labelled(first, last, 9) if np.isfinite(last) else None

        def bars(name: str, quantity: str) -> rrb.BarChartView:
            title = f"{name}, over arc length [mm]{counted}"
            return rrb.BarChartView(name=title, origin=f"along_path/{quantity}", plot_legend=rrb.PlotLegend(visible=False))

        motion = rrb.Vertical(
            self._plot(
                f"Vertex distance [mm]{where}: A broad blue, B thin orange, prescribed red",
                "path/deviation",
                within=(-0.07 * self._near, self._near),
            ),
            self._plot(f"Tool speed [{unit('tcp/speed')}]", "tcp/speed"),
            self._plot("Distance to the nearer vertex, B - A [mm]", "difference/path/deviation")
            if self._are_together
            else self._plot("Travelled along the path [mm]", "progress", within=travelled, legend=True),
            name="Motion",
        )
        of_joints = _named(self._common)
        joints = rrb.Grid(
            *(self._plot(f"{name} [{unit(quantity)}]: A broad, B thin", quantity, narrow=True) for name, quantity in of_joints),
            grid_columns=2,
            name=f"Joints ({self._joint_words()}){where}",
        )
        differences = rrb.Grid(
            self._plot("Distance to the nearer vertex, B - A [mm]", "difference/path/deviation", narrow=True),
            *(
                self._plot(f"{name}, B - A [{unit(quantity)}]", f"difference/{quantity}", narrow=True)
                for name, quantity in of_joints
            ),
            grid_columns=2,
            name=f"Differences{where}",
        )
        path = rrb.Vertical(
            *([] if self._are_together else [bars("Later at the same point, B - A [ms]", "time_at_point")]),
            bars("Faster at the same point, B - A [mm/s]", "tcp/speed"),
            bars("Distance to a vertex nearby at the same point, B - A [mm]", "path/deviation"),
            name="Along the path",
        )
        left = rrb.Vertical(
            rrb.TextDocumentView(name="A against B", origin="verdict"),
            rrb.Horizontal(corner_view(self._sides, 0), corner_view(self._sides, 1)),
            row_shares=[9, 6],
        )
        return rrb.Blueprint(
            rrb.Horizontal(left, rrb.Tabs(motion, joints, differences, path, active_tab=0)),
            rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
            rrb.SelectionPanel(state="hidden"),
            rrb.BlueprintPanel(state="hidden"),
        )

    def _joint_words(self) -> str:
        """What tells the joints apart in all plots of them."""
        if all(side.scene.coinciding_joints == (2, 3) for side in self._sides):
            return "1 blue, 2 and 3 alike: green over yellow"
        return "1 blue, 2 yellow, 3 green"


def _are_together(sides: tuple[Side, Side]) -> bool:
    """Whether both are at the same point of the path at any time, as a plan and its plant are, or two plants of one plan."""
    a, b = (side.arc_length for side in sides)
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=0.0, atol=1e-9))


def _common_time(sides: tuple[Side, Side]) -> Range | None:
    """Where one of the motions is long, from when to when there are both."""
    ends = [side.path()[0][[0, -1]] for side in sides]
    if max(last - first for first, last in ends) <= LONG:
        return None
    return float(max(first for first, _ in ends)), float(min(last for _, last in ends))


def _worst(sides: tuple[Side, Side], common: Range | None) -> float | None:
    """When the worst pass was that was executed [s], where both motions are long."""
    if common is None or common[1] - common[0] <= LONG:
        return None
    passed = [(excess(side.scene, mark), mark.time) for side in sides if side.role == "actual" for mark in side.marks]
    return max(((beyond, time) for beyond, time in passed if common[0] <= time <= common[1]), default=(0.0, None))[1]


def _named(quantities: list[str]) -> list[tuple[str, str]]:
    """Titles of the quantities that have three series."""
    return [(quantity.replace("/", " ").capitalize(), quantity) for quantity in quantities if quantity[:5] in ("joint", "motor")]
