"""The quintic PH corner with equal legs m = k, found from its deviation (paper section 3.1).

Corner frame of the paper: origin B, x along the traverse, y along the lift, vertex H = (0, m),
end C = (m, m).
"""

from collections.abc import Callable
from dataclasses import dataclass

from .polynomial import Polynomial, antiderivative, difference, evaluate, product, scaled
from .precision import Number, mp, square_root
from .taylor import Taylor


@dataclass(frozen=True)
class Corner:
    """A corner: leg m [m] and its hodograph and curve as polynomials of the parameter gamma in [0, 1].

    x' = 2 u v, y' = u^2 - v^2 with the preimage u = u0 (1-gamma)^2 + u2 gamma^2, v = v2 gamma^2 (eq. 6).
    """

    leg: Number
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


def corner_with_leg(leg: Number) -> Corner:
    """The corner of leg m = k [m], the preimage found from the end point and the horizontal end tangent."""

    def preimage(u0: Number, u2: Number, v2: Number) -> tuple[Callable[[Number], Number], ...]:
        return (lambda g: u0 * (1 - g) ** 2 + u2 * g**2), (lambda g: v2 * g**2)

    def residual(u0: Number, u2: Number, v2: Number) -> list[Number]:
        u, v = preimage(u0, u2, v2)
        end_x = mp.quad(lambda g: 2 * u(g) * v(g), [0, 1], method="gauss-legendre")
        end_y = mp.quad(lambda g: u(g) ** 2 - v(g) ** 2, [0, 1], method="gauss-legendre")
        return [end_x - leg, end_y - leg, u(1) ** 2 - v(1) ** 2]

    root = mp.sqrt(leg)
    start = (2 * root, mp.mpf("1.5") * root, mp.mpf("1.4") * root)
    u0, u2, v2 = mp.findroot(residual, start, tol=(leg * mp.mpf(10) ** (8 - mp.dps)) ** 2)
    u, v = (u0, -2 * u0, u0 + u2), (mp.mpf(0), mp.mpf(0), v2)
    dx, dy = scaled(product(u, v), mp.mpf(2)), difference(product(u, u), product(v, v))
    return Corner(leg, (u0, u2, v2), dx, dy, antiderivative(dx), antiderivative(dy))


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
