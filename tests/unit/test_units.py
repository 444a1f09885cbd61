"""Units in the FMI's form."""

import pytest

from deltaph.fmu.units import base_unit, display_unit
from deltaph.variables import MODELS, variable_table


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("m", {"m": 1}),
        ("m/s2", {"m": 1, "s": -2}),
        ("N.m", {"kg": 1, "m": 2, "s": -2}),
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("1/s", {"s": -1}),
        ("Hz", {"s": -1}),
        ("m/m", {}),
    ],
)
def test_exponents(unit: str, exponents: dict[str, int]) -> None:
    assert base_unit(unit) == exponents


@pytest.mark.parametrize("unit", ["furlong", "N.m^2", "2m"])
def test_unknown_units_are_refused(unit: str) -> None:
    with pytest.raises(ValueError, match="unknown unit"):
        base_unit(unit)


def test_every_unit_in_use_is_known() -> None:
    for model in MODELS:
        for variable in variable_table(model):
            assert variable.unit is None or base_unit(variable.unit) is not None


@pytest.mark.parametrize(
    ("name", "shown", "one"),
    [("joint[1].position", "deg", 57.29577951308232), ("motor[2].speed", "r/min", 9.549296585513721), ("start.x", "mm", 1000.0)],
)
def test_display_units(name: str, shown: str, one: float) -> None:
    display = display_unit(variable_table("plant")[name])
    assert display is not None
    assert display.name == shown
    assert display.factor == pytest.approx(one, rel=1e-15)


def test_joints_are_not_shown_as_motors() -> None:
    assert display_unit(variable_table("plant")["joint[1].velocity"]) is None
