"""The kernel's plans against the high-precision reference, case by case, number by number."""

from typing import Any

import numpy as np
import pytest
from golden.golden_file import cases, golden

from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import Law, Task

CASES = cases("cases", "case")
_SAMPLES = {
    "position": "tcp_position",
    "velocity": "tcp_velocity",
    "acceleration": "tcp_acceleration",
    "jerk": "tcp_jerk",
    "arc_length": "arc_length",
    "joint_position": "joint_position",
    "joint_velocity": "joint_velocity",
    "joint_acceleration": "joint_acceleration",
    "joint_torque": "joint_torque",
}


def plan_of(case: dict[str, Any]) -> Plan:
    task = Task(
        tuple(case["pick"]),
        tuple(case["place"]),
        (case["lift_pick"], case["lift_place"]),
        (case.get("corner_deviation_pick", 0.006), case.get("corner_deviation_place", 0.006)),
    )
    law = Law(
        case["law"], case["corner_entry_speed"], case.get("corner_mid_speed", 0.8), case["traverse_speed"], case.get("overlap", 0.5)
    )
    return Plan(Robot.default(), task, law, case["payload"])


def quantity(plan: Plan, name: str) -> float:
    """The product's value of a golden quantity."""
    struct = plan._struct
    head, *rest = name.split(".")
    if head == "sample":
        what, *component = name.removeprefix("sample.").split(".", 2)[2:][0].split(".")
        time = float(".".join(rest[:2]))
        value = plan.sample(np.array([time]))[_SAMPLES[what]][0]
        return float(value[{"x": 0, "y": 1, "z": 2, "1": 0, "2": 1, "3": 2}[component[0]]] if component else value)
    if head == "peak":
        value = getattr(plan.peaks, rest[0])
        return float(value[int(rest[1]) - 1] if len(rest) > 1 else value)
    if head == "duration":
        phase = next(phase for phase in plan.phases if phase.name == rest[0])
        return phase.duration * plan.speed_factor
    side = {"pick": 0, "place": 1}.get(head.rsplit("_", 1)[-1], 0)
    return float(
        {
            "corner_leg_pick": lambda: struct.side[0].corner.corner.leg,
            "corner_leg_place": lambda: struct.side[1].corner.corner.leg,
            "corner_length_pick": lambda: struct.side[0].corner.corner.length,
            "corner_length_place": lambda: struct.side[1].corner.corner.length,
            "corner_deviation_pick": lambda: plan.corner_deviation[side],
            "corner_deviation_place": lambda: plan.corner_deviation[side],
            "lift_length": lambda: struct.side[0].lift_length,
            "lower_length": lambda: struct.side[1].lift_length,
            "nominal_duration": lambda: plan.nominal_duration,
            "aligned_duration": lambda: plan.duration,
            "path_length": lambda: plan.length,
        }[head]()
    )


@pytest.mark.parametrize("name", CASES)
def test_plan_agrees_with_the_reference(name: str) -> None:
    plan = plan_of(CASES[name])
    wrong = [message for line in golden(name) if (message := line.check(quantity(plan, line.quantity))) is not None]
    assert not wrong, "\n".join(wrong)


def test_headline_numbers_of_the_paper() -> None:
    plan = plan_of(CASES["paper"])
    assert plan.duration == 0.303
    assert plan.nominal_duration == pytest.approx(0.30269732142, abs=5e-12)
    assert plan_of(CASES["comparison"]).corner_deviation[0] == pytest.approx(3.70179006406039272e-3, rel=1e-12)
