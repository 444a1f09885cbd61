"""The rest before the motion: how it is rounded, what is refused, and what the plan says then."""

import math
from pathlib import Path

import pytest

from deltaph.kernel import enumeration, ffi, lib, sentence
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import load_scenario

PAPER = Plan.of(load_scenario(Path(__file__).parents[2] / "scenarios" / "paper.toml"))
ROBOT = Robot.default()


def planned(dwell: float) -> tuple[str, str, object]:
    """Status, sentence and plan of the paper's task with a dwell [s]."""
    task = ffi.new("dph_task *", PAPER._struct.task)
    task.dwell = dwell
    plan = ffi.new("dph_plan *")
    verdict = lib.dph_plan_make(ROBOT.struct, task, ffi.NULL, plan)
    return enumeration("dph_status")[verdict.status], sentence(verdict), plan


@pytest.mark.parametrize(("dwell", "ms"), [(0.0, 0), (1e-6, 1), (1e-3, 1), (0.05, 50), (0.0501, 51), (3600.0, 3_600_000)])
def test_it_is_rounded_up_to_whole_milliseconds(dwell: float, ms: int) -> None:
    status, _, plan = planned(dwell)
    assert (status, plan.dwell_ms, plan.duration_ms) == ("ok", ms, 303)


def test_every_whole_millisecond_is_itself() -> None:
    assert [planned(ms / 1e3)[2].dwell_ms for ms in range(0, 3_600_000, 7919)] == list(range(0, 3_600_000, 7919))


@pytest.mark.parametrize(
    ("dwell", "said"),
    [
        (-1e-3, "the task has the value -0.001 where one of at least 0 is needed"),
        (3600.5, "the task has the value 3600.5 where one of at most 3600 is needed"),
        (math.inf, "the task has the value inf where one of at most 3600 is needed"),
        (math.nan, "the task has the value nan where one of at least 0 is needed"),
    ],
)
def test_what_is_no_dwell_is_refused(dwell: float, said: str) -> None:
    assert planned(dwell)[:2] == ("invalid_value", said)


def test_before_the_motion_the_robot_rests_at_the_pick_point() -> None:
    plan = planned(0.05)[2]
    times = [-0.051, -0.05, -0.001, -1e-9, 0.0]
    setpoints = [ffi.new("dph_setpoint *") for _ in times]
    for time, setpoint in zip(times, setpoints, strict=True):
        lib.dph_plan_sample(plan, time, setpoint)
    phases = [enumeration("dph_phase")[s.phase] for s in setpoints]
    assert phases == ["idle", "dwell", "dwell", "dwell", "lift"]
    for setpoint in setpoints:
        assert list(setpoint.tcp_position) == list(plan.task.pick)
        assert list(setpoint.joint_velocity) == list(setpoint.joint_acceleration) == [0.0, 0.0, 0.0]
        assert (setpoint.arc_length, setpoint.length) == (0.0, plan.length)
        assert setpoint.vertex_distance == plan.task.lift[0]
