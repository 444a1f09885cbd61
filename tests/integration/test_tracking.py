"""Drives against figures of a separate simulation: tracking errors within a factor of 1.5, and in the same order."""

from pathlib import Path

import pytest

from deltaph.execution import Execution, Trace, evaluate
from deltaph.fmu import cached_fmus
from deltaph.importer import cosimulate
from deltaph.scenario import parse_scenario, template
from deltaph.schedule import schedule

PAPER = template()
COMPARISON = PAPER.replace('name = "paper"', 'name = "comparison"')
TUNED, FACTORY = 'gains = "tuned"', 'gains = "factory"'
LIGHT, LOADED, UNKNOWN = "mass_kg = 0.0", "mass_kg = 1.0", "mass_kg = 1.0\ndeclared_mass_kg = 0.0"
LIMITED = "\n[[fault]]\ntime_ms = 0.0\ntorque_limit_Nm = 2.0\n"

# scenario, largest tracking error of a joint [mrad] and of the tool centre point [mm] there
FIGURES: dict[str, tuple[str, float, float]] = {
    "comparison, factory gains": (COMPARISON.replace(TUNED, FACTORY), 59.7, 31.8),
    "factory gains": (PAPER.replace(TUNED, FACTORY), 58.9, 31.1),
    "torque limited to 2 N m, 1 kg": (PAPER.replace(LIGHT, LOADED) + LIMITED, 31.8, 13.0),
    "factory gains, velocity fed forward": (PAPER.replace(TUNED, FACTORY + "\nvelocity_feedforward = 1.0"), 12.1, 4.2),
    "no torque fed forward": (PAPER.replace(TUNED, TUNED + "\ntorque_feedforward = 0.0"), 1.22, 0.42),
    "1 kg unknown": (PAPER.replace(LIGHT, UNKNOWN), 0.461, 0.240),
    "comparison, 1 kg unknown": (COMPARISON.replace(LIGHT, UNKNOWN), 0.35, 0.14),
    "tuned": (PAPER, 0.222, 0.080),
    "comparison": (COMPARISON, 0.086, 0.028),
}


def executed(text: str) -> Execution:
    scenario = parse_scenario(text, Path("tracking.toml"))
    run = schedule(scenario)
    return evaluate(Trace(list(cosimulate(scenario, run, cached_fmus()))), run)


def test_tracking_errors_are_those_of_the_separate_simulation() -> None:
    errors = []
    for name, (text, joint, tcp) in FIGURES.items():
        execution = executed(text)
        assert execution.trip == "none", name
        found = 1e3 * execution.tracking_error_joint_max, 1e3 * execution.tracking_error_tcp_max
        assert joint / 1.5 < found[0] < joint * 1.5, name
        assert tcp / 1.5 < found[1] < tcp * 1.5, name
        errors.append(found[1])
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize(("payload", "peak", "rms"), [(LIGHT, 2.73, 0.92), (LOADED, 3.75, 1.37)], ids=["0 kg", "1 kg"])
def test_motor_torques_of_the_papers_case(payload: str, peak: float, rms: float) -> None:
    # the figures are those of the ideal torque on the nominal clock; the controlled motor overshoots them a little
    execution = executed(PAPER.replace(LIGHT, payload))
    assert max(execution.motor_torque_max) == pytest.approx(peak, rel=0.05)
    assert max(execution.motor_torque_rms) == pytest.approx(rms, rel=0.02)
