"""What a recording shows in space: the robot, the paths, the corners."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import rerun as rr

from deltaph.telemetry.messages import Records, layout
from deltaph.telemetry.scene import FloatArray, Scene
from deltaph.telemetry.signals import EXECUTED, LIMIT, PLANNED

EXECUTED_PATH = "world/path/executed"
CORNERS = ("pick", "place")

_METAL = (185, 190, 200)
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)


def _pixels(count: float) -> Any:
    """A line width that does not depend on the zoom."""
    return rr.components.Radius.ui_points(count)


def still_world(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Entities and archetypes of what does not move."""
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    shoulders = scene.base_points
    yield "world/robot/base", rr.LineStrips3D([np.vstack([shoulders, shoulders[:1]])], colors=[_METAL], radii=[0.006])
    yield "world/path/right_angle", rr.LineStrips3D([scene.right_angle_path], colors=[(110, 110, 110)], radii=[_pixels(1.0)])
    yield "world/path/planned", rr.LineStrips3D([scene.planned_path], colors=[PLANNED], radii=[_pixels(1.5)])
    up = np.array([0.0, 0.0, 1.0])
    for corner, vertex, deviation in zip(CORNERS, scene.vertices, scene.corner_deviation, strict=True):
        circle = vertex + deviation * (np.outer(np.cos(_CIRCLE), scene.across) + np.outer(np.sin(_CIRCLE), up))
        entity = f"world/corner/{corner}"
        yield f"{entity}/vertex", rr.Points3D([vertex], colors=[(255, 255, 255)], radii=[_pixels(3.0)])
        yield f"{entity}/circle", rr.LineStrips3D([circle], colors=[LIMIT], radii=[_pixels(1.5)])
        yield f"{entity}/ball", rr.Ellipsoids3D(centers=[vertex], radii=[deviation], colors=[(*LIMIT, 90)], fill_mode="solid")


class MovingWorld:
    """What moves: the robot as it is executed, and its trace.

    Args:
        scene: geometry and kinematics.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        radial = scene.base_points / np.linalg.norm(scene.base_points, axis=1, keepdims=True)
        sideways = np.cross([0.0, 0.0, 1.0], radial) * scene.rod_spacing
        self._rod_offsets = np.stack([sideways, -sideways], axis=1)  # (arm, rod, 3)

    def styles(self) -> Iterator[tuple[str, Any]]:
        """Colours and widths, which stay."""
        yield "world/robot/arms", rr.LineStrips3D.from_fields(colors=[_METAL], radii=[0.012])
        yield "world/robot/rods", rr.LineStrips3D.from_fields(colors=[_METAL], radii=[0.004])
        yield "world/robot/platform", rr.LineStrips3D.from_fields(colors=[_METAL], radii=[0.008])
        yield EXECUTED_PATH, rr.Points3D.from_fields(colors=[EXECUTED], radii=[_pixels(3.0)])

    def rows(self, actual: Records) -> Iterator[tuple[str, Any]]:
        """Entities and columns with one row per record; to be called in the order of time."""
        n = len(actual)
        tcp = layout("actual").values(actual, "tcp_position")
        elbows = self._scene.elbows(layout("actual").values(actual, "joint_position"))
        joints = tcp[:, None, :] + self._scene.platform_offsets
        shoulders = np.broadcast_to(self._scene.base_points, elbows.shape)

        arms = np.stack([shoulders, elbows], axis=2)
        yield "world/robot/arms", _strips(arms.reshape(n, 3, 2, 3))
        rods = np.stack([elbows, joints], axis=2)[:, :, None, :, :] + self._rod_offsets[:, :, None, :]
        yield "world/robot/rods", _strips(rods.reshape(n, 6, 2, 3))
        yield "world/robot/platform", _strips(np.concatenate([joints, joints[:, :1]], axis=1)[:, None])
        yield EXECUTED_PATH, rr.Points3D.columns(positions=tcp)


def _strips(points: FloatArray) -> Any:
    """Columns of line strips (n, strips, points, 3)."""
    n, count, *strip = points.shape
    strips: Any = points.reshape(n * count, *strip)
    return rr.LineStrips3D.columns(strips=strips).partition([count] * n)
