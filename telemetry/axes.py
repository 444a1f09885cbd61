"""Ranges of plots whose axes can be read."""

from __future__ import annotations

import math

_MARGIN = 0.05
"""Beyond the values at either end, in parts of their range."""

_EDGE = 0.05
"""A number nearer than this to an end of the axis, in parts of its length, would be cut off: half the height of its digits."""


def labelled(low: float, high: float, numbers: int = 6) -> tuple[float, float]:
    """A range that holds these values, and at least two numbers at its axis, so that its scale is told.

    Args:
        low: least value.
        high: greatest value.
        numbers: the viewer writes them at whole multiples of a power of ten where no more than so many share the height of a plot.
            It takes some 30 pixels for one.
    """
    if low == high:
        low, high = min(low, 0.0), max(high, 0.0)
    if low == high:
        return -1.1, 1.1
    margin = _MARGIN * (high - low)
    low, high = low - margin, high + margin
    step = 10.0 ** math.ceil(math.log10((high - low) / numbers))
    while math.floor(high / step) - math.ceil(low / step) < 1:
        below, above = step * (math.ceil(low / step) - 1), step * (math.floor(high / step) + 1)
        if low - below < above - high:
            low = below - margin
        else:
            high = above + margin
    edge = _EDGE * (high - low)
    return min(low, step * math.ceil(low / step) - edge), max(high, step * math.floor(high / step) + edge)
