"""Shortest duration on a path under velocity and acceleration limits, by reachability analysis on a dense grid.

H. Pham and Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis", IEEE T-RO 34(3),
2018: with x = (ds/dt)^2 and u = d2s/dt2, q' u + q'' x is the acceleration of a joint; x at the end of an interval is x + 2 u ds.
A backward pass finds the greatest x from which the end is reached, a forward pass takes the greatest u that stays below it. Neither
code nor method of the product.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def _vertices(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Vertices (n, 2) of the polygon a u + b x <= c."""
    i, k = np.triu_indices(len(a), 1)
    det = a[i] * b[k] - a[k] * b[i]
    i, k, det = i[det != 0.0], k[det != 0.0], det[det != 0.0]
    points = np.stack([(c[i] * b[k] - c[k] * b[i]) / det, (a[i] * c[k] - a[k] * c[i]) / det], axis=1)
    slack = c - points[:, :1] * a - points[:, 1:] * b
    return points[(slack >= -1e-9 * (1.0 + np.abs(c))).all(axis=1)]


def shortest_duration(ds: float, first: FloatArray, second: FloatArray, velocity: float, acceleration: float) -> float:
    """From rest to rest [s].

    Args:
        ds: spacing of the grid [m].
        first: dq/ds (n, joints) [rad/m].
        second: d2q/ds2 (n, joints) [rad/m^2].
        velocity: limit of every joint [rad/s].
        acceleration: limit of every joint [rad/s^2].
    """
    n = len(first)
    greatest = (velocity / np.abs(first).max(axis=1)) ** 2
    greatest[-1] = 0.0
    for i in range(n - 2, -1, -1):
        a = np.concatenate([first[i], -first[i], [2.0 * ds, -2.0 * ds, 0.0, 0.0]])
        b = np.concatenate([second[i], -second[i], [1.0, -1.0, 1.0, -1.0]])
        c = np.concatenate([np.full(2 * first.shape[1], acceleration), [greatest[i + 1], 0.0, greatest[i], 0.0]])
        greatest[i] = _vertices(a, b, c)[:, 1].max()
    x = np.zeros(n)
    for i in range(n - 1):
        room = np.concatenate([acceleration - second[i] * x[i], acceleration + second[i] * x[i]])
        slope = np.concatenate([first[i], -first[i]])
        u = (room[slope > 0.0] / slope[slope > 0.0]).min()
        x[i + 1] = min(x[i] + 2.0 * ds * u, greatest[i + 1])
    speed = np.sqrt(x)
    return float((2.0 * ds / (speed[1:] + speed[:-1])).sum())
