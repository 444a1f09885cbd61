"""`deltaph bench`: the benchmarks of the README. What is compared is measured in turns, in one run on the machine at hand."""

from __future__ import annotations

import importlib
import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from deltaph.execution import Trace
from deltaph.fmu import cached_fmus
from deltaph.importer import cosimulate
from deltaph.kernel import ffi, lib
from deltaph.plan import Plan
from deltaph.scenario import Law, Limits, Scenario
from deltaph.schedule import schedule

ROUNDS = 50
CYCLES = 20

UNLIMITED = (float("inf"),) * 3


@dataclass(frozen=True, slots=True)
class Contender:
    """Something to be timed.

    Attributes:
        name: what it does.
        work: does it; returns the duration of the motion it found [s].
        peer: somebody else's.
    """

    name: str
    work: Callable[[], float]
    peer: bool = False


@dataclass(frozen=True, slots=True)
class Timing:
    """Median of a contender's times [us], and the duration of its motion [s]."""

    contender: Contender
    median_us: float
    duration: float


def in_turns(contenders: Iterable[Contender], rounds: int = ROUNDS) -> list[Timing]:
    """Time contenders one after the other, again and again, so that all of them meet the same machine."""
    entries = [(contender, contender.work(), list[float]()) for contender in contenders]  # the first call warms up
    for _ in range(rounds):
        for contender, _, times in entries:
            begin = time.perf_counter()
            contender.work()
            times.append(time.perf_counter() - begin)
    return [Timing(contender, 1e6 * statistics.median(times), duration) for contender, duration, times in entries]


def papers_peaks(plan: Plan) -> Limits:
    """The peaks of a plan as limits: of each quantity the greatest of the three joints, on the nominal clock."""
    velocity, acceleration, jerk = (
        (max(getattr(plan.peaks, f"joint_{what}")) / plan.speed_factor**order,) * 3
        for order, what in enumerate(("velocity", "acceleration", "jerk"), 1)
    )
    return Limits(velocity, acceleration, jerk, UNLIMITED, float("inf"))


def in_kernel(plan: Plan) -> Callable[[], float]:
    """What the kernel does for a plan and its setpoints: two calls, arguments at hand; not for the law `time_optimal`."""
    grid = plan.grid()
    setpoints, struct = ffi.new("dph_setpoint[]", len(grid)), ffi.new("dph_plan *")
    task, times = ffi.addressof(plan._struct, "task"), ffi.from_buffer("double[]", grid)

    def work() -> float:
        lib.dph_plan_make(plan.robot.struct, task, ffi.NULL, struct)
        lib.dph_plan_sample_array(struct, len(grid), times, setpoints)
        return float(struct.nominal_duration)

    return work


def _own(scenario: Scenario, limits: Limits) -> list[Contender]:
    def planned(law: Law, limits: Limits) -> Callable[[], float]:
        return lambda: Plan(scenario.robot, scenario.task, law, scenario.payload, limits).nominal_duration

    def sampled(count: int) -> float:
        plan = Plan.of(scenario)
        plan.sample(grid[:count])
        return plan.nominal_duration

    grid = Plan.of(scenario).grid()
    optimal = replace(scenario.law, name="time_optimal")
    return [
        Contender("paper: plan", planned(scenario.law, limits)),
        Contender(f"paper: plan and {len(grid)} setpoints with joints and torques", lambda: sampled(len(grid))),
        Contender("paper: the same in the kernel alone", in_kernel(Plan.of(scenario))),
        Contender("paper_limited: plan", planned(replace(scenario.law, name="paper_limited"), limits)),
        Contender("time_optimal: velocity, acceleration", planned(optimal, replace(limits, joint_jerk=UNLIMITED))),
        Contender("time_optimal: velocity, acceleration, jerk", planned(optimal, limits)),
    ]


