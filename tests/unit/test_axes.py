"""Ranges of plots."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaph.telemetry.axes import labelled


@pytest.mark.parametrize(
    ("low", "high", "numbers"),
    [
        (-0.081, 0.07, [-0.1, 0.0]),  # else there is only nought
        (-90.0, 80.0, [-100.0, 0.0]),
        (-2.8, 2.5, [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0]),
        (-4.8, 3.7, [-10.0, 0.0]),  # nine whole numbers are too many
        (0.0, 0.0, [-1.0, 0.0, 1.0]),
        (7.0, 7.0, [0.0, 10.0]),
    ],
)
def test_at_least_two_numbers_are_written_at_the_axis(low: float, high: float, numbers: list[float]) -> None:
    bottom, top = labelled(low, high)
    step = numbers[1] - numbers[0]
    found = [k * step for k in range(math.ceil(bottom / step), math.floor(top / step) + 1)]
    assert found == pytest.approx(numbers)


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_values_are_inside_and_fill_a_third(low: float, length: float) -> None:
    bottom, top = labelled(low, low + length)
    assert bottom < low
    assert top > low + length
    assert length > 0.3 * (top - bottom)


@pytest.mark.parametrize(("low", "high"), [(-0.8, 0.1525), (-190.0, 191.0), (0.0, 36.0)])
def test_no_number_is_cut_off_at_the_end_of_the_axis(low: float, high: float) -> None:
    bottom, top = labelled(low, high, 13)
    step = 0.1 if high < 1.0 else 10.0 if low == 0.0 else 100.0
    length = top - bottom
    for number in (step * math.ceil(bottom / step), step * math.floor(top / step)):
        assert bottom + 0.03 * length < number < top - 0.03 * length
