"""`deltaph plan --plot`: path, tcp speed, and velocity, acceleration, jerk and torque of the joints against their limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deltaph.plan import Plan
from deltaph.scenario import Limits

_JOINT_STYLES = (("tab:blue", "-"), ("tab:orange", "-"), ("tab:green", (0, (4, 3))))
"""Joint 3 is dashed: joints 2 and 3 coincide on a move along x."""


def _draw_path(axes: Axes, plan: Plan, position: NDArray[np.float64], *, corner: bool) -> None:
    """The path in its vertical plane [mm]: all of it, or the first corner."""
    pick = np.array(plan.task.pick)
    across = np.array(plan.task.place)[:2] - pick[:2]
    width = float(np.linalg.norm(across))
    along = (position[:, :2] - pick[:2]) @ (across / width) * 1e3
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
        reach = min(8.0 * prescribed, 1e3 * plan.task.lift[0], 500.0 * width)
        axes.set_xlim(-1.5 * prescribed, reach)
        axes.set_ylim(vertex[2] - reach, vertex[2] + 1.5 * prescribed)
        axes.set_title(f"Pick corner: deviation {1e3 * plan.corner_deviation[0]:.4g} mm")
    else:
        axes.set_title("Path")
    axes.set_aspect("equal")
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


def draw_plan(plan: Plan, limits: Limits, title: str, path: Path) -> None:
    """Draw a plan into an image file; limits within three times the peaks are dotted lines.

    Raises:
        OSError: the file cannot be written.
        ValueError: the file name ends in no image format.
    """
    time = plan.grid(0.25)
    s = plan.sample(time)
    ms = 1e3 * time
    figure = Figure(figsize=(13, 12), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 2)
    _draw_path(axes[0, 0], plan, s["tcp_position"], corner=False)
    _draw_path(axes[0, 1], plan, s["tcp_position"], corner=True)

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
    for row in (1, 2, 3):
        for column in (0, 1):
            for phase in plan.phases:
                axes[row, column].axvline(1e3 * phase.start, color="0.85", lw=0.8, zorder=0)
            axes[row, column].margins(x=0)
    figure.suptitle(f"{title}: {1e3 * plan.duration:g} ms")
    figure.savefig(path, dpi=110)
