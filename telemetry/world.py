"""What a recording shows in space: the robot, the paths, the corners."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import rerun as rr

from deltaph.telemetry.messages import Records, layout
from deltaph.telemetry.scene import UP, FloatArray, Scene
from deltaph.telemetry.signals import CORNER, EXECUTED, LIMIT, PLANNED

EXECUTED_PATH = "world/path/executed"
COMMANDED_PATH = "world/path/commanded"
"""The setpoints' path, of served moves: what is planned is drawn where it is known before."""
ARROWS = "world/arrows"
CORNERS = ("pick", "place")

POSE_STEPS = 10
"""Communication steps from one pose of the robot to the next: 100 pictures a second at 1 ms."""

TRACE_STEPS = 50
"""Communication steps in one piece of the executed path, which has a point for each: rows cost more than points."""

_METAL = (185, 190, 200)
_DARK_METAL = (95, 100, 110)
_SURFACE = (45, 50, 58)
_LOAD = (200, 160, 90)
_GREY = (130, 130, 130)
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)

_SPEED_SCALE = 0.05
"""Length of the velocity arrow [m] per speed [m/s]."""

_FORCE_SCALE = 1e-3
"""Length of the force arrows [m] per force [N]."""

_LOAD_DENSITY = 1000.0
"""Of the cube that stands for the payload [kg/m3]."""


def pixels(count: float) -> Any:
    """A line width that does not depend on the zoom."""
    return rr.components.Radius.ui_points(count)


