"""The paper's PPO (section 3.2): lift, pick corner, accelerate, decelerate, place corner, lower.

Every velocity law is fitted to its boundary conditions, every duration follows from its definition.
The place side is the pick side's construction on its own lift and deviation, run backwards.
"""

from dataclasses import dataclass
from itertools import pairwise

from .corner import Corner, corner_with_deviation
from .polynomial import Polynomial, antiderivative, evaluate, fit, scaled
from .ppo import Leg, Phase, Plan, heading, opposite
from .precision import Number, Vector, mp
from .taylor import Taylor

Planar = tuple[Number, Number]  # (horizontal, vertical)

# Panels that narrow towards gamma = 1/2: for small V_N the integrand sigma / v2 peaks there.
_HALF = mp.mpf(1) / 2
_STEPS = tuple(_HALF ** (n + 1) for n in range(14))
PANELS: Polynomial = (*(_HALF - s for s in _STEPS), _HALF, *(_HALF + s for s in reversed(_STEPS)))


@dataclass(frozen=True)
class StraightLeg:
    """A straight stretch from `start` along `direction`.

    The speed is a polynomial of Phi = t/T [m/s]; the parameter is Phi.
    """

    start: Planar
    direction: Planar
    duration: Number
    distance: Polynomial  # path length over Phi [m]

    def position(self, parameter: Number, order: int) -> tuple[Taylor, Taylor]:
        """(horizontal, vertical) [m] as series of nominal time."""
        phi = Taylor.constant(parameter, order)
        if order:
            phi.coefficients[1] = phi.coefficients[1] + 1 / self.duration
        s = evaluate(self.distance, phi)
        return s * self.direction[0] + self.start[0], s * self.direction[1] + self.start[1]

    def parameter_at(self, time: Number) -> Number:
        """Phi = t / T."""
        return time / self.duration

    def arc_length(self, parameter: Number) -> Number:
        """Path length [m] from the start."""
        return evaluate(self.distance, parameter)


@dataclass(frozen=True)
class CornerLeg:
    """The PH corner run at v2(gamma) [m/s] (eq. 16) from height `below` [m]; the parameter is gamma."""

    corner: Corner
    below: Number
    speed: Polynomial
    panel_times: tuple[Number, ...]  # time from gamma = 0 to each panel boundary [s]

    @property
    def duration(self) -> Number:
        """T2 = integral of sigma / v2 [s] (eq. 28, its definition)."""
        return self.panel_times[-1]

    def position(self, parameter: Number, order: int) -> tuple[Taylor, Taylor]:
        """(horizontal, vertical) [m]; gamma(t) is the series solution of gamma' = v2 / sigma (eq. 17)."""
        gamma = Taylor.constant(parameter, order)
        for n in range(order):
            rate = evaluate(self.speed, gamma) / self.corner.parametric_speed(gamma)
            gamma.coefficients[n + 1] = rate.coefficients[n] / (n + 1)
        return evaluate(self.corner.x, gamma), evaluate(self.corner.y, gamma) + self.below

    def parameter_at(self, time: Number) -> Number:
        """Parameter gamma with integral of sigma / v2 from 0 to gamma equal to the time (eq. 20)."""
        panel = max(i for i, t in enumerate(self.panel_times[:-1]) if t <= time)
        rest = time - self.panel_times[panel]
        return mp.findroot(
            lambda g: _travel_time(self.corner, self.speed, PANELS[panel], g) - rest,
            (PANELS[panel], PANELS[panel + 1]),
            solver="anderson",
            tol=(self.duration * mp.mpf(10) ** (5 - mp.dps)) ** 2,
        )

    def arc_length(self, parameter: Number) -> Number:
        """Path length [m] from B."""
        return self.corner.arc_length(parameter)


def _travel_time(corner: Corner, speed: Polynomial, a: Number, b: Number) -> Number:
    def slowness(gamma: Number) -> Number:
        return corner.parametric_speed(gamma) / evaluate(speed, gamma)

    return mp.quad(slowness, [a, b], method="gauss-legendre")


def straight_leg(start: Planar, direction: Planar, length: Number, speed: Polynomial) -> StraightLeg:
    """The leg of the given length [m]; its duration T follows from T * integral of v dPhi = length."""
    unit = antiderivative(speed)
    duration = mp.findroot(lambda t: t * evaluate(unit, mp.mpf(1)) - length, length / max(speed))
    return StraightLeg(start, direction, duration, scaled(unit, duration))


def corner_leg(corner: Corner, below: Number, v_b: Number, v_n: Number) -> CornerLeg:
    """The corner leg with V_B at both ends and V_N at gamma = 1/2 (eq. 16: a quartic, even about 1/2)."""
    speed = fit([(0, 0, v_b), (1, 0, 0), (0, _HALF, v_n), (0, 1, v_b), (1, 1, 0)])
    times = [mp.mpf(0)]
    for a, b in pairwise(PANELS):
        times.append(times[-1] + _travel_time(corner, speed, a, b))
    return CornerLeg(corner, below, speed, tuple(times))


def paper_plan(
    pick: Vector,
    place: Vector,
    lifts: tuple[Number, Number],
    deviations: tuple[Number, Number],
    v_b: Number,
    v_n: Number,
    v_max: Number,
) -> Plan:
    """The paper's PPO between any two positions whose lifted heights agree.

    Args:
        pick: pick position (3) [m].
        place: place position (3) [m].
        lifts: lift heights (pick, place) [m]; pick.z + lifts[0] == place.z + lifts[1].
        deviations: corner deviations (pick, place) [m].
        v_b: V_B, speed at the ends of the corners [m/s].
        v_n: V_N, speed at the middle of the corners [m/s].
        v_max: V_max, speed at the middle of the traverse [m/s].
    """
    along, width = heading(pick, place)
    lift_speed = fit([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, v_b), (1, 1, 0), (2, 1, 0)])  # eq. 14
    traverse_speed = fit([(0, 0, v_b), (1, 0, 0), (0, 1, v_max), (1, 1, 0)])  # eq. 29
    corners = tuple(corner_with_deviation(d) for d in deviations)
    half = (width - corners[0].leg - corners[1].leg) / 2
    ends = (
        (pick, along, False, ("lift", "pick_corner", "accelerate")),
        (place, opposite(along), True, ("lower", "place_corner", "decelerate")),
    )
    sides = []
    for lift, corner, (origin, direction, back, names) in zip(lifts, corners, ends, strict=True):
        rise = lift - corner.leg
        legs: tuple[Leg, Leg, Leg] = (
            straight_leg((mp.mpf(0), mp.mpf(0)), (mp.mpf(0), mp.mpf(1)), rise, lift_speed),
            corner_leg(corner, rise, v_b, v_n),
            straight_leg((corner.leg, lift), (mp.mpf(1), mp.mpf(0)), half, traverse_speed),
        )
        named = zip(names, legs, strict=True)
        sides.append([Phase(name, leg, origin, direction, back) for name, leg in named])
    phases = (*sides[0], *reversed(sides[1]))
    lengths = {
        "corner_leg_pick": corners[0].leg,
        "corner_leg_place": corners[1].leg,
        "corner_length_pick": corners[0].arc_length(mp.mpf(1)),
        "corner_length_place": corners[1].arc_length(mp.mpf(1)),
        "lift_length": phases[0].arc_length(mp.mpf(1)),
        "lower_length": phases[-1].arc_length(mp.mpf(1)),
    }
    durations = {phase.name: phase.leg.duration for phase in phases}
    return Plan(phases, durations, (corners[0].deviation(), corners[1].deviation()), lengths)
