"""What a recording shows that does not move, and that telemetry, which knows no kinematics, has to be given."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The static side of a recording, SI, base frame.

    Attributes:
        title: of the recording.
        law: name of the motion law.
        scenario_json: the scenario.
        right_angle_path: pick point, vertex above it, vertex above the place point, place point (4, 3) [m].
        corner_deviation: prescribed, at the two vertices (2,) [m].
        planned_path: points of the planned path (n, 3) [m].
        limits: `joint_velocity`, `joint_acceleration`, `joint_torque` or `tcp_speed` -> one value or one per joint, SI;
            infinite where there is none. Limits of what is not recorded are ignored.
        base_points: shoulders (3, 3) [m].
        platform_offsets: from the tool centre point to the forearms' joints on the platform (3, 3) [m].
        elbows: joint positions (n, 3) [rad] -> elbows (n, 3 arms, 3) [m].
        rod_spacing: half the distance between the two rods of a forearm, for the drawing [m].
    """

    title: str
    law: str
    scenario_json: str
    right_angle_path: FloatArray
    corner_deviation: FloatArray
    planned_path: FloatArray
    limits: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    base_points: FloatArray
    platform_offsets: FloatArray
    elbows: Callable[[FloatArray], FloatArray]
    rod_spacing: float = 0.03

    def __post_init__(self) -> None:
        shapes = {"right_angle_path": (4, 3), "corner_deviation": (2,), "base_points": (3, 3), "platform_offsets": (3, 3)}
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"{name} has the shape {np.shape(getattr(self, name))} instead of {shape}")
        if np.ndim(self.planned_path) != 2 or np.shape(self.planned_path)[1] != 3:
            raise ValueError(f"planned_path has the shape {np.shape(self.planned_path)} instead of (n, 3)")

    @property
    def vertices(self) -> FloatArray:
        """The vertices of the two corners (2, 3) [m]."""
        return np.asarray(self.right_angle_path, dtype=np.float64)[1:3]

    @property
    def across(self) -> FloatArray:
        """Horizontal direction from pick to place (3,), a unit vector."""
        direction = self.vertices[1] - self.vertices[0]
        direction[2] = 0.0
        unit: FloatArray = direction / np.linalg.norm(direction)
        return unit

    def vertex_distance(self, position: FloatArray) -> FloatArray:
        """Distance of positions (n, 3) [m] to the nearer vertex (n,) [m]."""
        distance: FloatArray = np.linalg.norm(position[:, None, :] - self.vertices, axis=2).min(axis=1)
        return distance
