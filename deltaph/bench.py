"""`deltaph bench`: the benchmarks of the README. What is compared is measured in turns, in one run on the machine at hand."""

from __future__ import annotations

import importlib
import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
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
from deltaph.scenario import Law, Limits, Scenario, parse_scenario, template
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
            contender.work()  # the caches are its own now, not those of the one before
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


def in_kernel(plan: Plan, *, joints_only: bool = False) -> Callable[[], float]:
    """What the kernel does for a plan and its setpoints: two calls, arguments at hand; not for the law `time_optimal`.

    Args:
        plan: with the task that is planned.
        joints_only: position, velocity and acceleration of the joints instead of whole setpoints.
    """
    grid = plan.grid()
    setpoints, struct = ffi.new("dph_setpoint[]", len(grid)), ffi.new("dph_plan *")
    task, times = ffi.addressof(plan._struct, "task"), ffi.from_buffer("double[]", grid)
    joints = [ffi.new("double[]", 3 * len(grid)) for _ in range(3)]

    def work() -> float:
        lib.dph_plan_make(plan.robot.struct, task, ffi.NULL, struct)
        if joints_only:
            lib.dph_plan_sample_joints(struct, len(grid), times, *joints)
        else:
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
        Contender("paper: there, joint position, velocity, acceleration only", in_kernel(Plan.of(scenario), joints_only=True)),
        Contender("paper_limited: plan", planned(replace(scenario.law, name="paper_limited"), limits)),
        Contender("time_optimal: velocity, acceleration", planned(optimal, replace(limits, joint_jerk=UNLIMITED))),
        Contender("time_optimal: velocity, acceleration, jerk", planned(optimal, limits)),
    ]


def _module(name: str) -> Any | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _toppra_instance(
    toppra: Any, arc_length: NDArray[np.float64], joints: NDArray[np.float64], limits: Limits
) -> tuple[Any, NDArray[np.float64]]:
    """Its solver on a spline through points of a path, 200 intervals."""
    constraint, algorithm = importlib.import_module("toppra.constraint"), importlib.import_module("toppra.algorithm")
    bounds = [np.array([[-b, b] for b in limit]) for limit in (limits.joint_velocity, limits.joint_acceleration)]
    constraints = [constraint.JointVelocityConstraint(bounds[0]), constraint.JointAccelerationConstraint(bounds[1])]
    grid = np.linspace(0.0, arc_length[-1], 201)
    path = toppra.SplineInterpolator(arc_length, joints)
    return algorithm.TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel"), grid


def _toppra(toppra: Any, arc_length: NDArray[np.float64], joints: NDArray[np.float64], limits: Limits) -> Contender:
    """Velocity and acceleration on the same path."""
    toppra.setup_logging("ERROR")

    def work() -> float:
        instance, grid = _toppra_instance(toppra, arc_length, joints, limits)
        _, speed, _ = instance.compute_parameterization(0, 0)
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


