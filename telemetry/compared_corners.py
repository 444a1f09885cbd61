"""The corners of two motions, each seen from its own vertex, in millimetres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from deltaph.telemetry.corner import REACH, bounds, label, size
from deltaph.telemetry.side import Side
from deltaph.telemetry.signals import LIMIT
from deltaph.telemetry.world import CORNERS, pixels

_GREY = (130, 130, 130)
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)
_WIDTHS = {"a": 4.0, "b": 1.5}
"""Of the paths: A is broad, and seen on both sides of B where they are the same."""


def compared_corners(sides: tuple[Side, Side]) -> Iterator[tuple[str, Any]]:
    """Entities and archetypes: prescribed circles, right angles, all passes of both motions, and the worst distance in words."""
    for index, name in enumerate(CORNERS):
        entity, scale = f"corner/{name}", max(size(side.scene, index) for side in sides)
        moves = [move for side in sides for move in side.scene.moves]
        legs = [move.seen_from(index, move.right_angle_path[index : index + 3]) for move in moves]
        yield f"{entity}/right_angle", rr.LineStrips2D(legs, colors=[_GREY], radii=[pixels(0.75)], draw_order=1.0)
        radii = np.unique(np.concatenate([1e3 * side.scene.corner_deviation[:, index] for side in sides]))
        circles = [radius * np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)]) for radius in radii]
        yield f"{entity}/prescribed", rr.LineStrips2D(circles, colors=[LIMIT], radii=[pixels(1.25)], draw_order=2.0)
        words = " and ".join(f"{radius:g}" for radius in radii)
        yield f"{entity}/label/prescribed", label(index, scale, 0, f"prescribed {words} mm", LIMIT)
        for line, side in enumerate(sides, start=1):
            width, letter = _WIDTHS[side.letter], side.letter
            strips = list(_passes(side, index, scale))
            paths = rr.LineStrips2D(strips, colors=[side.color], radii=[pixels(width / 2.0)], draw_order=2.0 + line)
            yield f"{entity}/{letter}", paths
            for mark in (mark for mark in side.marks if mark.corner == index):
                move = side.scene.moves[mark.move]
                spoke = np.stack([np.zeros(2), move.seen_from(index, np.array(mark.nearest))])
                distance = rr.LineStrips2D([spoke], colors=[side.color], radii=[pixels(width / 4.0)], draw_order=2.5 + line)
                yield f"{entity}/nearest/{letter}", distance
                text = f"{letter.upper()} {1e3 * mark.executed:.3f} mm"
                yield f"{entity}/label/{letter}", label(index, scale, line, text, side.color)


def corner_view(sides: tuple[Side, Side], index: int) -> rrb.Spatial2DView:
    """The picture of a corner."""
    scale = max(size(side.scene, index) for side in sides)
    return rrb.Spatial2DView(
        origin=f"corner/{CORNERS[index]}",
        name=f"{CORNERS[index].capitalize()} corner, all passes [mm]: A broad, B thin",
        contents=["$origin/**"],
        visual_bounds=bounds(index, scale),
    )


def _passes(side: Side, index: int, scale: float) -> Iterator[NDArray[np.float64]]:
    """The motion where it is near a corner of the move that runs, one strip for each time."""
    times, positions = side.path()
    moves = side.scene.move_at(times)
    for number, move in enumerate(side.scene.moves):
        of_move = np.flatnonzero(moves == number)
        seen = move.seen_from(index, positions[of_move])
        near = np.flatnonzero(np.abs(seen).max(axis=1, initial=0.0) < 2.0 * REACH * scale)
        gaps = np.flatnonzero(np.diff(of_move[near]) > 1) + 1
        yield from (seen[part] for part in np.split(near, gaps) if len(part) > 1)
