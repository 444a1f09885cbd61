"""Planning in slices: the same bits as in one go, wherever it is interrupted, and goes on from a copy of its bytes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from property.random_tasks import random_tasks

from deltaph.kernel import enumeration, ffi, lib
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import load_scenario

SCENARIOS = Path(__file__).parents[2] / "scenarios"
ROBOT = Robot.default()
STATUS = enumeration("dph_status")


def request(scenario: str, **values: Any) -> Any:
    """The task of a scenario with other values."""
    task = ffi.new("dph_task *", Plan.of(load_scenario(SCENARIOS / f"{scenario}.toml"))._struct.task)
    for name, value in values.items():
        setattr(task, name, value)
    return task


def memory() -> Any:
    return ffi.new("double[]", -(-lib.dph_workspace_size() // 8))


def facts(verdict: Any) -> tuple[Any, ...]:
    return STATUS[verdict.status], verdict.phase, verdict.joint, verdict.required, verdict.available


def in_one_go(task: Any) -> tuple[tuple[Any, ...], bytes]:
    workspace, plan = memory(), ffi.new("dph_plan *")  # a cast does not keep its memory
    verdict = lib.dph_plan_make(ROBOT.struct, task, ffi.cast("dph_workspace *", workspace), plan)
    return facts(verdict), bytes(ffi.buffer(plan))


def in_slices(task: Any, units: int, *, elsewhere: bool = False) -> tuple[tuple[Any, ...], bytes, int]:
    """Verdict, plan and number of slices; `elsewhere`: each slice goes on from a copy of the bytes in other memory."""
    workspace, plan = memory(), ffi.new("dph_plan *")
    verdict = lib.dph_plan_begin(ROBOT.struct, task, ffi.cast("dph_workspace *", workspace), plan)
    slices = 0
    while verdict.status == lib.DPH_STATUS_PLANNING:
        if elsewhere:
            old = bytes(ffi.buffer(workspace)), bytes(ffi.buffer(plan))
            workspace, plan = memory(), ffi.new("dph_plan *")
            ffi.buffer(workspace)[:], ffi.buffer(plan)[:] = old
        verdict = lib.dph_plan_continue(ffi.cast("dph_workspace *", workspace), plan, units)
        slices += 1
        assert slices < 100_000
    return facts(verdict), bytes(ffi.buffer(plan)), slices


NO_LIMITS = {f"joint_{quantity}": [1e30] * 3 for quantity in ("velocity", "acceleration", "jerk", "torque")} | {"tcp_speed": 1e30}

CASES = {
    "paper": request("paper"),
    "comparison": request("comparison"),
    "paper_limited": request("paper_limited"),
    "time_optimal": request("time_optimal"),
    "with torque": request("torque_limit"),
    "sharp corners": request("time_optimal_1mm"),
    "no lift": request("zero_lift"),
    "out of reach": request("paper", place=[2.0, 0.0, -0.8]),
    "no limit to go by": request("time_optimal", limits=NO_LIMITS),
    "not level": request("time_optimal", lift=[0.05, 0.06]),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("units", [1, 100, lib.DPH_SLICE, 10_000])
def test_slices_give_the_bits_of_one_go(name: str, units: int) -> None:
    assert in_slices(CASES[name], units)[:2] == in_one_go(CASES[name])


@pytest.mark.parametrize("name", ["paper", "paper_limited", "time_optimal"])
def test_planning_goes_on_from_a_copy_of_its_bytes(name: str) -> None:
    assert in_slices(CASES[name], lib.DPH_SLICE, elsewhere=True)[:2] == in_one_go(CASES[name])


@pytest.mark.parametrize("law", ["paper_limited", "time_optimal"])
def test_random_tasks_in_random_slices(law: str) -> None:
    random = np.random.default_rng(5)
    for task in random_tasks(20, seed=5):
        wanted = request(law, pick=task.pick, place=task.place, lift=task.lift, corner_deviation=task.corner_deviation)
        assert in_slices(wanted, int(random.integers(1, 2000)))[:2] == in_one_go(wanted)


@pytest.mark.parametrize("name", ["paper", "comparison", "paper_limited", "time_optimal", "torque_limit"])
def test_a_plan_knows_how_many_slices_it_took(name: str) -> None:
    scenario = load_scenario(SCENARIOS / f"{name}.toml")
    asked = {speed: getattr(scenario.law, speed) for speed in ("corner_entry_speed", "corner_mid_speed", "traverse_speed")}
    _, bits, slices = in_slices(request(name, **asked), lib.DPH_SLICE)  # a plan's own task has the speeds that were found
    plan = Plan.of(scenario)
    assert plan.slices == slices
    assert bytes(ffi.buffer(plan._struct)) == bits


def test_a_paper_plan_takes_one_slice() -> None:
    assert in_slices(CASES["paper"], lib.DPH_SLICE)[2] == 1


@pytest.mark.parametrize(("law", "least", "most"), [("time_optimal", 4, 15), ("paper_limited", 10, 40)])
def test_slower_laws_take_several_slices(law: str, least: int, most: int) -> None:
    assert least <= in_slices(CASES[law], lib.DPH_SLICE)[2] <= most
