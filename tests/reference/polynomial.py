"""Polynomials as ascending coefficient tuples, and their construction from boundary conditions."""

from collections.abc import Sequence
from typing import TypeAlias

from .precision import Number, mp

Polynomial: TypeAlias = tuple[Number, ...]


def fit(conditions: Sequence[tuple[int, Number, Number]]) -> Polynomial:
    """The polynomial with as many coefficients as there are conditions.

    Args:
        conditions: (derivative order n, abscissa x, value): the n-th derivative at x is the value.
    """
    size = len(conditions)
    matrix, right = mp.matrix(size, size), mp.matrix(size, 1)
    for row, (n, x, value) in enumerate(conditions):
        right[row] = value
        for power in range(n, size):
            matrix[row, power] = mp.ff(power, n) * mp.mpf(x) ** (power - n)
    return tuple(mp.lu_solve(matrix, right))


def evaluate(polynomial: Polynomial, x: Number) -> Number:
    """Value at x (a number, an array or a Taylor series), by Horner's scheme."""
    result = x * 0 + polynomial[-1]
    for coefficient in reversed(polynomial[:-1]):
        result = x * result + coefficient
    return result


def product(a: Polynomial, b: Polynomial) -> Polynomial:
    """Product of two polynomials."""
    result = [mp.mpf(0)] * (len(a) + len(b) - 1)
    for i, ai in enumerate(a):
        for j, bj in enumerate(b):
            result[i + j] += ai * bj
    return tuple(result)


def difference(a: Polynomial, b: Polynomial) -> Polynomial:
    """Difference a - b of polynomials of the same length."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def scaled(a: Polynomial, factor: Number) -> Polynomial:
    """Polynomial times a number."""
    return tuple(factor * coefficient for coefficient in a)


def antiderivative(a: Polynomial) -> Polynomial:
    """Antiderivative that vanishes at 0."""
    return (mp.mpf(0), *(coefficient / (n + 1) for n, coefficient in enumerate(a)))


def derivative(a: Polynomial) -> Polynomial:
    """First derivative."""
    return tuple(n * coefficient for n, coefficient in enumerate(a))[1:]
