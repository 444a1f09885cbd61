"""The quintic PH corner, with equal legs found from its deviation (paper section 3.1), or with two legs m and k.

Corner frame of the paper: origin B, x along the traverse, y along the lift, vertex H = (0, m),
end C = (k, m).
"""

from collections.abc import Callable
from dataclasses import dataclass

from .polynomial import Polynomial, antiderivative, difference, evaluate, product, scaled
from .precision import Number, mp, square_root
from .taylor import Taylor


@dataclass(frozen=True)
class Corner:
    """A corner: legs m and k [m] and its hodograph and curve as polynomials of the parameter gamma in [0, 1].

    x' = 2 u v, y' = u^2 - v^2 with the preimage u = u0 (1-gamma)^2 + u2 gamma^2, v = v2 gamma^2 (eq. 6).
    """

    leg: Number
    second_leg: Number
    preimage: tuple[Number, Number, Number]
    hodograph_x: Polynomial
    hodograph_y: Polynomial
    x: Polynomial
    y: Polynomial

    def parametric_speed(self, gamma: Number) -> Number:
        """Parametric speed |P'| [m] at a number, an array or a series, as the norm of the hodograph."""
        dx, dy = evaluate(self.hodograph_x, gamma), evaluate(self.hodograph_y, gamma)
        square = dx * dx + dy * dy
        return square.sqrt() if isinstance(square, Taylor) else square_root(square)

    def arc_length(self, gamma: Number) -> Number:
        """Arc length from B to gamma [m] by quadrature of |P'|."""
        return mp.quad(self.parametric_speed, [0, gamma], method="gauss-legendre")

    def nearest_parameter(self) -> Number:
        """Parameter of the point nearest to the vertex: the root of (P - H) . P' in (0, 1)."""

        def slope(gamma: Number) -> Number:
            across, down = evaluate(self.x, gamma), evaluate(self.y, gamma) - self.leg
            return across * evaluate(self.hodograph_x, gamma) + down * evaluate(self.hodograph_y, gamma)

        return mp.findroot(slope, (mp.mpf("0.1"), mp.mpf("0.8")), solver="anderson", tol=mp.eps**2)

    def deviation(self) -> Number:
        """Corner deviation [m]: the smallest distance from the vertex H to the curve."""
        gamma = self.nearest_parameter()
        return mp.hypot(evaluate(self.x, gamma), evaluate(self.y, gamma) - self.leg)


def corner_with_legs(leg: Number, second_leg: Number) -> Corner:
    """The corner of legs m, k [m], the preimage found from the end point and the horizontal end tangent.

    Found at m = k first; from there the longer leg is grown, each root the start of the next.
    """

    def preimage(u0: Number, u2: Number, v2: Number) -> tuple[Callable[[Number], Number], ...]:
        return (lambda g: u0 * (1 - g) ** 2 + u2 * g**2), (lambda g: v2 * g**2)

    def found(m: Number, k: Number, start: tuple[Number, ...]) -> tuple[Number, ...]:
        def residual(u0: Number, u2: Number, v2: Number) -> list[Number]:
            u, v = preimage(u0, u2, v2)
            end_x = mp.quad(lambda g: 2 * u(g) * v(g), [0, 1], method="gauss-legendre")
            end_y = mp.quad(lambda g: u(g) ** 2 - v(g) ** 2, [0, 1], method="gauss-legendre")
            return [end_x - k, end_y - m, u(1) ** 2 - v(1) ** 2]

        return tuple(mp.findroot(residual, start, tol=(min(m, k) * mp.mpf(10) ** (8 - mp.dps)) ** 2))

    m, k = mp.mpf(leg), mp.mpf(second_leg)
    short, root = min(m, k), mp.sqrt(min(m, k))
    unknowns = found(short, short, (2 * root, mp.mpf("1.5") * root, mp.mpf("1.4") * root))
    steps = int(mp.ceil(2 * mp.log(max(m, k) / short)))
    for step in range(1, steps + 1):
        share = mp.mpf(step) / steps
        unknowns = found(short * (m / short) ** share, short * (k / short) ** share, unknowns)
    u0, u2, v2 = unknowns
    u, v = (u0, -2 * u0, u0 + u2), (mp.mpf(0), mp.mpf(0), v2)
    dx, dy = scaled(product(u, v), mp.mpf(2)), difference(product(u, u), product(v, v))
    return Corner(m, k, (u0, u2, v2), dx, dy, antiderivative(dx), antiderivative(dy))


def corner_with_leg(leg: Number) -> Corner:
    """The corner of leg m = k [m]."""
    return corner_with_legs(leg, leg)


def second_leg(leg: Number, deviation: Number) -> Number:
    """The leg k [m] with which a leg m gives a deviation [m], by root finding on k."""
    m, d = mp.mpf(leg), mp.mpf(deviation)
    start = 36 * d**2 / m
    return mp.findroot(
        lambda k: corner_with_legs(m, k).deviation() - d,
        (start, start * mp.mpf("0.95")),
        solver="secant",
        tol=(d * mp.mpf(10) ** (8 - mp.dps)) ** 2,
    )


def corner_with_deviation(deviation: Number) -> Corner:
    """The corner m = k whose deviation (vertex to curve) is d [m], by root finding on m."""
    d = mp.mpf(deviation)
    leg = mp.findroot(
        lambda m: corner_with_leg(m).deviation() - d,
        (5 * d, 6 * d),
        solver="secant",
        tol=(d * mp.mpf(10) ** (8 - mp.dps)) ** 2,
    )
    return corner_with_leg(leg)
