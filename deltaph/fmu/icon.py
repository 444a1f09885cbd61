"""The icons of the FMUs, drawn: the rounded path of the planner, the robot of the plant."""

from __future__ import annotations

import struct
import zlib
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deltaph.variables import Model

SIZE = 200
"""Width and height [pixels]."""

_INK, _ACCENT, _PALE = (38, 50, 56), (230, 81, 0), (176, 190, 197)
_ARC = tuple((70 - 30 * np.cos(t), 90 - 30 * np.sin(t)) for t in np.linspace(0.0, np.pi / 2, 12))

# Polylines in pixels from the top left: points, width, colour.
_STROKES: dict[Model, list[tuple[list[tuple[float, float]], float, tuple[int, int, int]]]] = {
    "planner": [
        ([(40, 150), (40, 60), (160, 60), (160, 150)], 3, _PALE),
        ([(40, 150), *_ARC, *((200 - x, y) for x, y in reversed(_ARC)), (160, 150)], 9, _ACCENT),
        ([(25, 155), (55, 155)], 7, _INK),
        ([(145, 155), (175, 155)], 7, _INK),
    ],
    "plant": [
        ([(60, 40), (140, 40)], 13, _INK),
        ([(66, 40), (25, 70), (84, 150)], 7, _INK),
        ([(134, 40), (175, 70), (116, 150)], 7, _INK),
        ([(100, 40), (100, 85), (100, 150)], 5, _PALE),
        ([(82, 152), (118, 152)], 9, _ACCENT),
        ([(100, 152), (100, 178)], 5, _ACCENT),
    ],
}


def _coverage(start: tuple[float, float], end: tuple[float, float], width: float) -> NDArray[np.float64]:
    """How much of each pixel a straight stroke with round ends covers (SIZE, SIZE)."""
    y, x = np.mgrid[0:SIZE, 0:SIZE] + 0.5
    dx, dy = end[0] - start[0], end[1] - start[1]
    along = np.clip(((x - start[0]) * dx + (y - start[1]) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
    distance = np.hypot(x - start[0] - along * dx, y - start[1] - along * dy)
    covered: NDArray[np.float64] = np.clip(0.5 + width / 2 - distance, 0.0, 1.0)
    return covered


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def icon(model: Model) -> bytes:
    """A PNG image (ISO/IEC 15948): 8 bits of red, green and blue per pixel, on white."""
    image = np.full((SIZE, SIZE, 3), 255.0)
    for points, width, colour in _STROKES[model]:
        covered = np.max([_coverage(*ends, width) for ends in pairwise(points)], axis=0)[..., None]
        image += covered * (np.array(colour) - image)
    rows = np.hstack([np.zeros((SIZE, 1), np.uint8), np.round(image).astype(np.uint8).reshape(SIZE, -1)])  # 0: no filter
    header = struct.pack(">IIBBBBB", SIZE, SIZE, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)) + _chunk(b"IEND", b"")
