"""The motion law on a corner: t(gamma) undone, to rounding, in a step or two."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference.precision import mp

from deltaph.kernel import ffi, lib


def law_of(ratio: float, legs: tuple[float, float] = (0.0352, 0.0352)) -> Any:
    """A corner at V_B = 1.2 m/s, V_N = ratio V_B."""
    corner, law = ffi.new("dph_corner *"), ffi.new("dph_corner_law *")
    lib.dph_corner_from_legs(*legs, corner)
    lib.dph_corner_law_make(corner, 1.2, 1.2 * ratio, law)
    return law


def inverted(law: Any, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    gamma, steps = np.empty(len(time)), np.empty(len(time), dtype=np.int32)
    lib.dph_corner_law_gamma(
        law, len(time), *(ffi.from_buffer("double[]", a) for a in (time, gamma)), ffi.from_buffer("int[]", steps)
    )
    return gamma, steps


def time_at(law: Any, gamma: float) -> Any:
    """Eq. (20) at 25 digits, from eqs. (6) and (16), on panels that narrow towards the middle and both ends."""
    a, b, entry, mid = (mp.mpf(x) for x in (law.corner.u0, law.corner.u2, law.entry_speed, law.mid_speed))

    def slowness(g: Any) -> Any:
        v = b * g * g
        u = a * (1 - g) ** 2 + v
        return (u * u + v * v) / (entry - 16 * (entry - mid) * (g * (1 - g)) ** 2)

    narrowing = [mp.mpf(2) ** -n for n in range(3, 16)]
    ends = sorted({mp.mpf(0), mp.mpf(1) / 2, mp.mpf(1), *narrowing, *(1 - x for x in narrowing)})
    ends = sorted({*ends, *(mp.mpf(1) / 2 + s * x for x in narrowing for s in (-1, 1))})
    with mp.workdps(25):
        return mp.quad(slowness, [*(x for x in ends if x < gamma), mp.mpf(gamma)], method="gauss-legendre")


@pytest.mark.parametrize(
    ("ratio", "legs"),
    [
        (2.0 / 3.0, (0.0352, 0.0352)),
        (1.0, (0.03, 0.045)),
        (1.0 - 1e-9, (0.0352, 0.0352)),
        (0.05, (0.2, 0.035)),
        (1e-3, (0.0352, 0.0352)),
        (1e-6, (0.03, 0.045)),
        (3.0, (0.0352, 0.0352)),
        (100.0, (0.2, 0.035)),
    ],
)
def test_the_parameter_at_a_time_is_the_root_of_the_quadrature(ratio: float, legs: tuple[float, float]) -> None:
    law = law_of(ratio, legs)
    assert law.duration == pytest.approx(float(time_at(law, 1.0)), rel=2e-15)
    time = law.duration * np.array([1e-4, 0.03, 0.21, 0.49, 0.77, 0.999])
    for t, gamma in zip(time, inverted(law, time)[0], strict=True):
        speed = law.entry_speed - 16.0 * (law.entry_speed - law.mid_speed) * (gamma * (1.0 - gamma)) ** 2
        rounding = 1e-16 * law.corner.length / speed  # of gamma itself
        assert float(time_at(law, gamma) - mp.mpf(t)) == pytest.approx(0.0, abs=4e-15 * law.duration + rounding)


def test_the_paper_s_case_takes_one_step_and_none_takes_many() -> None:
    for ratio, most in ((2.0 / 3.0, 1), (1.0, 1), (0.05, 1), (1e-3, 2), (1e-9, 4), (100.0, 2)):
        law = law_of(ratio)
        assert inverted(law, np.linspace(0.0, law.duration, 1000)[1:-1])[1].max() <= most, ratio


def test_the_ends_are_exact_and_beyond_them_nothing_moves() -> None:
    law = law_of(2.0 / 3.0)
    gamma, steps = inverted(law, np.array([-1.0, 0.0, law.duration, 1.0, np.nan]))
    assert gamma.tolist() == [0.0, 0.0, 1.0, 1.0, 0.0]
    assert not steps.any()


def test_times_do_not_know_their_neighbours() -> None:
    law = law_of(0.3)
    time = np.linspace(0.0, law.duration, 77)
    one_by_one = np.concatenate([inverted(law, time[i : i + 1])[0] for i in range(len(time))])
    assert (inverted(law, time)[0] == one_by_one).all()
    assert (inverted(law, time[::-1].copy())[0] == one_by_one[::-1]).all()