def _planned(plan: Plan, limits: Limits, name: str) -> Contender:
    """The kernel's time-optimal law on the task of a plan: path, solution, verification, alignment."""
    request = ffi.new("dph_task *", Plan(plan.robot, plan.task, replace(plan.law, name="time_optimal"), 0.0, limits)._struct.task)
    result, memory = ffi.new("dph_plan *"), ffi.new("double[]", -(-lib.dph_workspace_size() // 8))

    def work() -> float:
        lib.dph_plan_make(plan.robot.struct, request, ffi.cast("dph_workspace *", memory), result)
        return float(result.nominal_duration)

    return Contender(name, work)


def _stretch(path: Any, arc_length: NDArray[np.float64], step: float, limits: Limits, orders: int) -> float:
    """The factor on time that makes a motion along a path keep its limits of so many orders, by differences over `step` [s]."""
    theta = path(arc_length)
    bounds = (limits.joint_velocity, limits.joint_acceleration, limits.joint_jerk)[:orders]
    peaks = (np.abs(np.diff(theta, n=n, axis=0)).max(axis=0) / step**n / np.array(bound) for n, bound in enumerate(bounds, 1))
    return max(float(peak.max() ** (1.0 / n)) for n, peak in enumerate(peaks, 1))


FINE = 2e-5
"""Between the grid points of a peer its motion is looked at so often [s]."""


def _copp(copp: Any, path: Any, length: float, limits: Limits) -> tuple[Contender, Callable[[], float]]:
    """Velocity, acceleration and jerk on a path, 201 grid points; and the factor on time that keeps the limits in between.

    The path's derivatives are given to it, and not part of the time.
    """
    grid = np.linspace(0.0, length, 201)
    q = [np.ascontiguousarray(path(grid, order)) for order in range(4)]
    bounds = [np.tile(np.array(b), (len(grid), 1)) for b in (limits.joint_velocity, limits.joint_acceleration, limits.joint_jerk)]

    def profile() -> Any:
        robot = copp.Robot(3, capacity=len(grid))
        robot.append_s(grid)
        robot.set_q(q[0], q[1], q[2], 0, dddq=q[3])
        for add, bound in zip(
            (robot.add_velocity_limits, robot.add_acceleration_limits, robot.add_jerk_limits), bounds, strict=True
        ):
            add(bound, -bound, start_idx_s=0)
        second_order = copp.solver.topp2_ra
        first = second_order.solve(second_order.Problem(robot.constraints, (0, len(grid) - 1)))
        return copp.solver.topp3_lp.solve(copp.solver.topp3_lp.Problem(robot.constraints, first))

    def stretch() -> float:
        found = profile()
        duration, times = copp.interpolation.s_to_t_topp3(grid, found)
        fine = np.arange(0.0, duration, FINE)
        return _stretch(path, copp.interpolation.t_to_s_topp3_samples(grid, found, times, fine), FINE, limits, 3)

    return Contender(
        "copp-py: velocity, acceleration, jerk", lambda: float(copp.interpolation.s_to_t_topp3(grid, profile())[0]), True
    ), stretch


def _toppra_stretch(path: Any, toppra: Any, arc_length: NDArray[np.float64], joints: NDArray[np.float64], limits: Limits) -> float:
    """The factor on time that makes toppra's motion keep its limits between its grid points."""
    instance, grid = _toppra_instance(toppra, arc_length, joints, limits)
    _, speed, _ = instance.compute_parameterization(0, 0)
    b, inside = speed**2, np.linspace(0.0, 1.0, 11)
    s = (grid[:-1, None] + np.diff(grid)[:, None] * inside).ravel()
    speed2 = (b[:-1, None] + np.diff(b)[:, None] * inside).ravel()
    slope = np.repeat(0.5 * np.diff(b) / np.diff(grid), len(inside))
    velocity = np.abs(path(s, 1)).max(axis=1) * np.sqrt(speed2) / limits.joint_velocity[0]
    acceleration = np.abs(path(s, 2) * speed2[:, None] + path(s, 1) * slope[:, None]).max(axis=1) / limits.joint_acceleration[0]
    return max(float(velocity.max()), float(np.sqrt(acceleration.max())))


def compare_optima(name: str, plan: Plan, limits: Limits, console: Console, rounds: int = ROUNDS) -> None:
    """Time-optimal motions along the path of a plan, ours and the peers', in turns, each slowed down until it keeps the limits."""
    s = plan.sample(plan.grid(0.25))
    moving = np.append(True, np.diff(s["arc_length"]) > 1e-4 * plan.length)
    arc_length, joints = s["arc_length"][moving], s["joint_position"][moving]
    contenders = [
        _planned(plan, replace(limits, joint_jerk=UNLIMITED), "deltaph: velocity, acceleration"),
        _planned(plan, limits, "deltaph: velocity, acceleration, jerk"),
    ]
    stretches: list[float] = [1.0, 1.0]  # by construction
    interpolate = _module("scipy.interpolate")
    path = interpolate.make_interp_spline(arc_length, joints, k=5) if interpolate is not None else None
    if path is not None and (toppra := _module("toppra")) is not None:
        contenders.append(_toppra(toppra, arc_length, joints, limits))
        stretches.append(_toppra_stretch(path, toppra, arc_length, joints, limits))
    if path is not None and (copp := _module("copp_py")) is not None:
        contender, stretch = _copp(copp, path, float(arc_length[-1]), limits)
        contenders.append(contender)
        stretches.append(stretch())
    if (ruckig := _module("ruckig")) is not None:
        contenders.append(_ruckig(ruckig, joints, limits))
        stretches.append(1.0)
    timings = in_turns(contenders, rounds)
    ours = {t.contender.name.partition(": ")[2]: t.median_us for t in timings if not t.contender.peer}
    table = Table(name, "median (us)", "motion (ms)", "within limits (ms)", "times ours", box=None, pad_edge=False)
    for t, factor in zip(timings, stretches, strict=True):
        base = ours.get(t.contender.name.partition(": ")[2]) if t.contender.peer else None
        feasible = 1e3 * t.duration * max(factor, 1.0)
        ratio = f"{t.median_us / base:.0f}" if base is not None else ""
        table.add_row(t.contender.name, f"{t.median_us:.1f}", f"{1e3 * t.duration:.2f}", f"{feasible:.2f}", ratio)
    console.print(table)


def run_benchmarks(scenario: Scenario, console: Console) -> None:
    """Measure and print: planning, peers, steps of both FMUs, real-time factor."""
    paper = Plan.of(scenario)
    limits = papers_peaks(paper)
    table = Table("one PPO, measured in turns", "median (us)", "motion (ms)", box=None, pad_edge=False)
    for t in in_turns(_own(scenario, limits)):
        table.add_row(t.contender.name, f"{t.median_us:.1f}", f"{1e3 * t.duration:.2f}")
    console.print(table)
    compare_optima("time-optimal on the paper's path, in turns", paper, limits, console)
    cycle = parse_scenario(template("cycle_25_305_25"), Path("cycle_25_305_25.toml"))
    compare_optima("25 / 305 / 25 mm", Plan.of(cycle), cycle.limits, console)
    missing = [
        name for name, module in (("toppra", "toppra"), ("ruckig", "ruckig"), ("copp-py", "copp_py")) if _module(module) is None
    ]
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
