"""Seeded random tasks in the workspace of the default robot, and limits for them."""

import math
from collections.abc import Iterator

import numpy as np

from deltaph.scenario import Law, Limits, Task

LEG_PER_DEVIATION = 272 / (45 + math.sqrt(2))  # eq. (13) of the paper

TIME_OPTIMAL = Law("time_optimal", 1.2, 0.8, 2.4, 0.5)


def limits_of(velocity: float, acceleration: float, jerk: float, torque: float = math.inf, tcp_speed: float = math.inf) -> Limits:
    """The same limits for all joints."""
    return Limits((velocity,) * 3, (acceleration,) * 3, (jerk,) * 3, (torque,) * 3, tcp_speed)


PAPERS_PEAKS = limits_of(4.4227, 241.365, 29965.0)
"""The peaks of the paper's case, greatest of the three joints."""


def random_tasks(count: int, seed: int = 1) -> Iterator[Task]:
    """Both ends uniform in a disc of 0.35 m, at least 50 mm apart, in any direction, and at different heights.

    Either side has its own lift, 20 to 80 mm, and its own deviation, 1 to 8 mm as far as it fits.
    """
    random = np.random.default_rng(seed)
    while count > 0:
        angle, radius = random.uniform(0.0, 2.0 * np.pi, 2), 0.35 * np.sqrt(random.uniform(0.0, 1.0, 2))
        x, y = (radius * np.cos(angle)).tolist(), (radius * np.sin(angle)).tolist()
        width = math.dist((x[0], y[0]), (x[1], y[1]))
        if width < 0.05:
            continue
        count -= 1
        lift = tuple(random.uniform(0.02, 0.08, 2).tolist())
        top = float(random.uniform(-0.85 + max(lift), -0.65))
        deviation = tuple(
            min(wanted, 0.98 * height / LEG_PER_DEVIATION, 0.49 * width / LEG_PER_DEVIATION)
            for wanted, height in zip(random.uniform(0.001, 0.008, 2).tolist(), lift, strict=True)
        )
        yield Task((x[0], y[0], top - lift[0]), (x[1], y[1], top - lift[1]), lift, deviation)
