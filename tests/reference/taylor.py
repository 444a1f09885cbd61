"""Taylor arithmetic: truncated power series in time, exact to the working precision.

f(t0 + t) = sum_n c_n t^n, so the n-th time derivative is n! c_n. Coefficients may be mpf, float or arrays.
"""

import math
from collections.abc import Sequence

from .precision import Number, cosine, sine, square_root


class Taylor:
    """A power series c_0 + c_1 t + ... + c_n t^n, truncated after order n."""

    __slots__ = ("coefficients",)
    __array_ufunc__ = None  # an array times a series is a series, not an array of series

    def __init__(self, coefficients: Sequence[Number]) -> None:
        self.coefficients = list(coefficients)

    @classmethod
    def constant(cls, value: Number, order: int) -> "Taylor":
        """The series of a constant."""
        return cls([value] + [value * 0] * order)

    @property
    def order(self) -> int:
        """Order n of the highest coefficient kept."""
        return len(self.coefficients) - 1

    def derivative(self, n: int) -> Number:
        """The n-th derivative at the expansion point, n! c_n."""
        return math.factorial(n) * self.coefficients[n]

    def at_rate(self, rate: Number) -> "Taylor":
        """The series of f(rate * t): another clock, or with rate -1 time reversed."""
        return Taylor([c * rate**n for n, c in enumerate(self.coefficients)])

    def _series(self, other: "Taylor | Number") -> "Taylor":
        return other if isinstance(other, Taylor) else Taylor.constant(other, self.order)

    def __add__(self, other: "Taylor | Number") -> "Taylor":
        pairs = zip(self.coefficients, self._series(other).coefficients, strict=True)
        return Taylor([a + b for a, b in pairs])

    __radd__ = __add__

    def __neg__(self) -> "Taylor":
        return Taylor([-c for c in self.coefficients])

    def __sub__(self, other: "Taylor | Number") -> "Taylor":
        return self + (-other)

    def __rsub__(self, other: "Taylor | Number") -> "Taylor":
        return (-self) + other

    def __mul__(self, other: "Taylor | Number") -> "Taylor":
        if not isinstance(other, Taylor):
            return Taylor([c * other for c in self.coefficients])
        a, b = self.coefficients, other.coefficients
        return Taylor([sum(a[i] * b[n - i] for i in range(n + 1)) for n in range(len(a))])

    __rmul__ = __mul__

    def __truediv__(self, other: "Taylor | Number") -> "Taylor":
        if not isinstance(other, Taylor):
            return Taylor([c / other for c in self.coefficients])
        b = other.coefficients
        quotient: list[Number] = []
        for n, a in enumerate(self.coefficients):  # from (quotient * other)_n = a_n
            quotient.append((a - sum(quotient[i] * b[n - i] for i in range(n))) / b[0])
        return Taylor(quotient)

    def sqrt(self) -> "Taylor":
        """Square root r, from (r * r)_n = c_n."""
        root = [square_root(self.coefficients[0])]
        for n, c in enumerate(self.coefficients[1:], start=1):
            root.append((c - sum(root[i] * root[n - i] for i in range(1, n))) / (2 * root[0]))
        return Taylor(root)

    def sine_cosine(self) -> tuple["Taylor", "Taylor"]:
        """Sine and cosine together, from s' = c f' and c' = -s f'."""
        f = self.coefficients
        s, c = [sine(f[0])], [cosine(f[0])]
        for n in range(1, len(f)):
            s.append(sum(i * f[i] * c[n - i] for i in range(1, n + 1)) / n)
            c.append(-sum(i * f[i] * s[n - i] for i in range(1, n + 1)) / n)
        return Taylor(s), Taylor(c)
