"""Writes the paper's figures 4 to 8 as a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from deltaph.telemetry.axes import labelled
from deltaph.telemetry.destination import written_to
from deltaph.telemetry.world import pixels

FloatArray = NDArray[np.float64]

_COLORS = {"proposed": (90, 190, 255), "comparison": (255, 140, 40)}
_THREE = ((86, 180, 233), (240, 200, 60), (40, 190, 140))
_WIDTHS = (2.0, 5.0, 2.0)
"""The second is broad: joints 2 and 3 coincide on a move along x, and one would hide the other."""

_DEVIATION = "figure_4/deviation"
"""Where the corner deviations are shown: in the local picture, not in that of the entire path."""

_AXES = "x blue, y yellow, z green"
_ALIKE = "1 blue, 2 yellow, seen as a rim of 3, green"


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """What the figures show of one method, SI, base frame.

    Attributes:
        name: proposed or comparison.
        time: of the plan (n,).
        tcp_position: (n, 3).
        tcp_velocity: (n, 3).
        joint_position: (n, 3).
        joint_velocity: (n, 3).
        right_angle_path: (4, 3).
        corner_deviation: of the first corner.
        executed_time: (m,).
        executed_velocity: of the joints (m, 3).
        motor_torque: (m, 3).
    """

    name: str
    time: FloatArray
    tcp_position: FloatArray
    tcp_velocity: FloatArray
    joint_position: FloatArray
    joint_velocity: FloatArray
    right_angle_path: FloatArray
    corner_deviation: float
    executed_time: FloatArray
    executed_velocity: FloatArray
    motor_torque: FloatArray


def write_figures(path: Path, methods: tuple[Method, Method], markdown: str) -> None:
    """Write the recording: the claims as text, figure 4 in space, figures 5 and 6 as planned, 7 and 8 as executed.

    Raises:
        OSError: the file cannot be written.
    """
    stream = rr.RecordingStream("deltaph-paper")
    stream.set_log_time_enabled(False)
    with written_to(path, stream, _blueprint(methods)):
        stream.send_recording_name("The paper's section 4")
        stream.log("claims", rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True, strict=True)
        stream.log("figure_4", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
        _write_strip(stream, "figure_4/right_angle", methods[0].right_angle_path, (130, 130, 130), 1.0)
        _write_deviations(stream, methods)
        for number, method in enumerate(methods):
            _write_strip(stream, f"figure_4/{method.name}", method.tcp_position, _COLORS[method.name], 2.0)
            planned, executed = f"figure_{5 + number}", f"figure_{7 + number}"
            _write(stream, f"{planned}/a", method.time, method.tcp_velocity, [f"v{axis} [m/s]" for axis in "xyz"])
            _write(stream, f"{planned}/b", method.time, np.degrees(method.joint_position), _joints("deg"))
            _write(stream, f"{planned}/c", method.time, method.joint_velocity, _joints("rad/s"))
            _write(stream, f"{executed}/a", method.executed_time, method.executed_velocity, _joints("rad/s"))
            _write(stream, f"{executed}/b", method.executed_time, method.motor_torque, _joints("N.m"))


def _joints(unit: str) -> list[str]:
    return [f"joint {i} [{unit}]" for i in (1, 2, 3)]


def _write_strip(stream: rr.RecordingStream, entity: str, points: FloatArray, color: tuple[int, int, int], width: float) -> None:
    stream.log(entity, rr.LineStrips3D([points], colors=[color], radii=[pixels(width)]), static=True, strict=True)


def _write_deviations(stream: rr.RecordingStream, methods: tuple[Method, Method]) -> None:
    """From the first vertex to the nearest point of each path, and above the corner, where no path comes, how far that is."""
    _, vertex, second, _ = methods[0].right_angle_path
    across, largest = (second - vertex) / np.linalg.norm(second - vertex), max(method.corner_deviation for method in methods)
    for line, method in enumerate(methods):
        color = _COLORS[method.name]
        nearest = method.tcp_position[np.argmin(np.linalg.norm(method.tcp_position - vertex, axis=1))]
        _write_strip(stream, f"{_DEVIATION}/{method.name}", np.array([vertex, nearest]), color, 1.0)
        at = vertex + largest * (2.0 * across + np.array([0.0, 0.0, 1.5 - 0.7 * line]))
        text = f"{method.name} {1e3 * method.corner_deviation:.1f} mm"
        label = rr.Points3D([at], colors=[color], radii=[pixels(0.0)], labels=[text], show_labels=True)
        stream.log(f"{_DEVIATION}/{method.name}/label", label, static=True, strict=True)


def _write(stream: rr.RecordingStream, entity: str, time: FloatArray, values: FloatArray, names: list[str]) -> None:
    """Series (n, 3) over simulation time (n,) [s]."""
    widths = _WIDTHS if names[0].startswith("joint") else (2.0,) * 3
    stream.log(entity, rr.SeriesLines(names=names, colors=list(_THREE), widths=list(widths)), static=True, strict=True)
    index = rr.TimeColumn("sim_time", duration=np.rint(1e9 * time).astype("timedelta64[ns]"))
    stream.send_columns(entity, [index], rr.Scalars.columns(scalars=values), strict=True)


def _plot(name: str, entity: str, values: FloatArray) -> rrb.TimeSeriesView:
    """A plot of values (n, 3); without a legend, which would hide some of them."""
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=[entity],
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        axis_y=rrb.ScalarAxis(range=labelled(float(values.min()), float(values.max()), 12)),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _space(method: Method, name: str, target: FloatArray, distance: float, *contents: str) -> rrb.Spatial3DView:
    """The paths, and what else there is, seen at right angles to their plane, pick on the left."""
    _, first, second, _ = method.right_angle_path
    up = np.array([0.0, 0.0, 1.0])
    toward = np.cross(second - first, up)
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + distance * toward / np.linalg.norm(toward),
        look_target=target,
        eye_up=up,
    )
    return rrb.Spatial3DView(origin="figure_4", name=name, contents=["$origin/**", *contents], eye_controls=eye, line_grid=False)


def _blueprint(methods: tuple[Method, Method]) -> rrb.Blueprint:
    proposed, _ = methods
    pick, first, second, place = proposed.right_angle_path
    across = (second - first) / np.linalg.norm(second - first)
    middle = 0.25 * (pick + first + second + place)
    near = first + 2.0 * proposed.corner_deviation * (across - np.array([0.0, 0.0, 1.0]))
    figure_4 = rrb.Vertical(
        _space(proposed, "4 (a) entire path: proposed blue, comparison orange", middle, 0.22, f"- {_DEVIATION}/**"),
        _space(proposed, "4 (b) local path, with its deviations", near, 8.0 * proposed.corner_deviation),
        name="Figure 4",
    )
    planned = [
        rrb.Vertical(
            _plot(f"{n} (a) tool velocity, {m.name} method, planned [m/s]: {_AXES}", f"figure_{n}/a", m.tcp_velocity),
            _plot(f"{n} (b) joint position [deg]: {_ALIKE}", f"figure_{n}/b", np.degrees(m.joint_position)),
            _plot(f"{n} (c) joint velocity [rad/s]", f"figure_{n}/c", m.joint_velocity),
            name=f"Figure {n}",
        )
        for n, m in enumerate(methods, start=5)
    ]
    executed = [
        rrb.Vertical(
            _plot(f"{n} (a) joint velocity, {m.name} method, executed [rad/s]: {_ALIKE}", f"figure_{n}/a", m.executed_velocity),
            _plot(f"{n} (b) motor torque, executed [N·m]: {_ALIKE}", f"figure_{n}/b", m.motor_torque),
            name=f"Figure {n}",
        )
        for n, m in enumerate(methods, start=7)
    ]
    figures = [figure_4, *planned, *executed]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.TextDocumentView(name="Claims", origin="claims"), rrb.Tabs(*figures, active_tab=0), column_shares=[1, 1]
        ),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
