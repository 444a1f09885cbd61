"""One of two recorded motions that are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.reading import Reading, Rows
from deltaph.telemetry.scene import CornerMark, FloatArray, Scene

COLORS = {"a": (90, 190, 255), "b": (255, 140, 40)}
"""Of lines, where a side has one each."""

_QUANTITIES = ("path/deviation", "joint/position", "joint/velocity", "joint/acceleration", "joint/torque", "tcp/speed")
_OF_PLANT = ("motor/torque",)
_SHOWN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "rad/s": ("deg/s", 180.0 / np.pi), "rad/s2": ("deg/s2", 180.0 / np.pi)}
"""Unit that is recorded -> unit and factor for people; others stay."""


@dataclass(frozen=True)
class Side:
    """One of the two motions.

    Attributes:
        letter: a or b.
        name: for legends.
        reading: where it is recorded.
        role: setpoint (planned) or actual (executed).
        scene: of its scenario.
        marks: the closest approach to each vertex, the worst of all passes.
    """

    letter: str
    name: str
    reading: Reading
    role: str
    scene: Scene
    marks: Sequence[CornerMark]

    @property
    def color(self) -> tuple[int, int, int]:
        """Of its lines where there is one each."""
        return COLORS[self.letter]

    def path(self) -> tuple[FloatArray, FloatArray]:
        """Times (n,) [s] and positions (n, 3) [m]."""
        rows = self.rows("tcp/position")
        time = np.asarray(1e-9 * rows.nanoseconds, dtype=np.float64)
        return time, rows.values

    @cached_property
    def arc_length(self) -> FloatArray:
        """Of the planned path at each frame, all operations one after the other (n,) [m].

        An executed motion is where its plan is at that moment: a robot that lags behind is late, not elsewhere.
        """
        travelled = self.rows("path/arc_length", "setpoint").values[:, 0]
        return np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(travelled), 0.0))])

    def rows(self, quantity: str, role: str | None = None) -> Rows:
        """A recorded quantity.

        Raises:
            EnvironmentProblem: it is not recorded.
        """
        entity = f"{quantity}/{role or self.role}"
        if entity not in self.reading.rows:
            raise EnvironmentProblem(f"{self.reading.path} has no {entity}: record the run again with this version")
        return self.reading.rows[entity]

    def shown(self, quantity: str) -> FloatArray:
        """Values of a quantity in the unit for people (n, series)."""
        factor: FloatArray = self.rows(quantity).values * self.unit(quantity)[1]
        return factor

    def unit(self, quantity: str) -> tuple[str, float]:
        """The unit for people of a quantity, and the factor to it."""
        recorded = self.reading.units.get(f"{quantity}/{self.role}", "")
        return _SHOWN.get(recorded, (recorded, 1.0))

    def quantities(self) -> list[str]:
        """What is compared of this motion."""
        return [*_QUANTITIES, *(_OF_PLANT if self.role == "actual" else ())]

    def on_path(self, points: FloatArray, values: FloatArray, times: NDArray[np.int64]) -> FloatArray:
        """Values (n, series) at times (n,) [ns], where the planned path has the arc lengths `points` (m,) [m]: (m, series)."""
        where = np.interp(times, self.rows("path/arc_length", "setpoint").nanoseconds, self.arc_length)
        moving = np.concatenate([[True], np.diff(where) > 0.0])  # where it rests, the moment of arrival counts
        return np.stack([np.interp(points, where[moving], column[moving]) for column in values.T], axis=1)
