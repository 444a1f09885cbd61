"""What the paper says of the cost of its method, measured: one PPO, Newton's iterations, symmetry, corners used again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deltaph.bench import Contender, in_kernel, in_turns
from deltaph.claims import Claim
from deltaph.kernel import ffi, lib
from deltaph.plan import Plan
from deltaph.scenario import Scenario

FloatArray = NDArray[np.float64]

PAPER_US = 207.0
"""The paper's own time for one PPO at 1 kHz, positions only, on a 2.13 GHz processor."""

STEP = 1e-3
"""Sampling interval of the paper [s]."""

ROBOTS_ACCURACY = 1e-6
"""Finer than any Delta robot is [m]."""

ROUNDING = 1e-12
"""Of the curve parameter: where an iteration has nothing left to gain that a setpoint would show."""

ROUNDS = 500

SLIGHTLY = 1.0 + 1e-9
"""A deviation so many times as large makes another corner of next to the same shape."""


def _planned(plan: Plan) -> Callable[[], float]:
    """What the kernel does to plan."""
    struct, task = ffi.new("dph_plan *"), ffi.addressof(plan._struct, "task")

    def work() -> float:
        lib.dph_plan_make(plan.robot.struct, task, ffi.NULL, struct)
        return 0.0

    return work


def corner_times(plan: Plan) -> FloatArray:
    """Nominal times of the setpoints in the pick corner, from its start (n) [s]."""
    begin, end = plan._struct.boundary[1], plan._struct.boundary[2]
    nominal = plan.grid() * plan.speed_factor
    return np.asarray(nominal[(nominal > begin) & (nominal < end)] - begin)


def _inverted(plan: Plan, time: FloatArray) -> Callable[[], float]:
    """What the kernel does to find curve parameters at times (n)."""
    law, gamma, times = (
        ffi.addressof(plan._struct.side[0], "corner"),
        ffi.new("double[]", len(time)),
        ffi.from_buffer("double[]", time),
    )

    def work() -> float:
        lib.dph_corner_law_gamma(law, len(time), times, gamma, ffi.NULL)
        return 0.0

    return work


def kernels_steps(plan: Plan) -> list[int]:
    """How many steps of its iteration the kernel takes for each setpoint in a corner."""
    time = corner_times(plan)
    steps, gamma = ffi.new("int[]", len(time)), ffi.new("double[]", len(time))
    lib.dph_corner_law_gamma(
        ffi.addressof(plan._struct.side[0], "corner"), len(time), ffi.from_buffer("double[]", time), gamma, steps
    )
    return list(steps)


def papers_iterations(plan: Plan) -> tuple[list[int], list[int]]:
    """Eq. (27) with its predictor, one setpoint after the other from the corner's start, as the paper has it.

    Returns:
        iterations of each setpoint until the position is right to ROBOTS_ACCURACY, and until gamma is to ROUNDING.
    """
    entry, mid, _ = plan.speeds
    scale = 30.0 * plan.corner_legs[0][0] / (6.0 + math.sqrt(2.0))  # 2 u_2^2, eq. (12)
    nodes, weights = np.polynomial.legendre.leggauss(32)

    def sigma(gamma: FloatArray | float) -> FloatArray | float:
        """Eq. (18)."""
        s = gamma * (1.0 - gamma)
        return scale * (1.0 - 4.0 * s + (2.0 + math.sqrt(2.0)) * s * s)

    def rate(gamma: FloatArray | float) -> FloatArray | float:
        """Eq. (17): dgamma/dt with the speed of eq. (16)."""
        return (entry - 16.0 * (entry - mid) * (gamma * (1.0 - gamma)) ** 2) / sigma(gamma)

    def time_at(gamma: float) -> float:
        """Eq. (20)."""
        return float(0.5 * gamma * np.sum(weights / rate(0.5 * gamma * (nodes + 1.0))))

    coarse, fine, before = [], [], 0.0
    for i in range(1, int(time_at(1.0) / STEP) + 1):
        iterates = [before + float(rate(before)) * STEP]
        for _ in range(6):  # quadratic convergence: the last ones are exact
            iterates.append(iterates[-1] - (time_at(iterates[-1]) - i * STEP) * float(rate(iterates[-1])))
        before = iterates[-1]
        errors = [abs(gamma - before) for gamma in iterates]
        coarse.append(next(k for k, e in enumerate(errors) if e * float(sigma(before)) <= ROBOTS_ACCURACY))
        fine.append(next(k for k, e in enumerate(errors) if e <= ROUNDING))
    return coarse, fine


