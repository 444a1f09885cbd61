"""How the viewer lays a recording out: whether the deviation was kept comes first."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from deltaph.telemetry.scene import FloatArray, Scene
from deltaph.telemetry.world import CORNERS, EXECUTED_PATH

_ALWAYS = rrb.VisibleTimeRanges(
    [rrb.VisibleTimeRange("sim_time", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite())]
)
_SO_FAR = rrb.VisibleTimeRanges(
    [rrb.VisibleTimeRange("sim_time", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative())]
)


def _looking(scene: Scene, target: FloatArray, distance: float, aside: float = 0.0, above: float = 0.0) -> rrb.EyeControls3D:
    """A camera that sees pick on the left and place on the right; `aside` and `above` turn it off the normal of that plane."""
    up = np.array([0.0, 0.0, 1.0])
    direction = np.cross(scene.across, up) + aside * scene.across + above * up
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + distance * direction / np.linalg.norm(direction),
        look_target=target,
        eye_up=up,
    )


def _cell(scene: Scene) -> rrb.Spatial3DView:
    height = 0.5 * float(scene.vertices[:, 2].mean())
    target = np.array([*scene.vertices[:, :2].mean(axis=0), height])
    return rrb.Spatial3DView(
        origin="world",
        name="Cell",
        contents=["$origin/**"],
        overrides={EXECUTED_PATH: _SO_FAR},
        eye_controls=_looking(scene, target, -4.4 * height, aside=0.35, above=0.25),
        line_grid=False,
    )


def _corner(scene: Scene, index: int) -> rrb.Spatial3DView:
    deviation = max(float(scene.corner_deviation[index]), 1e-3)
    inside = scene.across if index == 0 else -scene.across
    target = scene.vertices[index] + deviation * (inside - np.array([0.0, 0.0, 1.0]))
    millimetres = f"{1000.0 * scene.corner_deviation[index]:g} mm"
    return rrb.Spatial3DView(
        origin="world",
        name=f"{CORNERS[index].capitalize()} corner: prescribed {millimetres}",
        contents=["world/path/**", f"world/corner/{CORNERS[index]}/**", f"- world/corner/{CORNERS[index]}/ball"],
        overrides={EXECUTED_PATH: _ALWAYS},
        eye_controls=_looking(scene, target, 5.0 * deviation),
        line_grid=False,
    )


def _plot(name: str, *contents: str, top: float | None = None) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=list(contents),
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        axis_y=rrb.ScalarAxis(range=(0.0, top)) if top is not None else None,
        plot_legend=rrb.PlotLegend(visible=False),
    )


def blueprint(scene: Scene) -> rrb.Blueprint:
    """The layout of a recording."""
    near = 5.0 * float(scene.corner_deviation.max())
    motion = rrb.Vertical(
        _plot("Distance to the nearer vertex [m]: red is the prescribed deviation", "path/deviation/**", top=near),
        _plot(
            "Joint velocity [rad/s]: broad actual, thin setpoint; joint 1 blue, 2 yellow, 3 green (covers 2 on moves along x)",
            "joint/velocity/**",
        ),
        _plot("Joint torque [N.m]", "joint/torque/**"),
        _plot("Joint tracking error: setpoint - actual [rad]", "joint/tracking_error"),
        rrb.StateTimelineView(name="Phase", origin="/", contents=["phase", "trip"]),
        row_shares=[3, 2, 2, 2, 1.7],
        name="Deviation and joints",
    )
    tool = rrb.Vertical(
        _plot("Tool speed [m/s]", "tcp/speed/**"),
        _plot("Tool position [m]", "tcp/position/**"),
        _plot("Tool tracking error: setpoint - actual [m]", "tcp/tracking_error"),
        _plot("Joint position [rad]", "joint/position/**"),
        _plot("Joint acceleration [rad/s2]", "joint/acceleration/**"),
        name="Tool and more",
    )
    drives = rrb.Vertical(
        _plot("Motor torque [N.m]", "motor/torque/**"),
        _plot("Motor speed [rad/s]", "motor/speed/**"),
        _plot("Rod force [N]", "rod/force/**"),
        name="Drives",
    )
    timing = rrb.Vertical(
        _plot("Step times and lateness [s]", "timing/planner_step", "timing/plant_step", "timing/publish", "timing/lateness"),
        _plot("Missed deadlines", "timing/missed_deadlines"),
        _plot("Real-time factor", "timing/real_time_factor"),
        rrb.TextLogView(name="Events", origin="event"),
        name="Timing",
    )
    left = rrb.Vertical(
        rrb.Horizontal(_cell(scene), rrb.TextDocumentView(name="Summary", origin="summary"), column_shares=[4, 5]),
        rrb.Horizontal(_corner(scene, 0), _corner(scene, 1)),
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Tabs(motion, tool, drives, timing, active_tab=0), column_shares=[1, 1]),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
