"""A scenario's expectations against what was planned and executed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from deltaph.execution import Execution
from deltaph.plan import Plan
from deltaph.scenario import Scenario
from deltaph.scenario_file import Expectation, ExpectSection


@dataclass(frozen=True, slots=True)
class Check:
    """One expectation and what became of it.

    Attributes:
        name: key of `[expect]`, unit included.
        value: what was found, in that unit; of several values the one furthest out.
        limit: the bound in words.
        ok: whether it is met.
    """

    name: str
    value: float | str
    limit: str
    ok: bool

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def _bound(expectation: Expectation) -> str:
    if expectation.equals is not None:
        return f"{expectation.equals:g} ± {expectation.tolerance:g}"
    parts = [
        f"{word} {value:g}" for word, value in (("at least", expectation.min), ("at most", expectation.max)) if value is not None
    ]
    return " and ".join(parts)


def _check(name: str, expectation: Expectation, values: Sequence[float]) -> Check:
    low, high = expectation.low, expectation.high

    def excess(value: float) -> float:
        below = low - value if low is not None else float("-inf")
        above = value - high if high is not None else float("-inf")
        return max(below, above)

    worst = max(values, key=excess)
    return Check(name, worst, _bound(expectation), excess(worst) <= 0.0)


def planned_values(plan: Plan) -> dict[str, list[float]]:
    """What a plan can be expected to show, by key of `[expect]`."""
    return {
        "duration_ms": [1e3 * plan.duration],
        "nominal_duration_ms": [1e3 * plan.nominal_duration],
        "planned_corner_deviation_mm": [1e3 * d for d in plan.corner_deviation],
    }


def executed_values(execution: Execution) -> dict[str, list[float]]:
    """What a run can be expected to show, by key of `[expect]`."""
    return {
        "executed_corner_deviation_mm": [1e3 * d for d in execution.corner_deviation],
        "overshoot_mm": [1e3 * execution.overshoot],
        "tracking_error_tcp_mm": [1e3 * execution.tracking_error_tcp_max],
        "tracking_error_joint_mrad": [1e3 * execution.tracking_error_joint_max],
        "motor_torque_max_Nm": list(execution.motor_torque_max),
        "motor_torque_rms_Nm": list(execution.motor_torque_rms),
        "motor_load_max": list(execution.motor_load_max),
        "trip_axis": [float(execution.trip_axis)],
    }


def evaluate_expectations(expect: ExpectSection, values: dict[str, list[float]], trip: str | None = None) -> list[Check]:
    """Check every expectation for which there is a value. A plan that was to be refused and was not is a missed expectation.

    Args:
        expect: what is expected.
        values: what was found, by key.
        trip: why the plant tripped; None where nothing was run. A run that trips has to be expected to.
    """
    checks = [
        _check(name, expectation, values[name])
        for name in ExpectSection.model_fields
        if isinstance(expectation := getattr(expect, name), Expectation) and name in values
    ]
    if trip is not None and (expect.trip is not None or trip != "none"):
        expected = expect.trip or "none"
        checks.append(Check("trip", trip, expected, trip == expected))
    if expect.refused is not None:
        checks.append(Check("refused", "accepted", expect.refused, False))
    return checks


def deviation_tolerance(scenario: Scenario) -> float:
    """The scenario's tolerance on the executed corner deviation [m]."""
    expectation = scenario.expect.executed_corner_deviation_mm
    return expectation.tolerance / 1000.0 if expectation is not None else 0.0
