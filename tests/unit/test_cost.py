"""The paper's claims on cost: what is counted, against counts made with 50 digits; what is timed is timed."""

from pathlib import Path

from deltaph.cost import corner_times, cost_claims, kernels_steps, papers_iterations
from deltaph.plan import Plan
from deltaph.scenario import parse_scenario, template

SCENARIO = parse_scenario(template(), Path("paper.toml"))


def test_iterations_are_the_paper_s_one_or_two() -> None:
    coarse, fine = papers_iterations(Plan.of(SCENARIO))
    assert coarse == [1] * 61  # all 61 setpoints of the corner: 0.012 um after one update, 24 um before
    assert fine == [2] * 61


def test_the_kernel_takes_one_step_a_setpoint() -> None:
    plan = Plan.of(SCENARIO)
    assert kernels_steps(plan) == [1] * len(corner_times(plan))


def test_claims_are_measured() -> None:
    claims = {claim.claim.split(",")[0]: claim for claim in cost_claims(SCENARIO)}
    assert len(claims) == 4
    assert "304 setpoints" in claims["time to plan one PPO"].measured
    assert "1/1/1 with the paper's predictor" in claims["Newton iterations per setpoint in a corner"].measured
    assert claims["Newton iterations per setpoint in a corner"].verdict == "holds"
