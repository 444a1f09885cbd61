"""Which part of a long recording its plots show first: motions of a whole run would be too close together to be told apart."""

from __future__ import annotations

import rerun.blueprint as rrb

LONG = 2.0
"""A recording that is longer is one [s]. While it grows, so much of it is shown."""

_AROUND = (-0.42, 0.45)
"""So much before and after the moment of interest [s]. No number, at whole tenths, is at an end, where it would be cut off."""

_NARROW = (-0.22, 0.25)
"""The same of a plot of half the width [s]."""

_CLOSE = (-0.0235, 0.0245)
"""The same of a corner, where numbers are at whole hundredths [s]."""

Range = tuple[float, float]
"""From when to when [s]."""


def around(moment: float, *, narrow: bool = False) -> Range:
    """Some motions around a moment [s]; fewer in a plot of half the width."""
    at, (before, after) = 0.1 * round(10.0 * moment), _NARROW if narrow else _AROUND
    return at + before, at + after


def close_to(moment: float) -> Range:
    """A corner that is passed at a moment [s]."""
    at = 0.01 * round(100.0 * moment)
    return at + _CLOSE[0], at + _CLOSE[1]


def newest() -> rrb.TimeAxis:
    """The axis of a plot that shows what came last before the cursor, which follows a cell that runs."""
    start, end = (rrb.TimeRangeBoundary.cursor_relative(seconds=seconds) for seconds in (-LONG, 0.0))
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))


def time_axis(during: Range | None) -> rrb.TimeAxis:
    """The axis of a plot. Without a range: all of the time, and shared with other plots; the viewer cannot share a given one."""
    if during is None:
        return rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=seconds) for seconds in during)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))