def still_world(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Entities and archetypes of what does not move."""
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    radius = float(np.linalg.norm(scene.base_points, axis=1).max())
    yield "world/robot/base", rr.Cylinders3D(lengths=[0.03], radii=[radius], colors=[_DARK_METAL], fill_mode="solid")
    ends = np.concatenate([move.right_angle_path[[0, 3]] for move in scene.moves])
    low, high = ends.min(axis=0), ends.max(axis=0)
    middle = 0.5 * (low + high)
    # the tool centre point picks the payload at its top: the surface is below the greatest one
    top = low[2] - max(_load_size(mass) for _, mass in scene.payload) - 0.002
    half = 0.5 * (high - low) + 0.12
    yield (
        "world/surface",
        rr.Boxes3D(
            centers=[[middle[0], middle[1], top - 0.005]],
            half_sizes=[[half[0], half[1], 0.005]],
            colors=[_SURFACE],
            fill_mode="solid",
        ),
    )


def still_moves(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Entities and archetypes of the moves: their paths, their ends and what is prescribed at their corners."""
    right_angles = [move.right_angle_path for move in scene.moves]
    yield "world/path/right_angle", rr.LineStrips3D(right_angles, colors=[_GREY], radii=[pixels(1.0)])
    yield "world/path/planned", rr.LineStrips3D([move.planned_path for move in scene.moves], colors=[PLANNED], radii=[pixels(3.0)])
    corners = [points for move in scene.moves for points in move.corner_paths]
    if corners:
        yield "world/path/corners", rr.LineStrips3D(corners, colors=[CORNER], radii=[pixels(3.5)])
    for index, name in enumerate(("pick", "place")):
        points = np.unique([move.right_angle_path[3 * index] for move in scene.moves], axis=0)
        labels = [name] if len(scene.moves) == 1 else None
        yield f"world/task/{name}", rr.Points3D(points, colors=[(255, 255, 255)], radii=[pixels(4.0)], labels=labels)
    for index, corner in enumerate(CORNERS):
        vertices = [move.vertices[index] for move in scene.moves]
        radii = [float(move.corner_deviation[index]) for move in scene.moves]
        circles = [
            vertex + deviation * (np.outer(np.cos(_CIRCLE), move.across) + np.outer(np.sin(_CIRCLE), UP))
            for move, vertex, deviation in zip(scene.moves, vertices, radii, strict=True)
        ]
        entity = f"world/corner/{corner}"
        yield f"{entity}/vertex", rr.Points3D(vertices, colors=[(255, 255, 255)], radii=[pixels(2.0)])
        yield f"{entity}/circle", rr.LineStrips3D(circles, colors=[LIMIT], radii=[pixels(1.0)])
        yield f"{entity}/ball", rr.Ellipsoids3D(centers=vertices, radii=radii, colors=[(*LIMIT, 90)], fill_mode="solid")


class MovingWorld:
    """What moves: the robot as it is executed, and its trace. A row per POSE_STEPS, whichever way the records come.

    Attributes:
        ended: when moves that repeat have come to their end [s].

    Args:
        scene: geometry and kinematics.
    """

    def __init__(self, scene: Scene) -> None:
        self.ended = np.inf
        self._scene = scene
        radial = scene.base_points / np.linalg.norm(scene.base_points, axis=1, keepdims=True)
        sideways = np.cross(UP, radial) * scene.rod_spacing
        self._rod_offsets = np.stack([sideways, -sideways], axis=1)  # (arm, rod, 3)

    def styles(self) -> Iterator[tuple[str, Any]]:
        """Colours and widths, which stay."""
        radius = float(np.linalg.norm(self._scene.platform_offsets, axis=1).max())
        yield "world/robot/arms", rr.Capsules3D.from_fields(radii=[0.018] * 3, colors=[_METAL] * 3, fill_mode="solid")
        yield "world/robot/rods", rr.Capsules3D.from_fields(radii=[0.006] * 6, colors=[_METAL] * 6, fill_mode="solid")
        yield (
            "world/robot/platform",
            rr.Cylinders3D.from_fields(lengths=[0.012], radii=[radius], colors=[_DARK_METAL], fill_mode="solid"),
        )
        if self._carries:
            yield "world/robot/payload", rr.Boxes3D.from_fields(colors=[_LOAD], fill_mode="solid")
        yield EXECUTED_PATH, rr.LineStrips3D.from_fields(colors=[EXECUTED], radii=[pixels(2.0)])
        if self._scene.served:
            yield COMMANDED_PATH, rr.LineStrips3D.from_fields(colors=[PLANNED], radii=[pixels(3.0)])
        yield f"{ARROWS}/velocity", rr.Arrows3D.from_fields(colors=[EXECUTED], radii=[0.004])
        yield f"{ARROWS}/rod_force", rr.Arrows3D.from_fields(colors=[LIMIT] * 3, radii=[0.004] * 3)

    @property
    def _carries(self) -> bool:
        return any(mass > 0.0 for _, mass in self._scene.payload)

    def rows(self, poses: Records) -> Iterator[tuple[str, Any]]:
        """Entities and columns with one row per pose."""
        tcp = layout("actual").values(poses, "tcp_position")
        elbows = self._scene.elbows(layout("actual").values(poses, "joint_position"))
        joints = tcp[:, None, :] + self._scene.platform_offsets
        yield "world/robot/arms", _capsules(elbows, np.broadcast_to(self._scene.base_points, elbows.shape))
        below = (joints[:, :, None, :] + self._rod_offsets).reshape(len(poses), 6, 3)
        above = (elbows[:, :, None, :] + self._rod_offsets).reshape(len(poses), 6, 3)
        yield "world/robot/rods", _capsules(below, above)
        yield "world/robot/platform", rr.Cylinders3D.columns(centers=tcp)
        if self._carries:
            carried = np.where(poses["time"] < self.ended, self._scene.carried(poses["time"]), self._scene.payload[-1][1])
            half = 0.5 * np.array([_load_size(mass) for mass in carried])
            yield (
                "world/robot/payload",
                rr.Boxes3D.columns(half_sizes=np.repeat(half[:, None], 3, axis=1), centers=tcp - half[:, None] * UP),
            )
        velocity = _SPEED_SCALE * layout("actual").values(poses, "tcp_velocity")
        yield f"{ARROWS}/velocity", rr.Arrows3D.columns(vectors=velocity, origins=tcp)
        along = elbows - joints
        along /= np.linalg.norm(along, axis=2, keepdims=True)
        force = _FORCE_SCALE * layout("actual").values(poses, "rod_force")[:, :, None] * along
        threes = [3] * len(poses)
        yield (
            f"{ARROWS}/rod_force",
            rr.Arrows3D.columns(vectors=force.reshape(-1, 3), origins=joints.reshape(-1, 3)).partition(threes),
        )


def trace(pieces: list[FloatArray]) -> Any:
    """Columns of the executed path: one strip (n, 3) [m] per row."""
    return rr.LineStrips3D.columns(strips=pieces)


def _load_size(mass: float) -> float:
    """Edge of the cube that stands for a payload [m]."""
    return float(np.cbrt(mass / _LOAD_DENSITY))


def _capsules(start: FloatArray, end: FloatArray) -> Any:
    """Columns of capsules between points (n, count, 3); a capsule lies along its own z axis."""
    n, count, _ = start.shape
    along = (end - start).reshape(-1, 3)
    length = np.linalg.norm(along, axis=1)
    x, y, z = (along / length[:, None]).T
    # The shortest rotation of z onto (x, y, z); straight down any half turn about a horizontal axis does.
    turned = np.stack([-y, x, np.zeros_like(x), 1.0 + z], axis=1)
    turned[z < -1.0 + 1e-12] = [1.0, 0.0, 0.0, 0.0]
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    columns: Any = rr.Capsules3D.columns(lengths=length, translations=start.reshape(-1, 3), quaternions=turned)
    return columns.partition([count] * n)
