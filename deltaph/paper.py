"""`deltaph paper`: section 4 of the paper, its figures and its claims, planned and co-simulated anew each time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltaph.claims import Claim
from deltaph.cost import cost_claims
from deltaph.execution import Execution, Trace, evaluate
from deltaph.files import replace as replace_file
from deltaph.fmu import cached_fmus
from deltaph.importer import cosimulate
from deltaph.plan import Plan
from deltaph.scenario import Scenario, Task, parse_scenario, template
from deltaph.schedule import schedule
from deltaph.telemetry.figures import Method, write_figures

FloatArray = NDArray[np.float64]

ROTATION = 37.0
"""Of the task about the base's axis, to show that the deviation does not depend on it [deg]."""

PLOTTED = 0.25e-3
"""Between two points of the planned curves [s]."""

SIMILAR = 0.1
"""How far two peaks may lie apart to be called similar: what a drive's sizing would not notice."""

WELL = 0.02
"""How far executed joint speeds may be from planned ones to match well, in parts of their peak."""


@dataclass(frozen=True, slots=True)
class _Done:
    """A method, planned and executed."""

    scenario: Scenario
    plan: Plan
    trace: Trace
    execution: Execution


def _execute(scenario: Scenario) -> _Done:
    run = schedule(scenario)
    trace = Trace(list(cosimulate(scenario, run, cached_fmus())))
    return _Done(scenario, run.operations[0].plan, trace, evaluate(trace, run))


def section_4(output: Path) -> dict[str, Any]:
    """Plan and co-simulate both methods, write the recording.

    Args:
        output: recording to write.

    Returns:
        the claims, and the figures they rest on.
    """
    paper = parse_scenario(template(), Path("paper.toml"))
    superposed = replace(paper, title="Motion superposition", law=replace(paper.law, name="comparison"))
    at_equal = replace(superposed, law=replace(superposed.law, overlap=_overlap(superposed, paper.task.corner_deviation[0])))
    proposed, comparison, equal = (_execute(scenario) for scenario in (paper, superposed, at_equal))
    claims = _claims(proposed, comparison, equal)
    methods = (_method("proposed", proposed), _method("comparison", comparison))
    markdown = _markdown(claims)
    replace_file(output, lambda path: write_figures(path, methods, markdown))
    return {"claims": [asdict(claim) for claim in claims], "overlap_at_equal_deviation": at_equal.law.overlap}


def _deviation(scenario: Scenario, overlap: float, speed: float = 1.0) -> float:
    """Of the comparison method at an overlap, its vertical speed multiplied by `speed` [m]."""
    law = replace(scenario.law, overlap=overlap, corner_entry_speed=speed * scenario.law.corner_entry_speed)
    return Plan.of(replace(scenario, law=law)).corner_deviation[0]


def _overlap(scenario: Scenario, deviation: float) -> float:
    """The overlap at which the comparison method has this deviation, which grows with it; by bisection."""
    low, high = 0.0, 1.0
    while high - low > 1e-12:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _deviation(scenario, middle) < deviation else (low, middle)
    return low


def _rotated(task: Task) -> Task:
    """The task turned about the base's axis."""
    c, s = np.cos(np.radians(ROTATION)), np.sin(np.radians(ROTATION))
    pick, place = ((c * x - s * y, s * x + c * y, z) for x, y, z in (task.pick, task.place))
    return replace(task, pick=pick, place=place)


def _read_literally(plan: Plan) -> float:
    """Eq. (31) as printed: x_w, y_w, z_h count from the pick point, H is a point of the base frame [m]."""
    from_pick = plan.sample(plan.grid(0.01))["tcp_position"] - np.array(plan.task.pick)
    return float(np.linalg.norm(from_pick - plan.vertices[0], axis=1).min())


