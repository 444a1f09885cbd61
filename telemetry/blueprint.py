"""How the viewer lays a recording out: whether the deviation was kept comes first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from deltaph.telemetry import corner
from deltaph.telemetry.axes import labelled
from deltaph.telemetry.focus import LONG, Range, around, close_to, newest, time_axis
from deltaph.telemetry.scene import UP, CornerMark, Scene
from deltaph.telemetry.signals import CORNER, MISSED_DEADLINES, PLOT, STEP_TIMES, color_of_plan, shown_unit
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


def _within(spans: Spans, contents: Sequence[str], numbers: int = 6) -> tuple[float, float] | None:
    """A range of values for what is plotted; None where nothing is known of it."""
    below = tuple(content.removesuffix("**") for content in contents if content.endswith("/**"))
    found = [span for entity, span in spans.items() if entity in contents or entity.startswith(below)]
    return labelled(min(low for low, _ in found), max(high for _, high in found), numbers) if found else None


def _plot(
    spans: Spans,
    name: str,
    *contents: str,
    within: tuple[float, float] | None = None,
    time: rrb.TimeAxis | None = None,
    numbers: int = 6,
    legend: bool = False,
    visible: Mapping[str, Sequence[bool]] = MappingProxyType({}),
) -> rrb.TimeSeriesView:
    """A plot.

    Args:
        spans: of what is recorded.
        name: with unit, and what the lines are.
        contents: entities.
        within: range of values; that of the contents where it is not given.
        time: axis of time; of all the time, and the same in all plots, where it is not given.
        numbers: that there is room for at the axis of values; by default where four plots share the height.
        legend: whether it is shown, which takes room.
        visible: which series of an entity are shown; all where nothing is said.
    """
    if within is None:
        within = _within(spans, contents, numbers)
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=list(contents),
        axis_x=time or time_axis(None),
        axis_y=rrb.ScalarAxis(range=within) if within is not None else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
        overrides={entity: rr.SeriesLines.from_fields(visible_series=series) for entity, series in visible.items()},
    )


def _joint_plot(
    scene: Scene,
    spans: Spans,
    words: str,
    quantity: str,
    si: str,
    note: str = "",
    *,
    time: rrb.TimeAxis | None = None,
    numbers: int = 6,
) -> rrb.TimeSeriesView:
    """A quantity of the joints with its limits, which are left out of the picture where they are far away."""
    unit, factor = shown_unit(f"[{si}]")
    prefix = PLOT if factor != 1.0 else ""
    peak = factor * scene.peaks.get(quantity, np.inf)
    limits = factor * np.ravel(scene.limits.get(quantity, np.inf))
    entity = f"{prefix}{quantity.replace('_', '/', 1)}"
    name = f"{words} [{unit.replace('.', '·').replace('2', '²')}]{note}"
    finite = limits[np.isfinite(limits)]
    plot = partial(_plot, spans, time=time, numbers=numbers)
    if quantity == "joint_position":
        return plot(f"{name}; range red", f"{entity}/**")
    if not len(finite):
        return plot(f"{name}, no limit", f"{entity}/**")
    if np.isfinite(peak) and finite.min() > _FAR_LIMIT * peak:
        words = f"{name}, planned peak {peak:.3g}, limit ±{finite.min():.4g} outside"
        within = _within(spans, [f"{entity}/setpoint", f"{entity}/actual"], numbers) or labelled(-peak, peak, numbers)
        return plot(words, f"{entity}/**", within=within)
    return plot(f"{name}, limit red", f"{entity}/**")


def _passes(scene: Scene, spans: Spans) -> rrb.View:
    """By how much each pass of a corner exceeds what is prescribed."""
    limit = f"tolerated {1e3 * scene.tolerance:g}" if scene.tolerance else "limit"
    title = f"Beyond the prescribed deviation [mm]: planned violet, executed orange, {limit} red"
    return _plot(spans, title, f"{corner.EXCESS}/**")


def _vertex(scene: Scene, spans: Spans, index: int, passed: Sequence[CornerMark]) -> rrb.View:
    """The distance to a vertex around the closest approach of its worst pass; as planned, the first one, where there was none."""
    several = len(scene.moves) > 1 or f"{corner.EXCESS}/executed" in spans
    found = next((mark for mark in passed if mark.corner == index), None)
    move = scene.moves[found.move if found is not None else 0]
    size = 1e3 * float(move.corner_deviation[index])
    moment = found.time if found is not None else float(move.corner_times[index])
    which = " vertex" if not several else ", first pass" if found is None else f", worst at {moment:.3f} s"
    title = f"{CORNERS[index].capitalize()}{which} [mm], limit {size:g}"  # the corner's picture tells the colours
    top = 3.0 * max(size, 1.0)
    return _plot(spans, title, f"{PLOT}path/deviation/**", within=(-0.07 * top, top), time=time_axis(close_to(moment)))


def _deviations(scene: Scene, spans: Spans, passed: Sequence[CornerMark], *, live: bool) -> list[rrb.Container | rrb.View]:
    """Every pass of a corner, where there are many, then the worst of each side; while the cell runs, what is known by then."""
    if live:
        top = 4.0 * max(corner.size(scene, 0), corner.size(scene, 1))
        planned = "violet" if color_of_plan(scene) == CORNER else "blue"
        words = "Setpoint's distance" if scene.served else "Distance"
        colors = "" if scene.served else f": planned {planned}, executed orange, limit red"
        title = f"{words} to the nearer vertex [mm]{colors}"
        return [_plot(spans, title, f"{PLOT}path/deviation/**", within=(-0.07 * top, top), time=newest())]
    many = scene.served or len(scene.moves) > 1 or f"{corner.EXCESS}/executed" in spans
    vertices = [] if scene.served else [rrb.Horizontal(*(_vertex(scene, spans, index, passed) for index in (0, 1)))]
    return [*([_passes(scene, spans)] if many else []), *vertices]


def _focus(scene: Scene, time: Range, passed: Sequence[CornerMark]) -> Range | None:
    """Of a long recording the time around the worst pass of all."""
    if not passed or time[1] - time[0] <= LONG:
        return None
    return around(max(passed, key=partial(corner.excess, scene)).time)


def _step_times(spans: Spans, name: str, shown: Sequence[str], time: rrb.TimeAxis) -> rrb.View:
    """Some of the step times, which share an entity: lateness would flatten the others."""
    found = [spans[f"timing/{field}"] for field in shown if f"timing/{field}" in spans]
    within = labelled(1e3 * min(low for low, _ in found), 1e3 * max(high for _, high in found)) if found else None
    entity = f"{PLOT}timing"
    visible = {entity: [field in shown for field in STEP_TIMES]}
    return _plot(spans, name, entity, within=within, time=time, legend=len(shown) > 1, visible=visible)


def _joint_words(coinciding: Sequence[int]) -> str:
    """What tells the joints apart, and which ones cannot be."""
    if not coinciding:
        return "joint 1 blue, 2 yellow, 3 green"
    colors = ("blue", "yellow", "green")
    under, over = coinciding
    apart = ({1, 2, 3} - {under, over}).pop()
    return f"{apart} {colors[apart - 1]}; {under} and {over} are planned alike: {colors[over - 1]} over {colors[under - 1]}"


def blueprint(
    scene: Scene,
    *,
    live: bool = False,
    spans: Spans = _NO_SPANS,
    time: Range = (0.0, 0.0),
    passed: Sequence[CornerMark] = (),
) -> rrb.Blueprint:
    """The layout of a recording.

    Args:
        scene: what is known before the run.
        live: whether the cursor stays at the newest rows, and plots show what is before it.
        spans: of what has been recorded; without them the viewer chooses ranges, and may write no more than a nought at an axis.
        time: first and last of the recording [s].
        passed: the worst pass of each side.
    """
    focus = _focus(scene, time, passed)
    whole, shown = (newest(), newest()) if live else (time_axis(None), time_axis(focus))
    plot, joint_plot = partial(_plot, spans, time=whole), partial(_joint_plot, scene, spans, time=shown)
    which = f", worst pass at {max(passed, key=partial(corner.excess, scene)).time:.1f} s" if focus is not None else ""
    joints = _joint_words(scene.coinciding_joints)
    deviations = _deviations(scene, spans, passed, live=live)
    lanes = partial(rrb.StateTimelineView, origin="/", contents=["operation", "phase", "trip"])
    deviation = rrb.Vertical(
        *deviations,
        plot("Tool tracking error, setpoint - actual [mm]: x red, y green, z blue", f"{PLOT}tcp/tracking_error"),
        plot(f"Joint tracking error [deg]: {joints}", f"{PLOT}joint/tracking_error"),
        lanes(name=f"Phase and trip{which}", time_view=shown),
        row_shares=[*([3] * len(deviations)), 2.5, 2.5, 1.5 if len(deviations) == 1 else 2.8],
        name="Deviation",
    )
    motion = rrb.Vertical(
        joint_plot("Joint position", "joint_position", "rad", f"{which}: {joints}"),
        joint_plot("Joint velocity", "joint_velocity", "rad/s", ": broad actual, thin setpoint", numbers=10),
        joint_plot("Joint acceleration", "joint_acceleration", "rad/s2"),
        joint_plot("Joint torque", "joint_torque", "N.m"),
        row_shares=[2.5, 3.5, 3, 3],
        name="Joints",
    )
    drives = rrb.Vertical(
        joint_plot("Motor torque", "motor_torque", "N.m", f"{which}: {joints}"),
        plot("Motor load, 1 is rated", "motor/load/**"),
        plot("Motor speed [rad/s]", "motor/speed/**", time=shown),
        plot("Rod force [N]", "rod/force/**", time=shown),
        name="Drives",
    )
    tool = rrb.Vertical(
        joint_plot("Tool speed", "tcp_speed", "m/s", f"{which}: broad actual, thin setpoint", numbers=13),
        plot("Tool position [m]: x red, y green, z blue", "tcp/position/**", time=shown, numbers=13),
        name="Tool",
    )
    _, missed = spans.get("timing/missed_deadlines", (0.0, 0.0))
    timing = rrb.Vertical(
        _step_times(spans, "Step times [ms]", STEP_TIMES[:-1], whole),
        _step_times(spans, "Lateness [ms], in real time", STEP_TIMES[-1:], whole),
        plot("Missed deadlines, in real time", "timing/missed_deadlines", within=labelled(0.0, max(1.0, missed))),
        plot("Real-time factor", "timing/real_time_factor"),
        name="Timing",
    )
    columns = rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["LogLevel", "Body"])
    events = rrb.Vertical(
        rrb.TextLogView(name="Events", origin="/", contents=["event"], columns=columns),
        rrb.TextLogView(name="Missed deadlines, in real time", origin="/", contents=[MISSED_DEADLINES], columns=columns),
        lanes(name="Phase and trip", time_view=whole),
        row_shares=[5, 2, 2],
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
