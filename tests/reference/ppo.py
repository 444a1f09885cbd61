"""A pick-and-place operation (PPO): legs placed in the vertical plane of the task, on the aligned clock."""

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from .precision import Number, Vector, mp
from .taylor import Taylor

GRID = mp.mpf("0.001")  # communication step [s]: a PPO takes a whole number of them


class Leg(Protocol):
    """A stretch of planar motion (horizontal, vertical) over a parameter in [0, 1]."""

    @property
    def duration(self) -> Number:
        """Nominal duration [s]."""

    def position(self, parameter: Number, order: int) -> tuple[Taylor, Taylor]:
        """(horizontal, vertical) [m] as series of nominal time about the parameter."""

    def parameter_at(self, time: Number) -> Number:
        """Parameter at the nominal time [s] since the start of the leg."""

    def arc_length(self, parameter: Number) -> Number:
        """Path length [m] from the start of the leg."""


@dataclass(frozen=True)
class Phase:
    """A leg placed in space.

    Attributes:
        name: the phase's name.
        leg: the planar motion.
        origin: pick or place position (3) [m]: zero of the leg's frame.
        heading: horizontal unit vector (3) from this origin towards the other end of the traverse.
        reversed_time: whether the leg is run backwards (the place side mirrors the pick side).
    """

    name: str
    leg: Leg
    origin: Vector
    heading: Vector
    reversed_time: bool = False

    def position(self, parameter: Number, order: int) -> tuple[Taylor, Taylor, Taylor]:
        """Tcp position [m] as series of nominal time about the phase's own parameter in [0, 1]."""
        across, up = self.leg.position(1 - parameter if self.reversed_time else parameter, order)
        if self.reversed_time:
            across, up = across.at_rate(-1), up.at_rate(-1)
        x, y, z = self.origin
        return across * self.heading[0] + x, across * self.heading[1] + y, up + z

    def parameter_at(self, time: Number) -> Number:
        """Parameter at the nominal time [s] since the start of the phase."""
        if self.reversed_time:
            return 1 - self.leg.parameter_at(self.leg.duration - time)
        return self.leg.parameter_at(time)

    def arc_length(self, parameter: Number) -> Number:
        """Path length [m] from the start of the phase."""
        if self.reversed_time:
            return self.leg.arc_length(mp.mpf(1)) - self.leg.arc_length(1 - parameter)
        return self.leg.arc_length(parameter)


@dataclass(frozen=True)
class Plan:
    """A whole PPO.

    Attributes:
        phases: phases in order of time.
        durations: the law's own nominal durations [s] by name (they may overlap).
        corner_deviations: (pick, place) smallest distance from the vertex to the path [m].
        lengths: further lengths [m] by name.
    """

    phases: tuple[Phase, ...]
    durations: Mapping[str, Number]
    corner_deviations: tuple[Number, Number]
    lengths: Mapping[str, Number]

    @cached_property
    def starts(self) -> tuple[Number, ...]:
        """Nominal start of each phase, and the end of the last [s]."""
        times = [mp.mpf(0)]
        for phase in self.phases:
            times.append(times[-1] + phase.leg.duration)
        return tuple(times)

    @cached_property
    def path_length(self) -> Number:
        """Length of the whole path [m]."""
        return mp.fsum(phase.arc_length(mp.mpf(1)) for phase in self.phases)

    @property
    def nominal_duration(self) -> Number:
        """Duration before alignment [s]."""
        return self.starts[-1]

    @property
    def aligned_duration(self) -> Number:
        """Nominal duration rounded up to the grid [s]; the slack keeps an exact multiple where it is."""
        return mp.ceil(self.nominal_duration / GRID - mp.mpf("1e-20")) * GRID

    @property
    def speed_factor(self) -> Number:
        """Speed factor c = nominal / aligned duration; nominal time = c * aligned time."""
        return self.nominal_duration / self.aligned_duration

    def locate(self, time: Number) -> tuple[int, Number]:
        """(index of the phase, parameter in it) at the aligned time [s]."""
        nominal = self.speed_factor * time
        index = min(bisect_right(self.starts, nominal), len(self.phases)) - 1
        return index, self.phases[index].parameter_at(nominal - self.starts[index])

    def arc_length(self, index: int, parameter: Number) -> Number:
        """Path length [m] from the pick position to a parameter of phase `index`."""
        before = mp.fsum(phase.arc_length(mp.mpf(1)) for phase in self.phases[:index])
        return before + self.phases[index].arc_length(parameter)


def heading(pick: Vector, place: Vector) -> tuple[Vector, Number]:
    """Horizontal unit vector (3) from pick to place, and the traverse width w [m]."""
    dx, dy = place[0] - pick[0], place[1] - pick[1]
    width = mp.hypot(dx, dy)
    return (dx / width, dy / width, mp.mpf(0)), width


def opposite(direction: Vector) -> Vector:
    """The reversed vector (3)."""
    return (-direction[0], -direction[1], -direction[2])
