"""Units in the form the FMI wants them: exponents of base units, and what a person would rather read."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from deltaph.variables import Variable

_DERIVED = {
    "m": {"m": 1},
    "kg": {"kg": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Hz": {"s": -1},
    "1": {},
}
"""Symbol -> exponents of the FMI's base units (kg, m, s, A, K, mol, cd, rad)."""


class DisplayUnit(NamedTuple):
    """Another unit for the same quantity.

    Attributes:
        name: such as `deg`.
        factor: value in this unit = factor * SI value.
    """

    name: str
    factor: float


_MILLIMETRE = DisplayUnit("mm", 1e3)
_DEGREE = DisplayUnit("deg", 180.0 / math.pi)
_REVOLUTIONS_PER_MINUTE = DisplayUnit("r/min", 30.0 / math.pi)

DISPLAY_UNITS = {"m": _MILLIMETRE, "rad": _DEGREE, "rad/s": _REVOLUTIONS_PER_MINUTE}
"""SI unit -> its display unit."""


def base_unit(unit: str) -> dict[str, int]:
    """The exponents of a unit such as `N.m.s/rad` or `kg.m2`: products by dots, powers by digits, at most one slash.

    Raises:
        ValueError: a symbol is unknown.
    """
    numerator, _, denominator = unit.partition("/")
    exponents: dict[str, int] = {}
    for sign, product in ((1, numerator), (-1, denominator)):
        for factor in filter(None, product.split(".")):
            match = re.fullmatch(r"([A-Za-z]+|1)(\d*)", factor)
            if match is None or match[1] not in _DERIVED:
                raise ValueError(f"unknown unit {factor!r} in {unit!r}")
            for base, exponent in _DERIVED[match[1]].items():
                exponents[base] = exponents.get(base, 0) + sign * exponent * int(match[2] or 1)
    return {base: exponent for base, exponent in exponents.items() if exponent}


def display_unit(variable: Variable) -> DisplayUnit | None:
    """The unit a tool should show a variable in, or None: revolutions per minute suit motors, not joints."""
    if variable.unit == "rad/s" and not variable.name.startswith(("motor", "drive")):
        return None
    return DISPLAY_UNITS.get(variable.unit or "")
