"""How the viewer lays a recording out: whether the deviation was kept comes first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType

import numpy as np
import rerun.blueprint as rrb

from deltaph.telemetry import corner
from deltaph.telemetry.axes import labelled
from deltaph.telemetry.scene import UP, Scene
from deltaph.telemetry.signals import CORNER, MISSED_DEADLINES, PLOT, color_of_plan, shown_unit
from deltaph.telemetry.world import ARROWS, COMMANDED_PATH, CORNERS, EXECUTED_PATH

TRACE_SECONDS = 1.0
"""Of the executed path that the cell shows before and after the cursor: a whole run of hours would not scrub."""

_ALWAYS = rrb.VisibleTimeRanges(
    [rrb.VisibleTimeRange("sim_time", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite())]
)
_AROUND = rrb.VisibleTimeRanges(
    [
        rrb.VisibleTimeRange(
            "sim_time",
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRACE_SECONDS),
            end=rrb.TimeRangeBoundary.cursor_relative(seconds=TRACE_SECONDS),
        )
    ]
)

Spans = Mapping[str, tuple[float, float]]
"""Entity -> its least and greatest value."""

_NO_SPANS: Spans = MappingProxyType({})

_FAR_LIMIT = 3.0
"""A limit this many times the planned peak is outside of the picture, where it would flatten the curves; its name says so."""


def _cell(scene: Scene) -> rrb.Spatial3DView:
    """Seen with pick on the left and place on the right, a little from above; the robot fills the picture."""
    vertices = np.concatenate([move.vertices for move in scene.moves])
    low = float(min(move.right_angle_path[:, 2].min() for move in scene.moves))
    target = np.array([0.3 * vertices[:, 0].mean(), 0.3 * vertices[:, 1].mean(), 0.5 * low])
    across = scene.moves[0].across
    direction = np.cross(across, UP) + 0.35 * across + 0.22 * UP
    return rrb.Spatial3DView(
        origin="world",
        name="Cell",
        contents=["$origin/**"],
        overrides={EXECUTED_PATH: _AROUND, COMMANDED_PATH: _AROUND, ARROWS: rrb.EntityBehavior(visible=False)},
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=target - 2.15 * low * direction / np.linalg.norm(direction),
            look_target=target,
            eye_up=UP,
        ),
        line_grid=False,
    )


def _corner(scene: Scene, index: int) -> rrb.Spatial2DView:
    several = f", {len(scene.moves)} moves on top of each other" if len(scene.moves) > 1 else ""
    if scene.served:
        several = f", newest {len(scene.moves)} plans" if len(scene.moves) > 1 else ""
    return rrb.Spatial2DView(
        origin=f"corner/{CORNERS[index]}",
        name=f"{CORNERS[index].capitalize()} corner [mm]{several}",
        contents=["$origin/**"],
        overrides={corner.executed_entity(index): _ALWAYS},
        visual_bounds=corner.bounds(index, corner.size(scene, index)),
    )


def _within(spans: Spans, contents: Sequence[str]) -> tuple[float, float] | None:
    """A range of values for what is plotted; None where nothing is known of it."""
    below = tuple(content.removesuffix("**") for content in contents if content.endswith("/**"))
    found = [span for entity, span in spans.items() if entity in contents or entity.startswith(below)]
    return labelled(min(low for low, _ in found), max(high for _, high in found)) if found else None


def _plot(
    spans: Spans,
    name: str,
    *contents: str,
    within: tuple[float, float] | None = None,
    during: tuple[float, float] | None = None,
    legend: bool = False,
) -> rrb.TimeSeriesView:
    """A plot.

    Args:
        spans: of what is recorded.
        name: with unit, and what the lines are.
        contents: entities.
        within: range of values; that of the contents where it is not given.
        during: range of time [s]; all, and the same in all plots, where it is not given.
        legend: whether it is shown, which takes room.
    """
    if during is None:
        time = rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)
    else:
        ends = [rrb.TimeRangeBoundary.absolute(seconds=seconds) for seconds in during]
        time = rrb.TimeAxis(view_range=rrb.TimeRange(start=ends[0], end=ends[1]))
    if within is None:
        within = _within(spans, contents)
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=list(contents),
        axis_x=time,
        axis_y=rrb.ScalarAxis(range=within) if within is not None else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
    )


def _joint_plot(scene: Scene, spans: Spans, words: str, quantity: str, si: str, note: str = "") -> rrb.TimeSeriesView:
    """A quantity of the joints with its limits, which are left out of the picture where they are far away."""
    unit, factor = shown_unit(f"[{si}]")
    prefix = PLOT if factor != 1.0 else ""
    peak = factor * scene.peaks.get(quantity, np.inf)
    limits = factor * np.ravel(scene.limits.get(quantity, np.inf))
    entity = f"{prefix}{quantity.replace('_', '/', 1)}"
    name = f"{words} [{unit.replace('.', '·').replace('2', '²')}]{note}"
    finite = limits[np.isfinite(limits)]
    if not len(finite):
        return _plot(spans, name, f"{entity}/**")
    if np.isfinite(peak) and finite.min() > _FAR_LIMIT * peak:
        words = f"{name}, planned peak {peak:.3g}, limit ±{finite.min():.4g} outside"
        within = _within(spans, [f"{entity}/setpoint", f"{entity}/actual"]) or labelled(-peak, peak)
        return _plot(spans, words, f"{entity}/**", within=within)
    return _plot(spans, f"{name}, limit red", f"{entity}/**")


def _deviations(scene: Scene, spans: Spans) -> rrb.Container | rrb.View:
    """The distance to the vertices: of one move around each corner, of several over all of the time."""
    entity = f"{PLOT}path/deviation/**"
    top = 4.0 * max(corner.size(scene, 0), corner.size(scene, 1))
    if scene.served:
        return rrb.Vertical(
            _plot(spans, "Deviation at each corner [mm]: planned violet, executed orange, prescribed red", f"{corner.PASSES}/**"),
            _plot(
                spans, "Setpoint's distance to the nearer vertex [mm]", f"{PLOT}path/deviation/setpoint", within=(-0.05 * top, top)
            ),
        )
    if len(scene.moves) > 1:
        planned = "violet" if color_of_plan(scene) == CORNER else "blue"
        return rrb.Vertical(
            _plot(spans, "Deviation at each corner [mm]: planned violet, executed orange, prescribed red", f"{corner.PASSES}/**"),
            _plot(spans, f"Distance to the nearer vertex [mm]: planned {planned}, executed orange", entity, within=(0.0, top)),
        )
    views = []
    for index, name in enumerate(CORNERS):
        size = corner.size(scene, index)
        at = 0.01 * round(100.0 * float(scene.moves[0].corner_times[index]))  # no number at either end, where it would be cut off
        title = f"{name.capitalize()} vertex, first pass [mm], limit {size:g}"  # the corner's picture tells the colours
        views.append(_plot(spans, title, entity, within=(-0.2 * size, 3.0 * size), during=(at - 0.025, at + 0.025)))
    return rrb.Horizontal(*views)


def _joint_words(coinciding: Sequence[int]) -> str:
    """What tells the joints apart, and which ones cannot be."""
    if not coinciding:
        return "joint 1 blue, 2 yellow, 3 green"
    colors = ("blue", "yellow", "green")
    under, over = coinciding
    apart = ({1, 2, 3} - {under, over}).pop()
    return f"{apart} {colors[apart - 1]}; {under} and {over} move alike: {colors[over - 1]} over {colors[under - 1]}"


def blueprint(scene: Scene, *, live: bool = False, spans: Spans = _NO_SPANS) -> rrb.Blueprint:
    """The layout of a recording.

    Args:
        scene: what is known before the run.
        live: whether the cursor stays at the newest rows.
        spans: of what has been recorded; without them the viewer chooses ranges, and may write no more than a nought at an axis.
    """
    plot, joint_plot = partial(_plot, spans), partial(_joint_plot, scene, spans)
    joints = _joint_words(scene.coinciding_joints)
    deviation = rrb.Vertical(
        _deviations(scene, spans),
        plot("Tool tracking error, setpoint - actual [mm]: x red, y green, z blue", f"{PLOT}tcp/tracking_error"),
        plot(f"Joint tracking error [deg]: {joints}", f"{PLOT}joint/tracking_error"),
        rrb.StateTimelineView(name="Phase and trip", origin="/", contents=["operation", "phase", "trip"]),
        row_shares=[3, 2.5, 2.5, 1.5] if len(scene.moves) == 1 and not scene.served else [5, 2, 2, 1.5],
        name="Deviation",
    )
    motion = rrb.Vertical(
        joint_plot("Joint position", "joint_position", "rad", f": {joints}; range red"),
        joint_plot("Joint velocity", "joint_velocity", "rad/s", ": broad actual, thin setpoint"),
        joint_plot("Joint acceleration", "joint_acceleration", "rad/s2"),
        joint_plot("Joint torque", "joint_torque", "N.m"),
        name="Joints",
    )
    drives = rrb.Vertical(
        plot(f"Motor torque [N·m]: {joints}", "motor/torque/**"),
        plot("Motor load, 1 is rated", "motor/load/**"),
        plot("Motor speed [rad/s]", "motor/speed/**"),
        plot("Rod force [N]", "rod/force/**"),
        name="Drives",
    )
    tool = rrb.Vertical(
        plot("Tool speed [m/s]: broad actual, thin setpoint", "tcp/speed/**"),
        plot("Tool position [m]: x red, y green, z blue", "tcp/position/**"),
        name="Tool",
    )
    _, missed = spans.get("timing/missed_deadlines", (0.0, 0.0))
    timing = rrb.Vertical(
        plot("Step times and lateness [ms]", f"{PLOT}timing", legend=True),
        plot("Missed deadlines", "timing/missed_deadlines", within=labelled(0.0, max(1.0, missed))),
        plot("Real-time factor", "timing/real_time_factor"),
        name="Timing",
    )
    columns = rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["LogLevel", "Body"])
    events = rrb.Vertical(
        rrb.Horizontal(
            rrb.TextLogView(name="Events", origin="/", contents=["event"], columns=columns),
            rrb.TextLogView(name="Missed deadlines", origin="/", contents=[MISSED_DEADLINES], columns=columns),
            column_shares=[3, 2],
        ),
        rrb.StateTimelineView(name="Phase and trip", origin="/", contents=["operation", "phase", "trip"]),
        row_shares=[3, 1],
        name="Events",
    )
    left = rrb.Vertical(
        rrb.Horizontal(rrb.TextDocumentView(name="Verdict", origin="summary"), _cell(scene), column_shares=[6, 4]),
        rrb.Horizontal(_corner(scene, 0), _corner(scene, 1)),
        row_shares=[11, 9],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Tabs(deviation, motion, drives, tool, timing, events, active_tab=0), column_shares=[11, 9]),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following" if live else "paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
