"""Joint motion by other routes than the kernel's: inverse kinematics by an arc cosine, derivatives by differences."""

import numpy as np
from numpy.typing import NDArray

from deltaph.plan import Plan
from deltaph.scenario import Limits

FloatArray = NDArray[np.float64]
BASE, PLATFORM, UPPER, FOREARM = 0.2, 0.045, 0.35, 0.8


def joint_angles(points: FloatArray) -> FloatArray:
    """Angles (n, 3) [rad] of the default robot at points (n, 3) [m].

    |s|^2 = l^2 reads E sin + F cos + G = 0, or hypot(E, F) cos(theta - phi) = G with phi the direction of (-F, -E).
    """
    angles = []
    for turn in np.radians([0.0, 120.0, 240.0]):
        x = points[:, 0] * np.cos(turn) + points[:, 1] * np.sin(turn) + PLATFORM - BASE
        y = points[:, 1] * np.cos(turn) - points[:, 0] * np.sin(turn)
        z = points[:, 2]
        E, F = 2.0 * UPPER * z, -2.0 * UPPER * x
        G = x**2 + y**2 + z**2 + UPPER**2 - FOREARM**2
        angles.append(np.arctan2(-E, -F) - np.arccos(G / np.hypot(E, F)))
    return np.stack(angles, axis=1)


def differences(plan: Plan, step: float = 2e-5) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint velocity, acceleration and jerk on the aligned clock, as differences over `step` [s]: means, never above the peaks."""
    count = int(plan.duration / step)
    theta = joint_angles(plan.sample(np.arange(count + 1) * step)["tcp_position"])
    velocity = np.diff(theta, axis=0) / step
    return velocity, np.diff(velocity, axis=0) / step, np.diff(theta, n=3, axis=0) / step**3


def ratios(plan: Plan, limits: Limits) -> tuple[float, float, float]:
    """Greatest velocity, acceleration and jerk by differences over their limits, on the nominal clock."""
    bounds = (limits.joint_velocity, limits.joint_acceleration, limits.joint_jerk)
    return tuple(
        float((np.abs(values).max(axis=0) / np.array(bound)).max() / plan.speed_factor**order)
        for order, (values, bound) in enumerate(zip(differences(plan), bounds, strict=True), 1)
    )
