"""The corners seen at right angles, in millimetres from their vertex: what is prescribed, planned and executed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from deltaph.telemetry.scene import CornerMark, FloatArray, Scene
from deltaph.telemetry.signals import CORNER, EXECUTED, LIMIT, PLANNED, PLOT, color_of_plan
from deltaph.telemetry.world import CORNERS, pixels

REACH = 4.5
"""Half the width of what is shown of a corner, in prescribed deviations."""

_GREY = (130, 130, 130)
_WHITE = (255, 255, 255)
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)


def size(scene: Scene, corner: int) -> float:
    """The deviation that sets the scale of a corner's picture [mm]; where none is prescribed there is nothing to see."""
    return max(1e3 * float(scene.corner_deviation[:, corner].max()), 1.0)


def executed_entity(corner: int) -> str:
    """Where the executed path is shown."""
    return f"corner/{CORNERS[corner]}/executed"


def still_corners(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Entities and archetypes of what is known before the run; all moves lie on top of each other."""
    for index, name in enumerate(CORNERS):
        entity = f"corner/{name}"
        moves = list(scene.moves)
        deviations = 1e3 * scene.corner_deviation[:, index]
        legs = [move.seen_from(index, move.right_angle_path[index : index + 3]) for move in moves]
        yield f"{entity}/right_angle", rr.LineStrips2D(legs, colors=[_GREY], radii=[pixels(0.75)], draw_order=1.0)
        yield f"{entity}/vertex", rr.Points2D([[0.0, 0.0]], colors=[_WHITE], radii=[pixels(3.0)], draw_order=6.0)
        circles = [d * np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)]) for d in np.unique(deviations)]
        yield f"{entity}/prescribed", rr.LineStrips2D(circles, colors=[LIMIT], radii=[pixels(1.25)], draw_order=2.0)
        planned = [move.seen_from(index, move.planned_path) for move in moves]
        yield f"{entity}/planned", rr.LineStrips2D(planned, colors=[PLANNED], radii=[pixels(2.25)], draw_order=3.0)
        corners = [move.seen_from(index, move.corner_paths[index]) for move in moves if move.corner_paths]
        if corners:
            yield f"{entity}/planned_corner", rr.LineStrips2D(corners, colors=[CORNER], radii=[pixels(2.25)], draw_order=3.5)
        yield executed_entity(index), rr.LineStrips2D.from_fields(colors=[EXECUTED], radii=[pixels(1.25)], draw_order=4.0)
        words = " to ".join(f"{d:g}" for d in np.unique(deviations)[[0, -1]][: len(np.unique(deviations))])
        yield f"{entity}/label/prescribed", _label(scene, index, 0, f"prescribed {words} mm", LIMIT)


def worst(scene: Scene, found: Sequence[CornerMark]) -> list[CornerMark]:
    """The worst of all passes on each side, pick side first."""
    of_side: dict[int, CornerMark] = {}
    for mark in found:
        if mark.corner not in of_side or excess(scene, mark) > excess(scene, of_side[mark.corner]):
            of_side[mark.corner] = mark
    return [mark for _, mark in sorted(of_side.items())]


def marks(scene: Scene, found: Sequence[CornerMark]) -> Iterator[tuple[str, Any]]:
    """Where the executed path comes closest to a vertex of each side, in the worst of all passes, and how close, in words."""
    plan_color = color_of_plan(scene)
    for corner in {0, 1} - {mark.corner for mark in found} if not scene.served else ():
        yield f"corner/{CORNERS[corner]}/label/executed", _label(scene, corner, 1, "not reached", EXECUTED)
    for mark in worst(scene, found):
        entity, move = f"corner/{CORNERS[mark.corner]}", scene.moves[mark.move]
        where = f", {scene.name_of(mark.move)}" if len(scene.moves) > 1 else ""
        nearest = move.seen_from(mark.corner, np.array(mark.nearest))
        distances = move.seen_from(mark.corner, move.planned_path)
        planned = distances[np.argmin(np.linalg.norm(distances, axis=1))]
        for name, point, distance, color, line in (
            ("planned", planned, mark.planned, plan_color, 1),
            ("executed", nearest, mark.executed, EXECUTED, 2),
        ):
            yield (
                f"{entity}/nearest/{name}",
                rr.Points2D([point], colors=[color], radii=[pixels(5.0 - line)], draw_order=5.0 + 0.1 * line),
            )
            text = f"{name} {1e3 * distance:.3f} mm{where}"
            yield f"{entity}/label/{name}", _label(scene, mark.corner, line, text, color)
        spokes = [[[0.0, 0.0], planned], [[0.0, 0.0], nearest]]
        yield (
            f"{entity}/nearest/distance",
            rr.LineStrips2D(spokes, colors=[plan_color, EXECUTED], radii=[pixels(0.5)], draw_order=4.5),
        )


def approaches(scene: Scene, found: Sequence[CornerMark]) -> Iterator[tuple[str, Any]]:
    """Of served moves: where the executed path came closest to its vertex in each pass. The path itself is not drawn here."""
    for corner, name in enumerate(CORNERS):
        of_side = [mark for mark in found if mark.corner == corner]
        if of_side:
            seen = [scene.moves[mark.move].seen_from(corner, np.array(mark.nearest)) for mark in of_side]
            yield f"corner/{name}/approaches", rr.Points2D(seen, colors=[EXECUTED], radii=[pixels(2.5)], draw_order=4.0)
            points = rr.Points3D([mark.nearest for mark in of_side], colors=[EXECUTED], radii=[pixels(2.5)])
            yield f"world/corner/{name}/approaches", points


def excess(scene: Scene, mark: CornerMark) -> float:
    """By how much the executed path of a pass is further away from the vertex than prescribed [m]."""
    return mark.executed - float(scene.moves[mark.move].corner_deviation[mark.corner])


PASSES = f"{PLOT}corner/deviation"
"""Where the deviation of each pass of a corner is."""

EXCESS = f"{PLOT}corner/excess"
"""Where it is counted from what is prescribed, which tells the margin of corners of any deviation."""


def passes(scene: Scene, found: Sequence[CornerMark]) -> Iterator[tuple[str, Any, FloatArray]]:
    """Entities, styles and values of the deviation at each corner in order of time [mm], and of its excess where that is shown."""
    prescribed = 1e3 * np.array([scene.moves[mark.move].corner_deviation[mark.corner] for mark in found])
    for name, values, color, size in (
        ("executed", 1e3 * np.array([mark.executed for mark in found]), EXECUTED, 5.0),  # seen as a rim where the next covers it
        ("planned", 1e3 * np.array([mark.planned for mark in found]), CORNER, 3.0),
        ("prescribed", prescribed, LIMIT, 1.5),
    ):
        style = partial(rr.SeriesPoints, colors=[color], marker_sizes=[size], markers=["circle"])
        yield f"{PASSES}/{name}", style(names=[f"corner deviation {name} [mm]"]), values
        if name != "prescribed":
            yield f"{EXCESS}/{name}", style(names=[f"corner deviation {name} - prescribed [mm]"]), values - prescribed


def allowed(scene: Scene) -> tuple[str, Any, FloatArray]:
    """Entity, style and values of the lines beside the excess [mm]: what is prescribed, and what is tolerated beyond it."""
    names = ["prescribed [mm]", "tolerance [mm]"][: 1 + (scene.tolerance > 0.0)]
    style = rr.SeriesLines(names=names, colors=[LIMIT] * len(names), widths=[1.5] * len(names))
    return f"{EXCESS}/limit", style, np.array([0.0, 1e3 * scene.tolerance][: len(names)])


def near(scene: Scene, corner: int, seen: FloatArray) -> bool:
    """Whether points (n, 2) [mm] reach into the picture of a corner."""
    return bool((np.abs(seen).max(axis=1) < 1.5 * REACH * size(scene, corner)).any())


def _label(scene: Scene, corner: int, line: int, text: str, color: tuple[int, int, int]) -> rr.Points2D:
    return label(corner, size(scene, corner), line, text, color)


def label(corner: int, scale: float, line: int, text: str, color: tuple[int, int, int]) -> rr.Points2D:
    """A line of text beyond the right angle, where no path comes; `scale` is that of the picture [mm]."""
    inwards = 1.0 if corner == 0 else -1.0
    at = [inwards * 2.3 * scale, (-2.0 + 0.55 * line) * scale]
    return rr.Points2D([at], colors=[color], radii=[pixels(0.0)], labels=[text], show_labels=True, draw_order=7.0)


def bounds(corner: int, scale: float) -> rrb.VisualBounds2D:
    """What is shown of a corner; `scale` is that of the picture [mm]."""
    reach = (-1.6 * scale, 4.4 * scale)
    return rrb.VisualBounds2D(x_range=reach if corner == 0 else (-reach[1], -reach[0]), y_range=(-2.2 * scale, 3.8 * scale))
