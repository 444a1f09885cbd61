"""The planner's clock, as the planner itself moves it on: slowed down by a feed override, still while there is nothing to run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deltaph.kernel import ffi, lib

FloatArray = NDArray[np.float64]


class FeedClock:
    """When the planner's clock is where; without overrides and pauses it is the time.

    Args:
        changes: overrides in order, as (from when [ms], value); a whole number of milliseconds.
    """

    def __init__(self, changes: Sequence[tuple[int, float]] = ()) -> None:
        filtered = ffi.new("Feed *")
        lib.feed_start(filtered, 1.0)
        time, clock = [0.0], [0.0]
        for (_, rate), (end, _) in pairwise([(0, 1.0), *changes, (math.inf, 1.0)]):
            self._rate = rate
            while time[-1] < end and not lib.feed_is_settled(filtered, rate):
                time.append(time[-1] + 1.0)
                clock.append(clock[-1] + 1000.0 * lib.feed_step(filtered, rate))
            if time[-1] < end < math.inf:
                clock.append(clock[-1] + rate * (end - time[-1]))
                time.append(float(end))
        self._time, self._clock = np.array(time), np.array(clock)

    def paused(self, begin: float, end: float) -> FeedClock:
        """The same clock, but that it stands from one time to another, both in [ms]; the override is filtered on meanwhile."""
        before, after = self._time < begin, self._time > end
        stands, goes_on = self._at_ms(np.array([begin, end])).tolist()
        found = copy(self)
        found._time = np.concatenate([self._time[before], [begin, end], self._time[after]])
        found._clock = np.concatenate([self._clock[before], [stands, stands], self._clock[after] - (goes_on - stands)])
        return found

    def _at_ms(self, ms: FloatArray) -> FloatArray:
        beyond = np.maximum(ms - self._time[-1], 0.0)
        clock: FloatArray = np.interp(ms, self._time, self._clock) + self._rate * beyond
        return clock

    def at(self, time: FloatArray) -> FloatArray:
        """The clock (n,) [s] at times (n,) [s]."""
        return self._at_ms(1000.0 * time) / 1000.0

    def reaches(self, clock: float) -> float:
        """The time at which the clock comes to a value; both in [ms]."""
        if clock >= self._clock[-1]:
            return float(self._time[-1] + (clock - self._clock[-1]) / self._rate)
        # the first time it is there: a clock that stands still is at its value for a while
        after = max(int(np.searchsorted(self._clock, clock)), 1)
        ends = slice(after - 1, after + 1)
        return float(np.interp(clock, self._clock[ends], self._time[ends]))
