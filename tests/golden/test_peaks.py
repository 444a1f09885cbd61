"""Peaks of corners that are passed far faster or far slower than they are entered, against the high-precision reference."""

import pytest
from golden.test_golden_plans import plan_of
from reference import golden
from reference.peaks import peaks

ROBOT = golden.robot(golden.load("cases.toml"))
WIDE = {"pick": [-0.1525, 0.0, -0.8], "place": [0.1525, 0.0, -0.8], "lift_pick": 0.05, "lift_place": 0.05}
SHORT = {"pick": [0.156, 0.105, -0.82], "place": [0.141, -0.047, -0.76], "lift_pick": 0.084, "lift_place": 0.024}


@pytest.mark.parametrize(
    ("points", "deviations", "entry", "mid"),
    [(WIDE, (0.001, 0.001), 1.2, 1.2e-5), (WIDE, (0.006, 0.006), 1e-3, 10.0), (SHORT, (0.0019, 0.0019), 0.3334, 5.083)],
    ids=["1e-5 times as fast", "1e4 times as fast", "15 times as fast"],
)
def test_the_short_part_of_a_corner_is_not_missed(
    points: dict[str, object], deviations: tuple[float, float], entry: float, mid: float
) -> None:
    case = points | {
        "law": "paper",
        "corner_deviation_pick": deviations[0],
        "corner_deviation_place": deviations[1],
        "corner_entry_speed": entry,
        "corner_mid_speed": mid,
        "traverse_speed": 2.0,
        "payload": 0.0,
    }
    found, reference = plan_of(case).peaks, golden.plan(case)
    for kind in ("joint_acceleration", "joint_jerk", "joint_torque"):
        exact = [float(value) for value in peaks(ROBOT, 0, reference, kind)]
        assert list(getattr(found, kind)) == pytest.approx(exact, rel=1e-9), kind
