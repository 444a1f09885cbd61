"""The first page of a recording: was the prescribed corner deviation kept, by which margin, where not and why."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

from deltaph.checks import deviation_tolerance
from deltaph.fmu.sources import token
from deltaph.report import (
    SIDES,
    WORST,
    corner_excess,
    found_text,
    payload_text,
    plans_text,
    reductions,
    trip_text,
    worst_corner,
    worst_corners,
)
from deltaph.scenario import Scenario
from deltaph.variables import variable_table

_DEGREES = 180.0 / math.pi
_PEAKS = (
    ("joint velocity, rad/s", "joint_velocity", "joint_velocity_max_rad_s"),
    ("joint acceleration, rad/s²", "joint_acceleration", "joint_acceleration_max_rad_s2"),
    ("joint jerk, rad/s³", "joint_jerk", "joint_jerk_max_rad_s3"),
    ("joint torque, N·m", "joint_torque", "joint_torque_max_Nm"),
    ("tool speed, m/s", "tcp_speed", "tcp_speed_max_m_s"),
    ("tool acceleration, m/s²", None, "tcp_acceleration_max_m_s2"),
)
"""Words with the units of scenario files, limit, fact."""

_MOTOR = (
    ("motor torque, N·m", "drive.torque_max", "motor_torque_max_Nm"),
    ("motor torque rms, N·m", "drive.torque_rated", "motor_torque_rms_Nm"),
)
"""Words, parameter of the plant that limits, fact."""

_PERCENTILES = (("median", "p50"), ("99 %", "p99"), ("largest", "max"))

_OUTSIDE = 0.1
"""An excursion beyond the right angles that is more than this share of the prescribed deviation is said first."""

_TIE = 0.01
"""Joints that are off by nearly the same, to this share of it, are named together."""


def provenance_facts(scenario: Scenario) -> dict[str, Any]:
    """The `provenance` object of `run --json`: with what the run was made, so that it can be made again."""
    return {
        "deltaph": version("deltaph"),
        "fmpy": version("fmpy"),
        "zenoh": version("eclipse-zenoh"),
        "rerun": version("rerun-sdk"),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
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
    lines = [
        *_verdict(scenario, facts, tolerance),
        "",
        *_faults(scenario),
        *_feed(scenario, facts),
        *_corners(facts, tolerance),
        "",
        *_run(scenario, facts),
        "",
        *_expectations(facts["expect"]),
        *_peaks(scenario, facts),
        "",
        *_timing(facts),
        "",
        *_provenance(scenario, facts["provenance"]),
    ]
    return "\n".join(lines) + "\n"


def serving_markdown(scenario: Scenario, facts: Mapping[str, Any]) -> str:
    """The summary of a cell that served, as the text of a recording.

    Args:
        scenario: robot, law and drives.
        facts: the JSON report.
    """
    plans, timing, executed = facts["plans"], facts["timing"], facts["executed"]
    count, lost = plans["corners"], plans["corners"] - plans["corners_kept"]
    tolerance, worst = deviation_tolerance(scenario), plans["worst"]
    within = f" within the tolerance of {1e3 * tolerance:g} mm" if worst and corner_excess(worst) > 0.0 else ""
    verdict = f"Deviation NOT kept at {lost} of {count} corners" if lost else f"Deviation kept{within} at all {count} corners"
    lines = [f"# {verdict if count else 'No corner was passed'}", ""]
    if executed["trip_time_s"] is not None:
        lines = [f"# TRIPPED at {executed['trip_time_s']:.3f} s: {trip_text(executed)}", "", *lines]
    if worst:
        lines += [f"Worst: {worst_corner(worst)}.", ""]
    lines += [
        f"**{scenario.title}**: served for {facts['steps'] * facts['communication_step_s']:.3f} s, law `{scenario.law.name}`, "
        f"{scenario.gains} gains. Plans: {plans_text(plans)}. "
        f"Tracking error at most {1e3 * executed['tracking_error_tcp_max_m']:.3f} mm at the tool.",
        "",
        *_served_corners(facts, tolerance),
        *_decisions(facts),
        f"{timing['missed_deadlines']} deadlines missed, {facts['telemetry']['dropped']} messages dropped.",
        "",
        *_provenance(scenario, facts["provenance"]),
    ]
    return "\n".join(lines) + "\n"


def _served_corners(facts: Mapping[str, Any], tolerance: float) -> Iterator[str]:
    """The corners of the newest plans, worst first, and what the pictures beside them show."""
    newest = facts["plans"]["newest"]
    corners = sorted((corner for plan in newest for corner in plan["corners"]), key=corner_excess, reverse=True)
    if not corners:
        return
    yield "| corner, mm, worst first | prescribed | planned | executed | margin | |"
    yield "|---|---|---|---|---|---|"
    for corner in corners[:WORST]:
        yield _passed_row(f"plan {corner['plan']}, {SIDES[corner['side']]}", corner, tolerance)
    yield ""
    which = (
        f"the {len(newest)} newest of {facts['plans']['arrived']} plans" if len(newest) < facts["plans"]["arrived"] else "the plans"
    )
    yield (
        f"The pictures show {which} that arrived: planned paths, prescribed deviations (red), and where the tool came closest to "
        "each vertex (orange). Around the cursor, the cell also shows the path as it was commanded (blue) and executed (orange)."
    )
    yield ""


def _decisions(facts: Mapping[str, Any]) -> Iterator[str]:
    """What became of commands; when, the events tell."""
    decided = {command: outcomes for command, outcomes in facts["commands"].items() if outcomes}
    if decided:
        words = "; ".join(f"{name}: {', '.join(f'{n} {what}' for what, n in found.items())}" for name, found in decided.items())
        yield f"Commands: {words}. The events tell when."
        yield ""


def _pace(facts: Mapping[str, Any]) -> str:
    """How long it takes, and of a sequence how much that is."""
    sequence, plan = facts["sequence"], facts["plan"]
    if sequence is not None:
        parts = f"{sequence['parts']} part{'s' if sequence['parts'] > 1 else ''}"
        rate = f"{sequence['parts_per_minute']:.1f} parts per minute"
        return f"{parts} in {len(facts['operations'])} operations, {sequence['cycle_time_s']:.3f} s, **{rate}**"
    operations = len({corner["operation"] for corner in facts["executed"]["corners"]})
    times = f"{operations} operations of " if operations > 1 else ""
    return f"{times}{1e3 * plan['duration_s']:g} ms ({1e3 * plan['nominal_duration_s']:.3f} ms before alignment)"


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
        yield f"# TRIPPED at {1e3 * executed['trip_time_s']:g} ms: {trip_text(executed)}"
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
    there = " at what was reached" if missed else ""
    if excess <= 0.0:
        yield f"# Deviation kept{there}, by {_mm(-excess)} mm"
        yield ""
        yield f"Closest call: {where}, {1e3 * worst['executed_m']:.3f} mm executed within {prescribed}. {_split(worst)}"
    elif not lost:
        yield f"# Deviation kept{there} within the tolerance of {1e3 * tolerance:g} mm, by {_mm(tolerance - excess)} mm"
        yield ""
        yield f"At {where} the machine is {_mm(excess)} mm beyond {prescribed}, which the scenario allows. {_split(worst)}"
    else:
        yield f"# Deviation NOT kept: {_mm(excess)} mm too far at {where}"
        yield ""
        count = f"{len(lost)} of {len(corners)} corners exceed what is prescribed. " if len(corners) > 1 else ""
        allowed = f"The scenario allows {1e3 * tolerance:g} mm more." if tolerance else "The scenario allows no tolerance."
        yield f"{count}{allowed} **Why:** {_split(worst)} {_cause(scenario, worst)}"
    if executed["overshoot_m"] > _OUTSIDE * worst["prescribed_m"]:
        yield ""
        yield f"**Outside the right angles by up to {_mm(executed['overshoot_m'])} mm**, which a corner deviation does not count."


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
    largest = max(joints, key=abs)
    widest = [str(i + 1) for i, error in enumerate(joints) if abs(error - largest) <= _TIE * abs(largest)]
    named = f"joints {' and '.join(widest)} are" if len(widest) > 1 else f"joint {widest[0]} is"
    lag = corner["lag_m"]
    behind = f"{_mm(abs(lag))} mm of path {'behind' if lag >= 0.0 else 'ahead'}"
    return (
        f"There, at {1e3 * corner['time_s']:.1f} ms, the tool is {_mm(corner['tracking_error_m'])} mm from its setpoint, {behind}; "
        f"{named} off most, by {largest:.2g} deg ({scenario.gains} drive gains)."
    )


def _faults(scenario: Scenario) -> Iterator[str]:
    """What the scenario does to the machine, in its own words."""
    for fault in sorted(scenario.document.get("fault", ()), key=lambda fault: float(fault["time_ms"])):
        effects = ", ".join(f"{key} {json.dumps(value)}" for key, value in fault.items() if key != "time_ms")
        yield f"The scenario sets, from {fault['time_ms']:g} ms on: {effects}."
        yield ""


def _feed(scenario: Scenario, facts: Mapping[str, Any]) -> Iterator[str]:
    """How the feed was changed, and what that cost."""
    if scenario.feed:
        changes = ", ".join(f"{100.0 * change.override:g} % from {1e3 * change.time:g} ms on" for change in scenario.feed)
        arrival = facts["executed"]["arrival_s"]
        yield f"Feed override: {changes}; " + ("not arrived." if arrival is None else f"arrived at {1e3 * arrival:g} ms.")
        yield ""


def _corners(facts: Mapping[str, Any], tolerance: float) -> Iterator[str]:
    """A row per side with its worst pass; of a sequence the worst corners, and how many more there are."""
    corners = worst_corners(facts)
    if facts["sequence"] is not None:
        yield "| corner, mm, worst first | prescribed | planned | executed | margin | |"
        yield "|---|---|---|---|---|---|"
        for corner in corners[:WORST]:
            yield _row(f"{corner['move']}, {SIDES[corner['side']]}", corner, tolerance)
        others = corners[WORST:]
        if others:
            lost = sum(corner_excess(corner) > tolerance for corner in others)
            yield f"| and {len(others)} more | | | | | {f'**{lost} NOT kept**' if lost else 'all kept'} |"
    else:
        yield "| corner, mm | prescribed | planned | executed | margin | |"
        yield "|---|---|---|---|---|---|"
        passes = len(facts["executed"]["corners"])
        for side, name in enumerate(SIDES):
            found = [corner for corner in corners if corner["side"] == side]
            if found and found[0]["reached"]:
                yield _row(name + (f", worst of {passes // 2}" if passes > 2 else ""), found[0], tolerance)
            else:
                yield f"| {name} | | | not reached | | |"
    if reasons := reductions(corners, facts):
        yield ""
        yield from (f"- {reason}" for reason in reasons)


def _row(name: str, corner: Mapping[str, Any], tolerance: float) -> str:
    if not corner["reached"]:
        return f"| {name} | | | not reached | | |"
    return _passed_row(name, corner, tolerance)


def _passed_row(name: str, corner: Mapping[str, Any], tolerance: float) -> str:
    margin = -corner_excess(corner)
    word = "kept" if margin >= 0.0 else "within tolerance" if margin >= -tolerance else "**NOT kept**"
    values = " | ".join(f"{1e3 * corner[key]:.3f}" for key in ("prescribed_m", "planned_m", "executed_m"))
    return f"| {name} | {values} | {1e3 * margin:+.3f} | {word} |"


def _run(scenario: Scenario, facts: Mapping[str, Any]) -> Iterator[str]:
    """What was run, and how far the machine was from it."""
    executed = facts["executed"]
    declared = f", declared as {scenario.declared_payload:g} kg" if scenario.declared_payload != scenario.payload else ""
    seconds = facts["steps"] * facts["communication_step_s"]
    yield (
        f"**{scenario.title}**: law `{scenario.law.name}`, {_pace(facts)}, {scenario.gains} drive gains, "
        f"{payload_text(scenario)}{declared}; {facts['steps']} steps, {seconds:g} s. Tracking error at most "
        f"{1e3 * executed['tracking_error_tcp_max_m']:.3f} mm at the tool, "
        f"{_DEGREES * executed['tracking_error_joint_max_rad']:.4f} deg at a joint; excursion outside the right angles at most "
        f"{1e3 * executed['overshoot_m']:.3f} mm."
    )


def _expectations(checks: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    if not checks:
        return
    missed = sum(not check["ok"] for check in checks)
    yield f"| expectations: {f'{missed} of {len(checks)} missed' if missed else 'met'} | found | expected | |"
    yield "|---|---|---|---|"
    for check in checks:
        yield f"| {check['name']} | {found_text(check['value'])} | {check['limit']} | {'met' if check['ok'] else '**missed**'} |"
    yield ""


def _peaks(scenario: Scenario, facts: Mapping[str, Any]) -> Iterator[str]:
    """The greatest peaks of all plans against the limits, and the motors as they were driven against what they stand."""
    yield "| peak, by joint | 1 | 2 | 3 | limit | used |"
    yield "|---|---|---|---|---|---|"
    for words, limit, fact in _PEAKS:
        bounds = getattr(scenario.limits, limit) if limit is not None else math.inf
        yield _peak(f"planned {words}", _greatest([operation[fact] for operation in facts["operations"]]), bounds)
    executed, table = facts["executed"], variable_table("plant")
    for words, parameter, fact in _MOTOR:
        yield _peak(f"executed {words}", executed[fact], scenario.plant.get(parameter, float(table[parameter].start or 0.0)))
    yield _peak("executed motor load", executed["motor_load_max"], 1.0)


def _greatest(peaks: Sequence[Any]) -> float | list[float]:
    """Of all operations: of each joint, or of the one value that there is."""
    return [max(of_joint) for of_joint in zip(*peaks, strict=True)] if isinstance(peaks[0], list) else float(max(peaks))


def _peak(words: str, peaks: float | Sequence[float], limits: float | Sequence[float]) -> str:
    """A row: of the joints, or of the one that there is."""
    found = [float(peak) for peak in (peaks if isinstance(peaks, Sequence) else [peaks])]
    bounds = [float(bound) for bound in (limits if isinstance(limits, Sequence) else [limits] * len(found))]
    used = 100.0 * max(peak / bound for peak, bound in zip(found, bounds, strict=True))
    shown = " ".join(dict.fromkeys("-" if math.isinf(bound) else _figure(bound) for bound in bounds))
    values = " | ".join([*map(_figure, found), *[""] * (3 - len(found))])
    return f"| {words} | {values} | {shown} | {f'{used:.3g} %' if used else '-'} |"


def _timing(facts: Mapping[str, Any]) -> Iterator[str]:
    """How the run kept time."""
    timing, telemetry = facts["timing"], facts["telemetry"]

    def spread(name: str) -> str:
        found = timing[name]
        return ", ".join(f"{words} {_figure(found[key], 3)} µs" for words, key in _PERCENTILES)

    if timing["realtime"]:
        causes = ", ".join(f"{count} by {cause}" for cause, count in timing["missed_by"].items() if count)
        missed = f"{timing['missed_deadlines']} of {facts['steps']} deadlines missed" + (f" ({causes})" if causes else "")
        yield (
            f"In real time, factor {timing['real_time_factor']:.3f}: {missed}, {timing['slipped_steps']} steps slipped; late by "
            f"{spread('lateness_us')}."
        )
    else:
        yield f"As fast as possible: {timing['real_time_factor']:.1f} times real time."
    yield f"Step of both FMUs: {spread('step_us')}."
    if telemetry["published"] or telemetry["dropped"]:
        yield f"{telemetry['published']} frames published, {telemetry['dropped']} dropped."
    else:
        yield "Nothing published."


def _provenance(scenario: Scenario, facts: Mapping[str, Any]) -> Iterator[str]:
    names = ("deltaph", "fmpy", "zenoh", "rerun")
    yield ", ".join(f"{name} {facts[name]}" for name in names) + f", Python {facts['python']} on {facts['platform']}"
    yield ""
    yield f"- planner FMU `{facts['planner_token']}`"
    yield f"- plant FMU `{facts['plant_token']}`"
    yield f"- `{scenario.path.name}`, SHA-256 `{facts['scenario_sha256']}`"


def _mm(metres: float) -> str:
    """Three digits are enough of a length that matters, and the micrometre is the last one that means something."""
    return f"{1e3 * metres:.3f}" if abs(metres) < 1e-3 else f"{1e3 * metres:.2f}"


def _figure(value: float, digits: int = 4) -> str:
    """So many digits, and no power of ten where the figure is large."""
    return f"{value:.{digits}g}" if abs(value) < 10.0**digits else f"{value:.0f}"
