"""`deltaph plan --plot`: path, tcp speed, and velocity, acceleration, jerk and torque of the joints against their limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deltaph.plan import Plan, time_grid
from deltaph.scenario import Limits
from deltaph.schedule import Operation, Schedule

_JOINT_STYLES = (("tab:blue", "-"), ("tab:orange", "-"), ("tab:green", (0, (4, 3))))
"""Joint 3 is dashed: joints 2 and 3 coincide on a move along x."""


def _draw_path(axes: Axes, plan: Plan, position: NDArray[np.float64], *, corner: bool) -> None:
    """The path in its vertical plane [mm]: all of it, or the first corner."""
    pick = np.array(plan.task.pick)
    width = float(np.linalg.norm(np.array(plan.task.place)[:2] - pick[:2]))
    along = 1e3 * (position[:, :2] - pick[:2]) @ np.array(plan.direction)
    vertex = plan.vertices[0] * 1e3
    axes.plot(
        [0, 0, 1e3 * width, 1e3 * width],
        [1e3 * pick[2], vertex[2], vertex[2], 1e3 * plan.task.place[2]],
        color="0.7",
        label="right angles",
    )
    axes.plot(along, 1e3 * position[:, 2], color="tab:blue", label="path")
    prescribed = 1e3 * plan.task.corner_deviation[0]
    if corner:
        angle = np.linspace(0.0, 2.0 * np.pi, 200)
        axes.plot(
            prescribed * np.cos(angle),
            vertex[2] + prescribed * np.sin(angle),
            color="tab:red",
            lw=0.8,
            label=f"prescribed {prescribed:g} mm",
        )
        reach = min(size for size in (8.0 * prescribed, 1e3 * plan.task.lift[0], 500.0 * width) if size > 0.0)
        axes.set_xlim(-1.5 * prescribed, reach)
        axes.set_ylim(vertex[2] - reach, vertex[2] + 1.5 * prescribed)
        axes.set_title(f"Pick corner: deviation {1e3 * plan.corner_deviation[0]:.4g} mm")
    else:
        axes.set_title("Path")
    axes.set_aspect("equal", adjustable="box" if corner else "datalim")
    axes.set_xlabel("along the traverse [mm]")
    axes.set_ylabel("z [mm]")
    axes.legend(fontsize="small")


def _draw_joints(
    axes: Axes, time_ms: NDArray[np.float64], values: NDArray[np.float64], label: str, limits: tuple[float, ...] | None
) -> None:
    for i, (colour, style) in enumerate(_JOINT_STYLES):
        axes.plot(time_ms, values[:, i], color=colour, ls=style, label=f"joint {i + 1}")
    if limits is not None:
        greatest = float(np.abs(values).max())
        for limit in sorted({limit for limit in limits if limit < 3.0 * greatest}):
            for sign in (-1.0, 1.0):
                axes.axhline(sign * limit, color="tab:red", ls=":", lw=0.8)
    axes.set_ylabel(label)
    axes.set_xlabel("time [ms]")
    axes.legend(fontsize="small")


def image_formats() -> tuple[str, ...]:
    """File name endings that `draw_plan` can write."""
    return tuple(sorted(FigureCanvasAgg.filetypes))


def draw_plan(run: Schedule, limits: Limits, title: str, path: Path) -> None:
    """Draw what is planned into an image file, the whole of a sequence; limits within three times the peaks are dotted lines.

    Raises:
        OSError: the file cannot be written.
        ValueError: the file name ends in no image format.
    """
    operations = run.planned
    samples = []
    for operation in operations:
        time = time_grid(operation.plan.dwell_ms + operation.plan.duration_ms, 0.25) - operation.plan.dwell_ms / 1000.0
        samples.append((operation.start_ms + 1e3 * time, operation.plan.sample(time)))
    ms, s = np.concatenate([time for time, _ in samples]), np.concatenate([setpoints for _, setpoints in samples])
    figure = Figure(figsize=(13, 12), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 2)
    if len(operations) == 1:
        _draw_path(axes[0, 0], operations[0].plan, s["tcp_position"], corner=False)
        _draw_path(axes[0, 1], operations[0].plan, s["tcp_position"], corner=True)
    else:
        _draw_from_above(axes[0, 0], operations)
        _draw_corners(axes[0, 1], operations)

    speed = axes[1, 0]
    speed.plot(ms, np.linalg.norm(s["tcp_velocity"], axis=1), color="black", label="path speed")
    for i, (axis, colour) in enumerate(zip("xyz", ("tab:blue", "tab:orange", "tab:green"), strict=True)):
        speed.plot(ms, s["tcp_velocity"][:, i], color=colour, lw=0.9, label=f"v{axis}")
    speed.set_ylabel("tcp velocity [m/s]")
    speed.set_xlabel("time [ms]")
    speed.legend(fontsize="small", ncols=2)

    _draw_joints(axes[1, 1], ms, np.degrees(s["joint_position"]), "joint position [deg]", None)
    rows = (("velocity", "rad/s"), ("acceleration", "rad/s2"), ("jerk", "rad/s3"), ("torque", "N m"))
    for axis, (quantity, unit) in zip(axes[2:].flat, rows, strict=True):
        name = f"joint_{quantity}"
        _draw_joints(axis, ms, s[name], f"joint {quantity} [{unit}]", getattr(limits, name))
    if len(operations) == 1:
        marks = [1e3 * phase.start for phase in operations[0].plan.phases]
    else:
        marks = [operation.start_ms for operation in operations]
    for row in (1, 2, 3):
        for column in (0, 1):
            for mark in marks:
                axes[row, column].axvline(mark, color="0.85", lw=0.8, zorder=0)
            axes[row, column].margins(x=0)
    figure.suptitle(f"{title}: {run.pass_ms:g} ms")
    figure.savefig(path, dpi=110)


def _draw_from_above(axes: Axes, operations: Sequence[Operation]) -> None:
    """Where parts are picked and placed, and the ways between [mm]."""
    for is_return, colour, style, label in ((False, "tab:blue", "-", "with a part"), (True, "0.6", ":", "return")):
        ends = [(o.plan.task.pick, o.plan.task.place) for o in operations if o.move.is_return == is_return]
        for k, (begin, end) in enumerate(ends):
            x, y = ([1e3 * begin[i], 1e3 * end[i]] for i in (0, 1))
            axes.plot(x, y, color=colour, ls=style, lw=0.9, label=label if k == 0 else None)
    parts = [o for o in operations if not o.move.is_return]
    for which, marker in (("pick", "o"), ("place", "s")):
        points = 1e3 * np.array([getattr(o.plan.task, which) for o in parts])
        axes.plot(points[:, 0], points[:, 1], marker, color="black", ms=3.5, label=which)
    axes.set_title("From above")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.legend(fontsize="small", ncols=2)


def _draw_corners(axes: Axes, operations: Sequence[Operation]) -> None:
    """All corners on top of each other, each in its own vertical plane and from its own vertex, inwards and down [mm]."""
    greatest = 1e3 * max(max(o.plan.task.corner_deviation) for o in operations)
    for operation in operations:
        plan = operation.plan
        position = plan.sample(plan.grid(0.25))["tcp_position"]
        for vertex, inwards in zip(plan.vertices, (1.0, -1.0), strict=True):
            along = inwards * (position[:, :2] - vertex[:2]) @ np.array(plan.direction)
            axes.plot(1e3 * along, 1e3 * (position[:, 2] - vertex[2]), color="tab:blue", lw=0.7)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    for prescribed in sorted({1e3 * d for o in operations for d in o.plan.task.corner_deviation}):
        label = f"prescribed {prescribed:g} mm"
        axes.plot(prescribed * np.cos(angle), prescribed * np.sin(angle), color="tab:red", lw=0.8, label=label)
    axes.set_xlim(-1.5 * greatest, 8.0 * greatest)
    axes.set_ylim(-8.0 * greatest, 1.5 * greatest)
    axes.set_aspect("equal")
    axes.set_title("All corners")
    axes.set_xlabel("from the vertex along the traverse [mm]")
    axes.set_ylabel("above the vertex [mm]")
    axes.legend(fontsize="small")
