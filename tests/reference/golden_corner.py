"""Rows of the golden file of corners with legs of two lengths."""

from collections.abc import Iterator, Mapping
from typing import Any

from .corner import corner_with_legs, second_leg
from .golden import Row
from .paper_law import corner_leg
from .polynomial import evaluate
from .precision import mp

GAMMAS = ("0.1", "0.37", "0.5", "0.82", "1.0")


def corner_rows(cases: Mapping[str, Any]) -> Iterator[Row]:
    """All rows: of corners given by both legs, or by one leg and the deviation."""
    for name, case in cases["corner"].items():
        m = case["leg"]
        k = case["second_leg"] if "second_leg" in case else second_leg(m, case["corner_deviation"])
        corner = corner_with_legs(m, k)
        yield Row(name, "second_leg", k, "given, or root finding on the deviation")
        yield Row(name, "corner_deviation", corner.deviation(), "min |P - H|; root of its derivative")
        yield Row(name, "length", corner.arc_length(mp.mpf(1)), "quadrature of |P'|")
        law = corner_leg(corner, mp.mpf(0), case["corner_entry_speed"], case["corner_mid_speed"])
        yield Row(name, "duration", law.duration, "quadrature of |P'| / v")
        for gamma in GAMMAS:
            g = mp.mpf(gamma)
            route = "preimage by root finding on end point and tangent, its polynomials"
            yield Row(name, f"at.{gamma}.x", evaluate(corner.x, g), route)
            yield Row(name, f"at.{gamma}.y", evaluate(corner.y, g), route)
            yield Row(name, f"at.{gamma}.sigma", corner.parametric_speed(g), "norm of the hodograph")
            yield Row(name, f"at.{gamma}.length", corner.arc_length(g), "quadrature of |P'|")
