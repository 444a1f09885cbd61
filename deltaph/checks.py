"""A scenario's expectations against what was planned and executed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from deltaph.execution import Execution
from deltaph.scenario import Scenario
from deltaph.scenario_file import Expectation, ExpectSection
from deltaph.schedule import Schedule


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
    if not values:
        return Check(name, "none", _bound(expectation), False)
    low, high = expectation.low, expectation.high

    def excess(value: float) -> float:
        below = low - value if low is not None else float("-inf")
        above = value - high if high is not None else float("-inf")
        return max(below, above)

    worst = max(values, key=excess)
    return Check(name, worst, _bound(expectation), excess(worst) <= 0.0)


def planned_values(run: Schedule) -> dict[str, list[float]]:
    """What plans can be expected to show, by key of `[expect]`; of a sequence, those of every operation."""
    plans = [operation.plan for operation in run.one_pass]
    return {
        "duration_ms": [1e3 * plan.duration for plan in plans],
        "nominal_duration_ms": [1e3 * plan.nominal_duration for plan in plans],
        "planned_corner_deviation_mm": [1e3 * d for plan in plans for d in plan.corner_deviation],
        "cycle_time_ms": [1e3 * run.cycle_time],
        "parts_per_minute": [run.parts_per_minute],
    }


def executed_values(execution: Execution) -> dict[str, list[float]]:
    """What a run can be expected to show, by key of `[expect]`."""
    return {
        "executed_corner_deviation_mm": [1e3 * d for d in execution.corner_deviation],
        "corner_excess_mm": [1e3 * (corner.executed - corner.prescribed) for corner in execution.corners],
        "arrival_ms": [1e3 * execution.arrival] if execution.arrival is not None else [],
        "overshoot_mm": [1e3 * execution.overshoot],
        "tracking_error_tcp_mm": [1e3 * execution.tracking_error_tcp_max],
        "tracking_error_joint_mrad": [1e3 * execution.tracking_error_joint_max],
        "motor_torque_max_Nm": list(execution.motor_torque_max),
        "motor_torque_rms_Nm": list(execution.motor_torque_rms),
        "motor_load_max": list(execution.motor_load_max),
        "trip_axis": [float(execution.trip_axis)],
    }


def evaluate_expectations(expect: ExpectSection, values: dict[str, list[float]], trip: str | None = None) -> list[Check]:
    """Check every expectation on what was looked at; what was looked for and not found, such as an arrival, is missed.

    A plan that was to be refused and was not is a missed expectation.

    Args:
        expect: what is expected.
        values: what was found, by key; what was not looked at, such as what is executed of a plan, has none.
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
    """By how much the scenario lets an executed corner deviation exceed what is prescribed [m]."""
    excess, deviation = scenario.expect.corner_excess_mm, scenario.expect.executed_corner_deviation_mm
    if excess is not None and excess.high is not None:
        return max(excess.high, 0.0) / 1000.0
    return deviation.tolerance / 1000.0 if deviation is not None else 0.0
