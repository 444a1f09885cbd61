"""Working precision of the reference, its number types, and the few functions that serve all of them."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeAlias

import mpmath
import numpy as np

# A clone, so that the 50 digits do not leak into other users of mpmath.
mp: Any = mpmath.mp.clone()
mp.dps = 50

Number: TypeAlias = Any  # mpf, float, or an array of floats (n,): a scan over n parameters at once
Vector: TypeAlias = tuple[Number, Number, Number]


def _is_double(value: Number) -> bool:
    return isinstance(value, float | np.ndarray)


def square_root(value: Number) -> Number:
    """Square root of an mpf, a float or an array."""
    return np.sqrt(value) if _is_double(value) else mp.sqrt(value)


def sine(value: Number) -> Number:
    """Sine of an mpf, a float or an array [rad]."""
    return np.sin(value) if _is_double(value) else mp.sin(value)


def cosine(value: Number) -> Number:
    """Cosine of an mpf, a float or an array [rad]."""
    return np.cos(value) if _is_double(value) else mp.cos(value)


def arctangent2(y: Number, x: Number) -> Number:
    """Angle of (x, y) [rad]."""
    return np.arctan2(y, x) if _is_double(x) else mp.atan2(y, x)


def resolution(value: Number) -> Number:
    """Step size at which an iteration in the number type of `value` has converged (relative to 1)."""
    return 1e-13 if _is_double(value) else mp.mpf(10) ** (5 - mp.dps)


def in_double(value: Any) -> Any:
    """The same object with every mpf inside it (fields, tuples) rounded to a float."""
    if isinstance(value, mp.mpf):
        return float(value)
    if isinstance(value, tuple):
        return tuple(in_double(item) for item in value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: in_double(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return dataclasses.replace(value, **fields)
    return value


def agree(value: Number, expected: Number | str, digits: int = 40) -> bool:
    """Whether two mpf agree to so many digits, absolutely where the expected value is below 1."""
    target = mp.mpf(expected)
    return bool(abs(mp.mpf(value) - target) <= mp.mpf(10) ** -digits * max(1, abs(target)))


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Scalar product of two vectors (3)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    """Vector product of two vectors (3)."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def combine(columns: Sequence[Sequence[Number]], right: Sequence[Number]) -> Vector:
    """Solve sum_i columns[i] x_i = right for x (3), by Cramer's rule with triple products.

    Args:
        columns: three vectors (3, 3), column by column.
        right: right-hand side (3).
    """
    c = columns
    volume = dot(c[0], cross(c[1], c[2]))
    return (
        dot(right, cross(c[1], c[2])) / volume,
        dot(right, cross(c[2], c[0])) / volume,
        dot(right, cross(c[0], c[1])) / volume,
    )