def _counts(counts: list[int]) -> str:
    return "/".join(f"{x:g}" for x in (min(counts), float(np.median(counts)), max(counts)))


def cost_claims(scenario: Scenario) -> list[Claim]:
    """The claims on cost, measured on this machine with a scenario of the paper's law."""
    plan = Plan.of(scenario)
    deviation = scenario.task.corner_deviation
    task = replace(scenario.task, corner_deviation=(deviation[0], deviation[1] * SLIGHTLY))
    unequal = Plan(scenario.robot, task, scenario.law, scenario.declared_payload, scenario.limits)
    time = corner_times(plan)

    def through_python() -> float:
        planned = Plan.of(scenario)
        planned.sample(planned.grid())
        return planned.nominal_duration

    works = (
        in_kernel(plan),
        in_kernel(plan, joints_only=True),
        through_python,
        _planned(plan),
        _planned(unequal),
        *(_inverted(plan, np.tile(time, n)) for n in (1, 2)),
    )
    timings = in_turns([Contender("", work) for work in works], ROUNDS)
    ppo, joints, python, equal, both, one_corner, two_corners = (timing.median_us for timing in timings)
    (coarse, fine), steps = papers_iterations(plan), kernels_steps(plan)
    mirrored, again = two_corners - one_corner, both - equal
    return [
        Claim(
            "time to plan one PPO",
            f"{PAPER_US / 1000.0:g} ms (positions, 2.13 GHz)",
            f"{ppo / 1000.0:.3f} ms in the kernel for {len(plan.grid())} setpoints with joint positions, velocities, accelerations "
            f"and torques ({equal:.1f} us of it planning; {joints / 1000.0:.3f} ms without torques and tool), "
            f"{python / 1000.0:.3f} ms from Python; medians, on this machine",
            f"holds: {PAPER_US / ppo:.1f} times as fast" if ppo < PAPER_US else "not reached on this machine",
            f"{ppo / 1000.0:.3f} ms",
        ),
        Claim(
            "Newton iterations per setpoint in a corner, eq. (27)",
            "1 or 2",
            f"least/median/most: {_counts(coarse)} with the paper's predictor until the position is right to 1 um, {_counts(fine)} "
            f"until gamma is to 1e-12; the kernel, which needs no neighbour and goes on to rounding, {_counts(steps)} of third "
            "order",
            "holds" if max(coarse + fine) <= 2 else "wrong",
            f"at most {max(coarse + fine)}",
        ),
        Claim(
            "symmetry saves time",
            "yes, by direct transformation",
            f"curve parameters of one corner {one_corner:.1f} us, of both {two_corners:.1f} us ({two_corners / one_corner:.1f} "
            f"times): the mirror image would save {mirrored:.1f} of {ppo:.1f} us",
            f"{100.0 * mirrored / ppo:.0f} % of a PPO: joints are not symmetric, and most of the time is theirs",
            f"{100.0 * mirrored / ppo:.0f} % of a PPO",
        ),
        Claim(
            "the same deviation has the same corner: not solved again",
            "saves time",
            f"planning with equal corners {equal:.2f} us, with two to be solved {both:.2f} us ({both / equal:.2f} times)",
            f"holds, for {100.0 * again / ppo:.1f} % of a PPO",
            f"{100.0 * again / ppo:.1f} % of a PPO",
        ),
    ]
