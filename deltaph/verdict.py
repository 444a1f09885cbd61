"""The first page of a recording: was the prescribed corner deviation kept, by which margin, where not and why."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

from deltaph.checks import deviation_tolerance
from deltaph.fmu.sources import token
from deltaph.report import WORST, corner_excess, found_text, payload_text, reduced_text, worst_corners
from deltaph.scenario import Scenario

SIDES = ("pick", "place")

_DEGREES = 180.0 / math.pi
_PEAKS = (
    ("velocity, rad/s", "joint_velocity", "joint_velocity_max_rad_s"),
    ("acceleration, rad/s²", "joint_acceleration", "joint_acceleration_max_rad_s2"),
    ("torque, N·m", "joint_torque", "joint_torque_max_Nm"),
)
"""Words with the units of scenario files, limit, fact."""


def provenance_facts(scenario: Scenario) -> dict[str, Any]:
    """The `provenance` object of `run --json`: with what the run was made, so that it can be made again."""
    return {
        "deltaph": version("deltaph"),
        "fmpy": version("fmpy"),
        "rerun": version("rerun-sdk"),
        "python": platform.python_version(),
        "planner_token": token("planner", 3),
        "plant_token": token("plant", 3),
        "scenario_sha256": scenario.sha256,
    }


def summary_markdown(scenario: Scenario, facts: Mapping[str, Any]) -> str:
    """The summary of a run as the text of a recording: the verdict first.

    Args:
        scenario: what was run.
        facts: the JSON report of the run.
    """
    tolerance = deviation_tolerance(scenario)
    lines = [*_verdict(scenario, facts, tolerance), "", *_corners(facts, tolerance), ""]
    executed, timing = facts["executed"], facts["timing"]
    lines += [
        f"**{scenario.title}**: law `{scenario.law.name}`, {_pace(facts)}, {scenario.gains} drive gains, "
        f"{payload_text(scenario)}. Tracking error at most {1e3 * executed['tracking_error_tcp_max_m']:.3f} mm at the tool, "
        f"{_DEGREES * executed['tracking_error_joint_max_rad']:.4f} deg at a joint; excursion outside the right angles at most "
        f"{1e3 * executed['overshoot_m']:.3f} mm.",
        "",
        *_expectations(facts["expect"]),
        *_peaks(scenario, facts),
        "",
        f"Step of both FMUs: median {timing['step_us']['p50']:.0f} µs, 99 % {timing['step_us']['p99']:.0f} µs, largest "
        f"{timing['step_us']['max']:.0f} µs. Real-time factor {timing['real_time_factor']:.2f}, "
        f"{timing['missed_deadlines']} deadlines missed, {facts['telemetry']['dropped']} messages dropped.",
        "",
        *_provenance(facts["provenance"]),
    ]
    return "\n".join(lines) + "\n"


def _pace(facts: Mapping[str, Any]) -> str:
    """How long it takes, and of a sequence how much that is."""
    sequence = facts["sequence"]
    if sequence is None:
        return f"{1e3 * facts['plan']['duration_s']:g} ms"
    rate = f"{sequence['parts_per_minute']:.1f} parts per minute"
    parts = f"{sequence['parts']} part{'s' if sequence['parts'] > 1 else ''}"
    return f"{parts} in {len(facts['operations'])} operations, {sequence['cycle_time_s']:.3f} s, **{rate}**"


def _place(corner: Mapping[str, Any], facts: Mapping[str, Any]) -> str:
    """Which corner it is, in words."""
    words = f"the {SIDES[corner['side']]} corner"
    count = len(facts["operations"])
    if facts["sequence"] is not None:
        words += f" of {corner['move']}"
        return words + (f" in cycle {corner['operation'] // count + 1}" if len(facts["executed"]["corners"]) > 2 * count else "")
    return words + (f" of operation {corner['operation'] + 1}" if len(facts["executed"]["corners"]) > 2 else "")


def _verdict(scenario: Scenario, facts: Mapping[str, Any], tolerance: float) -> Iterator[str]:
    """The sentence, and what made it so."""
    executed = facts["executed"]
    corners = sorted((corner for corner in executed["corners"] if corner["reached"]), key=corner_excess, reverse=True)
    if executed["trip_time_s"] is not None:
        axis = f" of axis {executed['trip_axis']}" if executed["trip_axis"] else ""
        yield f"# TRIPPED at {1e3 * executed['trip_time_s']:g} ms: {executed['trip']}{axis}"
        yield ""
    if missed := [corner for corner in executed["corners"] if not corner["reached"]]:
        yield f"# Not reached: {_place(missed[0], facts)}" + (f" and {len(missed) - 1} more" if len(missed) > 1 else "")
        yield ""
    if not corners:
        return
    worst = corners[0]
    excess = corner_excess(worst)
    where, prescribed = _place(worst, facts), f"the prescribed {1e3 * worst['prescribed_m']:g} mm"
    lost = [corner for corner in corners if corner["executed_m"] > corner["prescribed_m"] + tolerance]
    if excess <= 0.0:
        yield f"# Deviation kept, by {_mm(-excess)} mm"
        yield ""
        yield f"Closest call: {where}, {1e3 * worst['executed_m']:.3f} mm executed within {prescribed}. {_split(worst)}"
    elif not lost:
        yield f"# Deviation kept within the tolerance, by {_mm(tolerance - excess)} mm"
        yield ""
        yield (
            f"At {where} the machine is {_mm(excess)} mm beyond {prescribed}; the scenario allows {1e3 * tolerance:g} mm. "
            f"{_split(worst)}"
        )
    else:
        yield f"# Deviation NOT kept: {_mm(excess)} mm too far at {where}"
        yield ""
        count = f"{len(lost)} of {len(corners)} corners exceed what is prescribed. " if len(corners) > 1 else ""
        yield f"{count}**Why:** {_split(worst)} {_cause(scenario, worst)}"


def _split(corner: Mapping[str, Any]) -> str:
    """What of the deviation was planned, and what tracking made of it."""
    added = corner["executed_m"] - corner["planned_m"]
    effect = f"adds {_mm(added)} mm" if added >= 0.0 else f"takes {_mm(-added)} mm off"
    return f"The plan has {1e3 * corner['planned_m']:.3f} mm; tracking error {effect}."


def _cause(scenario: Scenario, corner: Mapping[str, Any]) -> str:
    """Which tracking error it was."""
    if corner["planned_m"] > corner["prescribed_m"] * (1.0 + 1e-9):
        return "The plan itself exceeds what is prescribed."
    joints = [_DEGREES * error for error in corner["joint_tracking_error_rad"]]
    widest = max(range(3), key=lambda i: abs(joints[i]))
    lag = corner["lag_m"]
    behind = f"{_mm(abs(lag))} mm of path {'behind' if lag >= 0.0 else 'ahead'}"
    return (
        f"There, at {1e3 * corner['time_s']:.1f} ms, the tool is {_mm(corner['tracking_error_m'])} mm from its setpoint, {behind}; "
        f"joint {widest + 1} is off most, by {joints[widest]:.2g} deg ({scenario.gains} drive gains)."
    )


def _corners(facts: Mapping[str, Any], tolerance: float) -> Iterator[str]:
    """A row per side with its worst pass; of a sequence the worst corners, and how many more there are."""
    corners = worst_corners(facts)
    if facts["sequence"] is not None:
        yield "| corner, worst first | prescribed | planned | executed | margin |"
        yield "|---|---|---|---|---|"
        for corner in corners[:WORST]:
            yield _row(f"{corner['move']}, {SIDES[corner['side']]}", corner, tolerance)
        others = corners[WORST:]
        if others:
            lost = sum(corner_excess(corner) > tolerance for corner in others)
            yield f"| and {len(others)} more | | | | {f'**{lost} NOT kept**' if lost else 'all kept'} |"
    else:
        yield "| corner | prescribed | planned | executed | margin |"
        yield "|---|---|---|---|---|"
        passes = len(facts["executed"]["corners"])
        for side, name in enumerate(SIDES):
            found = [corner for corner in corners if corner["side"] == side]
            if found and found[0]["reached"]:
                yield _row(name + (f", worst of {passes // 2}" if passes > 2 else ""), found[0], tolerance)
            else:
                yield f"| {name} | | | not reached | |"
    reduced = {(corner["prescribed_m"], corner["planned_m"], corner["bound"]): corner for corner in corners if corner["bound"]}
    if reduced:
        yield ""
    for facts_of_it, corner in list(reduced.items())[:WORST]:
        where = f"{corner['move']}, {SIDES[corner['side']]}" if facts["sequence"] is not None else SIDES[corner["side"]]
        yield f"- {where}: {reduced_text(*facts_of_it)}"


def _row(name: str, corner: Mapping[str, Any], tolerance: float) -> str:
    if not corner["reached"]:
        return f"| {name} | | | not reached | |"
    margin = -corner_excess(corner)
    word = "kept" if margin >= -tolerance else "**NOT kept**"
    values = " | ".join(f"{1e3 * corner[key]:.3f} mm" for key in ("prescribed_m", "planned_m", "executed_m"))
    return f"| {name} | {values} | {1e3 * margin:+.3f} mm {word} |"


def _expectations(checks: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    if not checks:
        return
    missed = sum(not check["ok"] for check in checks)
    yield f"| expectation: {f'{missed} of {len(checks)} missed' if missed else f'all {len(checks)} met'} | found | expected | |"
    yield "|---|---|---|---|"
    for check in checks:
        yield f"| {check['name']} | {found_text(check['value'])} | {check['limit']} | {'met' if check['ok'] else '**missed**'} |"
    yield ""


def _peaks(scenario: Scenario, facts: Mapping[str, Any]) -> Iterator[str]:
    """The greatest peaks of all plans against the limits, and the motors as they were driven."""
    yield "| peak at joint | 1 | 2 | 3 | limit | used |"
    yield "|---|---|---|---|---|---|"
    for words, limit, fact in _PEAKS:
        peaks = [max(of_joint) for of_joint in zip(*(operation[fact] for operation in facts["operations"]), strict=True)]
        limits = [float(value) for value in getattr(scenario.limits, limit)]
        used = max(peak / bound for peak, bound in zip(peaks, limits, strict=True))
        bounds = " ".join(dict.fromkeys("-" if math.isinf(value) else f"{value:.4g}" for value in limits))
        values = " | ".join(f"{peak:.4g}" for peak in peaks)
        yield f"| planned {words} | {values} | {bounds} | {f'{100.0 * used:.0f} %' if used else '-'} |"
    executed = facts["executed"]
    for words, fact in (("executed motor, N·m", "motor_torque_max_Nm"), ("executed motor rms, N·m", "motor_torque_rms_Nm")):
        yield f"| {words} | {' | '.join(f'{value:.3g}' for value in executed[fact])} | | |"
    loads = executed["motor_load_max"]
    yield f"| executed motor load | {' | '.join(f'{value:.3g}' for value in loads)} | 1 | {100.0 * max(loads):.0f} % |"


def _provenance(facts: Mapping[str, Any]) -> Iterator[str]:
    yield f"deltaph {facts['deltaph']}, fmpy {facts['fmpy']}, rerun {facts['rerun']}, Python {facts['python']}"
    yield ""
    yield f"- planner FMU `{facts['planner_token']}`"
    yield f"- plant FMU `{facts['plant_token']}`"
    yield f"- scenario SHA-256 `{facts['scenario_sha256']}`"


def _mm(metres: float) -> str:
    """Three digits are enough of a length that matters, and the micrometre is the last one that means something."""
    return f"{1e3 * metres:.3f}" if abs(metres) < 1e-3 else f"{1e3 * metres:.2f}"
