"""Motion superposition, the paper's comparison method (eq. 31): two vertical strokes and a horizontal one.

Each stroke follows the quintic 10 t^3 - 15 t^4 + 6 t^5 of its own clamped time; the strokes overlap by a
fraction of the vertical stroke's duration.
"""

from dataclasses import dataclass
from itertools import pairwise

from .polynomial import Polynomial, derivative, evaluate, fit
from .ppo import Phase, Plan, heading
from .precision import Number, Vector, mp
from .taylor import Taylor

QUINTIC = fit([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 1), (1, 1, 0), (2, 1, 0)])


@dataclass(frozen=True)
class Stroke:
    """One quintic stroke: it starts at `start` [s], takes `duration` [s] and covers `height` [m] (signed)."""

    start: Number
    duration: Number
    height: Number
    law: Polynomial = QUINTIC

    @property
    def end(self) -> Number:
        """Time of the end [s]."""
        return self.start + self.duration

    def position(self, time: Taylor) -> Taylor:
        """Displacement [m] as a series of time, for times inside the stroke."""
        displacement: Taylor = evaluate(self.law, (time - self.start) / self.duration) * self.height
        return displacement


def stroke_duration(length: Number, speed: Number) -> Number:
    """Duration of a stroke [s] whose greatest speed is `speed` [m/s] (1.875 length / speed)."""
    slope = derivative(QUINTIC)
    curvature = derivative(slope)
    middle = mp.findroot(lambda t: evaluate(curvature, t), (mp.mpf("0.3"), mp.mpf("0.8")), solver="anderson")
    return length * evaluate(slope, middle) / speed


@dataclass(frozen=True)
class SuperposedLeg:
    """The motion between two starts or ends of strokes; the parameter is the fraction of that time."""

    across: tuple[Stroke, ...]  # strokes in motion during this leg
    up: tuple[Stroke, ...]
    offset: tuple[Number, Number]  # (horizontal, vertical) left by the strokes already ended [m]
    start: Number
    duration: Number

    def position(self, parameter: Number, order: int) -> tuple[Taylor, Taylor]:
        """(horizontal, vertical) [m] as series of time."""
        time = Taylor.constant(self.start + parameter * self.duration, order)
        if order:
            time.coefficients[1] = time.coefficients[1] + 1
        still = time * 0
        across = sum((stroke.position(time) for stroke in self.across), still)
        up = sum((stroke.position(time) for stroke in self.up), still)
        return across + self.offset[0], up + self.offset[1]

    def parameter_at(self, time: Number) -> Number:
        """Fraction of the leg's duration."""
        return time / self.duration

    def arc_length(self, parameter: Number) -> Number:
        """Path length [m] by quadrature of the speed."""

        def speed(fraction: Number) -> Number:
            across, up = self.position(fraction, 1)
            return mp.hypot(across.coefficients[1], up.coefficients[1])

        panels = [parameter * n / 8 for n in range(9)]
        return self.duration * mp.quad(speed, panels, method="gauss-legendre")


def strokes(
    width: Number, lifts: tuple[Number, Number], v_h: Number, v_w: Number, overlap: Number
) -> tuple[Stroke, Stroke, Stroke]:
    """(lift, traverse, lower); each vertical stroke overlaps the traverse by its own overlap fraction."""
    lift = Stroke(mp.mpf(0), stroke_duration(lifts[0], v_h), lifts[0])
    traverse = Stroke((1 - overlap) * lift.duration, stroke_duration(width, v_w), width)
    time = stroke_duration(lifts[1], v_h)
    return lift, traverse, Stroke(traverse.end - overlap * time, time, -lifts[1])


def corner_deviation(vertical: Stroke, traverse: Stroke, at_pick: bool) -> Number:
    """Smallest distance [m] from the vertex to the path, over the time the two strokes overlap (eq. 31).

    Outside the overlap the distance to the vertex is that of one moving coordinate, never smaller than at the
    overlap's ends.
    """
    if at_pick:
        a, b = traverse.start, vertical.end
    else:
        a, b = vertical.start, traverse.end

    def offsets(time: Number) -> tuple[Taylor, Taylor]:
        """(horizontal, vertical) offset from the vertex."""
        series = Taylor([time, mp.mpf(1)])
        across, up = traverse.position(series), vertical.position(series)
        return (across, up - vertical.height) if at_pick else (across - traverse.height, up)

    def slope(time: Number) -> Number:
        """Half the time derivative of the squared distance."""
        across, up = offsets(time)
        return (across * across + up * up).coefficients[1] / 2

    # One sign change: the vertical offset shrinks and the horizontal one grows (or the reverse).
    tolerance = mp.mpf(10) ** (-2 * mp.dps)
    time = mp.findroot(slope, (a, b), solver="illinois", tol=tolerance, maxsteps=200, verify=False)
    across, up = offsets(time)
    return mp.hypot(across.coefficients[0], up.coefficients[0])


def superposition_plan(
    pick: Vector, place: Vector, lifts: tuple[Number, Number], v_h: Number, v_w: Number, overlap: Number
) -> Plan:
    """The comparison PPO.

    Args:
        pick: pick position (3) [m].
        place: place position (3) [m].
        lifts: lift heights (pick, place) [m]; pick.z + lifts[0] == place.z + lifts[1].
        v_h: greatest vertical speed [m/s].
        v_w: greatest horizontal speed [m/s].
        overlap: fraction of each vertical stroke's duration that overlaps the traverse, in [0, 1].
    """
    along, width = heading(pick, place)
    lift, traverse, lower = strokes(width, lifts, v_h, v_w, overlap)
    instants = sorted({time for s in (lift, traverse, lower) for time in (s.start, s.end)})
    phases = []
    for a, b in pairwise(instants):
        middle = (a + b) / 2

        def moving(candidates: tuple[Stroke, ...], middle: Number = middle) -> tuple[Stroke, ...]:
            return tuple(s for s in candidates if s.start < middle < s.end)

        def ended(candidates: tuple[Stroke, ...], middle: Number = middle) -> Number:
            return mp.fsum(s.height for s in candidates if s.end < middle)

        offset = (ended((traverse,)), ended((lift, lower)))
        leg = SuperposedLeg(moving((traverse,)), moving((lift, lower)), offset, a, b - a)
        phases.append(Phase("superposed", leg, pick, along))
    durations = {"lift": lift.duration, "traverse": traverse.duration, "lower": lower.duration}
    deviations = (corner_deviation(lift, traverse, True), corner_deviation(lower, traverse, False))
    return Plan(tuple(phases), durations, deviations, {})


def overlap_with_deviation(
    deviation: Number,
    width: Number,
    lift: Number,
    v_h: Number,
    v_w: Number,
) -> Number:
    """The overlap fraction at which the pick corner's deviation is the given one [m]."""

    def excess(overlap: Number) -> Number:
        up, across, _ = strokes(width, (lift, lift), v_h, v_w, overlap)
        return corner_deviation(up, across, True) - deviation

    return mp.findroot(excess, (mp.mpf("0.3"), mp.mpf("0.9")), solver="anderson", tol=mp.mpf(10) ** (-80))