def _claims(proposed: _Done, comparison: _Done, equal: _Done) -> list[Claim]:
    p, c, e = proposed.plan, comparison.plan, equal.plan
    rotated = [
        Plan(d.scenario.robot, _rotated(d.scenario.task), d.scenario.law).corner_deviation[0] for d in (proposed, comparison)
    ]
    overlaps = [1e3 * _deviation(comparison.scenario, overlap) for overlap in (0.25, 0.5, 0.75)]
    speeds = [1e3 * _deviation(comparison.scenario, 0.5, speed) for speed in (0.5, 1.0, 1.5)]
    torque, acceleration, motor = (
        [max(get(d)) for d in (proposed, comparison, equal)]
        for get in (
            lambda d: d.plan.peaks.joint_torque,
            lambda d: (d.plan.peaks.tcp_acceleration,),
            lambda d: d.execution.motor_torque_max,
        )
    )
    apart = [d.trace["plant", "joint_velocity"] - d.trace["planner", "joint_velocity"] for d in (proposed, comparison)]
    speed_error = max(float(np.abs(difference).max()) for difference in apart)

    def more(values: list[float], other: int) -> str:
        return f"{100.0 * (values[0] / values[other] - 1.0):+.0f} %"

    return [
        Claim(
            "deviation, proposed method",
            "6 mm",
            f"planned {1e3 * p.corner_deviation[0]:.4f} mm, rotated by {ROTATION:g}° {1e3 * rotated[0]:.4f} mm, "
            f"executed {_pair(proposed)} mm",
            _word(_near([*p.corner_deviation, rotated[0]], 6e-3)),
            f"{1e3 * p.corner_deviation[0]:.4f} mm",
        ),
        Claim(
            "deviation, comparison method, eq. (31)",
            "3.7 mm",
            f"base frame {1e3 * c.corner_deviation[0]:.5f} mm, rotated by {ROTATION:g}° {1e3 * rotated[1]:.5f} mm, "
            f"executed {_pair(comparison)} mm",
            _word(_near([*c.corner_deviation, rotated[1]], 3.7e-3))
            + f"; eq. (31) as printed mixes frames (H is not counted from A) and gives {1e3 * _read_literally(c):.0f} mm",
            f"{1e3 * c.corner_deviation[0]:.4f} mm",
        ),
        Claim(
            "deviation of the comparison method",
            "fixed, cannot be changed",
            f"{overlaps[0]:.2f}, {overlaps[1]:.2f}, {overlaps[2]:.2f} mm at overlaps 0.25, 0.5, 0.75; "
            f"{speeds[0]:.2f}, {speeds[1]:.2f}, {speeds[2]:.2f} mm at vertical speeds 0.6, 1.2, 1.8 m/s",
            ("holds" if max(overlaps + speeds) - min(overlaps + speeds) < 0.05 else "wrong: it moves with overlap and speeds")
            + f"; overlap {equal.scenario.law.overlap:.4f} gives "
            f"{1e3 * e.corner_deviation[0]:.4f} mm",
            f"{min(overlaps + speeds):.2f} to {max(overlaps + speeds):.2f} mm",
        ),
        Claim(
            "motion performance",
            "similar",
            f"peak joint torque {torque[0]:.1f} against {torque[1]:.1f} N·m ({more(torque, 1)}), "
            f"motor {motor[0]:.2f} against {motor[1]:.2f} N·m ({more(motor, 1)}), "
            f"tool acceleration {acceleration[0]:.1f} against {acceleration[1]:.1f} m/s² ({more(acceleration, 1)})",
            _word(abs(torque[0] / torque[1] - 1.0) < SIMILAR) + f" (similar: peaks within {100.0 * SIMILAR:g} %)",
            f"{more(torque, 1)} torque",
        ),
        Claim(
            "duration",
            "not compared at equal deviation",
            f"proposed {1e3 * p.nominal_duration:.2f} ms; comparison {1e3 * c.nominal_duration:.2f} ms, "
            f"and {1e3 * e.nominal_duration:.2f} ms at {1e3 * e.corner_deviation[0]:g} mm",
            f"at equal deviation the proposed method takes {1e3 * (p.nominal_duration - e.nominal_duration):+.2f} ms, "
            f"{more(torque, 2)} peak torque, {more(acceleration, 2)} acceleration",
            f"{1e3 * (p.nominal_duration - e.nominal_duration):+.2f} ms",
        ),
        Claim(
            "experiment matches simulation",
            "well",
            f"joint speed, plant against plan: at most {speed_error:.4f} rad/s apart in both methods",
            _word(speed_error < WELL * max(max(d.plan.peaks.joint_velocity) for d in (proposed, comparison)))
            + f" for the modelled plant with tuned gains (well: within {100.0 * WELL:g} % of the peak)",
            f"{speed_error:.3f} rad/s apart",
        ),
        *cost_claims(proposed.scenario),
    ]


def _word(holds: bool) -> str:
    return "holds" if holds else "wrong"


def _found(claim: Claim) -> str:
    """The verdict in a word; nothing where it has none."""
    return next((word for word in ("holds", "wrong", "not reached") if claim.verdict.startswith(word)), "")


def _near(deviations: Sequence[float], claimed: float) -> bool:
    """Whether deviations are what the paper says, to the 0.05 mm of its figures [m]."""
    return all(abs(d - claimed) < 5e-5 for d in deviations)


def _pair(done: _Done) -> str:
    return " and ".join(f"{1e3 * d:.3f}" for d in done.execution.corner_deviation)


def _method(name: str, done: _Done) -> Method:
    """What the figures show of a method."""
    plan, trace = done.plan, done.trace
    time = np.arange(round((trace.time[-1] - trace.time[0]) / PLOTTED) + 1) * PLOTTED  # as long as it is executed: it rests there
    s = plan.sample(time)
    return Method(
        name=name,
        time=time,
        tcp_position=s["tcp_position"],
        tcp_velocity=s["tcp_velocity"],
        joint_position=s["joint_position"],
        joint_velocity=s["joint_velocity"],
        right_angle_path=np.array([plan.task.pick, *plan.vertices, plan.task.place]),
        corner_deviation=plan.corner_deviation[0],
        executed_time=trace.time - trace.time[0],
        executed_velocity=trace["plant", "joint_velocity"],
        motor_torque=trace["plant", "motor_torque"],
    )


def _markdown(claims: list[Claim]) -> str:
    lines = ["# The paper's section 4", "", "| claim | the paper | measured | |", "|---|---|---|---|"]
    lines += [f"| {c.claim} | {c.paper} | {c.brief} | {_found(c)} |" for c in claims]
    for c in claims:  # in the table all of it would be wider than the view, which does not wrap it
        lines += ["", f"### {c.claim}: the paper says {c.paper}", f"Measured: {c.measured}.", "", f"**{c.verdict}**"]
    lines += ["", "The paper gives no robot dimensions: joint figures are for the default robot, to be compared in shape only."]
    return "\n".join(lines) + "\n"