def _module(name: str) -> Any | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _toppra(toppra: Any, arc_length: NDArray[np.float64], joints: NDArray[np.float64], limits: Limits) -> Contender:
    """Velocity and acceleration on the same path, a spline through its points, 200 intervals."""
    toppra.setup_logging("ERROR")
    constraint, algorithm = importlib.import_module("toppra.constraint"), importlib.import_module("toppra.algorithm")
    bounds = [np.array([[-b, b] for b in limit]) for limit in (limits.joint_velocity, limits.joint_acceleration)]
    constraints = [constraint.JointVelocityConstraint(bounds[0]), constraint.JointAccelerationConstraint(bounds[1])]
    grid = np.linspace(0.0, arc_length[-1], 201)

    def work() -> float:
        path = toppra.SplineInterpolator(arc_length, joints)
        _, speed, _ = algorithm.TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel").compute_parameterization(0, 0)
        return float(np.sum(2.0 * np.diff(grid) / (speed[1:] + speed[:-1])))

    return Contender("toppra: velocity, acceleration", work, peer=True)


def _ruckig(ruckig: Any, joints: NDArray[np.float64], limits: Limits) -> Contender:
    """Rest to rest in joint space: neither path nor deviation."""
    otg, request, trajectory = ruckig.Ruckig(3), ruckig.InputParameter(3), ruckig.Trajectory(3)
    request.current_position, request.target_position = joints[0].tolist(), joints[-1].tolist()
    request.max_velocity, request.max_acceleration = list(limits.joint_velocity), list(limits.joint_acceleration)
    request.max_jerk = list(limits.joint_jerk)

    def work() -> float:
        otg.calculate(request, trajectory)
        return float(trajectory.duration)

    return Contender("ruckig: end to end, without the path", work, peer=True)


def peers(plan: Plan, limits: Limits) -> list[Contender]:
    """The peers that are installed, on the path of a plan."""
    s = plan.sample(plan.grid())
    moving = np.append(True, np.diff(s["arc_length"]) > 1e-4 * plan.length)
    moving[-1] = True
    found = []
    if (toppra := _module("toppra")) is not None:
        found.append(_toppra(toppra, s["arc_length"][moving], s["joint_position"][moving], limits))
    if (ruckig := _module("ruckig")) is not None:
        found.append(_ruckig(ruckig, s["joint_position"], limits))
    return found


def run_benchmarks(scenario: Scenario, console: Console) -> None:
    """Measure and print: planning, peers, steps of both FMUs, real-time factor."""
    paper = Plan.of(scenario)
    limits = papers_peaks(paper)
    timings = in_turns([*_own(scenario, limits), *peers(paper, limits)])
    table = Table("one PPO, measured in turns", "median (us)", "motion (ms)", "times ours", box=None, pad_edge=False)
    ours = {t.contender.name.partition(": ")[2]: t.median_us for t in timings if not t.contender.peer}
    for t in timings:
        base = ours.get(t.contender.name.partition(": ")[2]) if t.contender.peer else None
        ratio = f"{t.median_us / base:.0f}" if base is not None else ""
        table.add_row(t.contender.name, f"{t.median_us:.1f}", f"{1e3 * t.duration:.2f}", ratio)
    console.print(table)
    missing = [name for name in ("toppra", "ruckig") if _module(name) is None]
    if missing:
        console.print(f"not installed: {', '.join(missing)} (pip install 'deltaph[bench]')", markup=False)

    run, fmus = schedule(scenario, CYCLES), cached_fmus()
    list(cosimulate(scenario, schedule(scenario), fmus))  # warms up
    trace = Trace(list(cosimulate(scenario, run, fmus)))
    steps = Table("step of 1 ms", "median (us)", box=None, pad_edge=False)
    for name in ("planner", "plant"):
        steps.add_row(name, f"{1e6 * statistics.median(trace.timing_of(f'{name}_step')[1:]):.1f}")
    console.print(steps)
    console.print(f"co-simulation, {run.steps} steps: {trace.timing_of('real_time_factor')[-1]:.1f} times faster than real time")
