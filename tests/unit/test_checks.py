"""Expectations against what was found."""

from deltaph.checks import Check, evaluate_expectations
from deltaph.scenario_file import Expectation, ExpectSection

EXPECT = ExpectSection(arrival_ms=Expectation(max=400.0), overshoot_mm=Expectation(max=0.1))


def test_what_did_not_come_to_pass_is_a_missed_expectation() -> None:
    checks = evaluate_expectations(EXPECT, {"arrival_ms": [], "overshoot_mm": [0.05]}, "none")
    assert checks == [Check("arrival_ms", "none", "at most 400", False), Check("overshoot_mm", 0.05, "at most 0.1", True)]


def test_what_was_not_looked_at_is_not_judged() -> None:
    assert evaluate_expectations(EXPECT, {"duration_ms": [303.0]}) == []
