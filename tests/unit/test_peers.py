"""Durations of the time-optimal law against other people's solvers on the same path."""

import math

import numpy as np
import pytest
from property.random_tasks import PAPERS_PEAKS, TIME_OPTIMAL, limits_of, random_tasks

from deltaph import bench
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import Limits, Task

interpolate = pytest.importorskip("scipy.interpolate", reason="needs scipy: pip install 'deltaph[bench]'")

ROBOT = Robot.default()
PAPERS_TASK = Task((-0.1525, 0.0, -0.8), (0.1525, 0.0, -0.8), (0.05, 0.05), (0.006, 0.006))
WITHOUT_JERK = limits_of(4.4227, 241.365, math.inf)
TASKS = [PAPERS_TASK, *random_tasks(5, seed=2)]


def on_the_path(task: Task, limits: Limits) -> tuple[Plan, np.ndarray, np.ndarray]:
    """A plan, and its path as arc lengths (n) and joint positions (n, 3)."""
    plan = Plan(ROBOT, task, TIME_OPTIMAL, 0.0, limits)
    s = plan.sample(plan.grid(0.25))
    moving = np.append(True, np.diff(s["arc_length"]) > 1e-4 * plan.length)
    return plan, s["arc_length"][moving], s["joint_position"][moving]


@pytest.mark.parametrize("task", TASKS)
def test_velocity_and_acceleration_against_toppra(task: Task) -> None:
    """Its acceleration jumps, ours does not; its limits hold at 201 points, between them it goes beyond by up to some per cent."""
    toppra = pytest.importorskip("toppra", reason="toppra is not installed")
    plan, arc_length, joints = on_the_path(task, WITHOUT_JERK)
    duration = bench._toppra(toppra, arc_length, joints, WITHOUT_JERK).work()
    assert 0.98 * duration <= plan.nominal_duration <= 1.02 * duration


@pytest.mark.parametrize("task", TASKS)
def test_velocity_acceleration_and_jerk_against_copp(task: Task) -> None:
    """It linearizes jerk once, and rests for its first and last interval: it is slower by some per cent."""
    copp = pytest.importorskip("copp_py", reason="copp-py is not installed")
    plan, arc_length, joints = on_the_path(task, PAPERS_PEAKS)
    path = interpolate.make_interp_spline(arc_length, joints, k=5)
    contender, stretch = bench._copp(copp, path, float(arc_length[-1]), PAPERS_PEAKS)
    duration = contender.work()
    assert 0.95 * duration <= plan.nominal_duration <= 1.01 * duration
    assert plan.nominal_duration <= duration * stretch()
