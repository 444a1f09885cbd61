"""The kernel's corners with legs of two lengths against the high-precision reference."""

from typing import Any

import pytest
from golden.golden_file import cases, golden

from deltaph.kernel import ffi, lib

CASES = cases("corners", "corner")
GOLDEN = golden("corners")


def corner_of(case: dict[str, Any]) -> Any:
    second_leg = case.get("second_leg") or lib.dph_corner_longer_leg(case["leg"], case["corner_deviation"], 1.0)
    corner = ffi.new("dph_corner *")
    lib.dph_corner_from_legs(case["leg"], second_leg, corner)
    return corner


def quantity(case: dict[str, Any], name: str) -> float:
    corner = corner_of(case)
    if name == "duration":
        law = ffi.new("dph_corner_law *")
        lib.dph_corner_law_make(corner, case["corner_entry_speed"], case["corner_mid_speed"], law)
        return float(law.duration)
    if name.startswith("at."):
        gamma, what = name.removeprefix("at.").rsplit(".", 1)
        point = ffi.new("dph_corner_point *")
        lib.dph_corner_at(corner, float(gamma), point)
        return float({"x": point.p[0][0], "y": point.p[0][1], "sigma": point.sigma[0], "length": point.length}[what])
    return float({"second_leg": corner.second_leg, "corner_deviation": corner.deviation, "length": corner.length}[name])


@pytest.mark.parametrize("name", CASES)
def test_corner_agrees_with_the_reference(name: str) -> None:
    lines = [line for line in GOLDEN if line.case == name]
    assert len(lines) == 24
    wrong = [message for line in lines if (message := line.check(quantity(CASES[name], line.quantity))) is not None]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", CASES)
def test_swapped_legs_are_the_mirror_image(name: str) -> None:
    corner, mirrored = corner_of(CASES[name]), ffi.new("dph_corner *")
    lib.dph_corner_from_legs(corner.second_leg, corner.leg, mirrored)
    assert mirrored.deviation == pytest.approx(corner.deviation, rel=1e-14)
    point, other = ffi.new("dph_corner_point *"), ffi.new("dph_corner_point *")
    for gamma in (0.0, 0.2, 0.5, 0.9, 1.0):
        lib.dph_corner_at(corner, gamma, point)
        lib.dph_corner_at(mirrored, 1.0 - gamma, other)
        assert point.p[0][0] == pytest.approx(corner.second_leg - other.p[0][1], abs=1e-16)
        assert point.p[0][1] == pytest.approx(corner.leg - other.p[0][0], abs=1e-16)
        assert point.sigma[0] == pytest.approx(other.sigma[0], rel=1e-14)
