"""Reports: the same facts as JSON and as tables for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from deltaph.checks import Check, deviation_tolerance
from deltaph.execution import CornerPass, Execution, Trace, deadline_facts, percentiles
from deltaph.frame import TIMING
from deltaph.pacing import HISTOGRAM_US, Undisturbed, histogram
from deltaph.plan import Plan
from deltaph.scenario import Scenario
from deltaph.schedule import Schedule

SIDES = ("pick", "place")
"""Of a corner, by its number in the JSON reports."""

_JOINT_ROWS = (("velocity", "rad/s"), ("acceleration", "rad/s2"), ("jerk", "rad/s3"), ("torque", "N m"))


def plan_facts(plan: Plan) -> dict[str, Any]:
    """The `plan` object of both JSON reports."""
    peaks = plan.peaks
    return {
        "duration_s": plan.duration,
        "nominal_duration_s": plan.nominal_duration,
        "speed_factor": plan.speed_factor,
        "path_length_m": plan.length,
        "corner_deviation_m": list(plan.corner_deviation),
        "corner_deviation_prescribed_m": list(plan.task.corner_deviation),
        "corner_bound": list(plan.corner_bound),
        "corner_legs_m": [list(legs) for legs in plan.corner_legs],
        "joint_velocity_max_rad_s": list(peaks.joint_velocity),
        "joint_acceleration_max_rad_s2": list(peaks.joint_acceleration),
        "joint_jerk_max_rad_s3": list(peaks.joint_jerk),
        "joint_torque_max_Nm": list(peaks.joint_torque),
        "tcp_speed_max_m_s": peaks.tcp_speed,
        "tcp_acceleration_max_m_s2": peaks.tcp_acceleration,
    }


def phase_facts(plan: Plan) -> list[dict[str, Any]]:
    """The `phases` list of `plan --json`."""
    return [{"name": p.name, "start_s": p.start, "duration_s": p.duration, "length_m": p.length} for p in plan.phases]


def sequence_facts(scenario: Scenario, run: Schedule) -> dict[str, Any] | None:
    """The `sequence` object of both JSON reports; None where there is none."""
    if not scenario.parts:
        return None
    return {"parts": scenario.parts, "cycle_time_s": run.cycle_time, "parts_per_minute": run.parts_per_minute}


def operation_facts(run: Schedule, execution: Execution | None = None) -> list[dict[str, Any]]:
    """The `operations` list of both JSON reports: one pass; what is executed is the worst of all passes."""
    found = [
        {
            "name": operation.move.name,
            "begin_s": operation.begin_ms / 1000.0,
            "start_s": operation.start_ms / 1000.0,
            "end_s": operation.end_ms / 1000.0,
            "dwell_s": operation.plan.dwell_ms / 1000.0,
            "waited_for_plan_s": operation.waited_ms / 1000.0,
            "payload_kg": operation.move.payload,
            "pick_m": list(operation.plan.task.pick),
            "place_m": list(operation.plan.task.place),
            "lift_m": list(operation.plan.task.lift),
            **plan_facts(operation.plan),
        }
        for operation in run.one_pass
    ]
    if execution is not None:
        for k, facts in enumerate(found):
            passes = [corner for corner in execution.corners if corner.operation % run.pass_length == k]
            facts["executed_corner_deviation_m"] = [max(c.executed for c in passes[side::2]) for side in (0, 1) if passes]
    return found


def executed_facts(execution: Execution) -> dict[str, Any]:
    """The `executed` object of `run --json`."""
    return {
        "corner_deviation_m": list(execution.corner_deviation),
        "arrival_s": execution.arrival,
        "corners": [_corner_facts(corner) for corner in execution.corners],
        "overshoot_m": execution.overshoot,
        "tracking_error_joint_max_rad": execution.tracking_error_joint_max,
        "tracking_error_tcp_max_m": execution.tracking_error_tcp_max,
        "motor_torque_max_Nm": list(execution.motor_torque_max),
        "motor_torque_rms_Nm": list(execution.motor_torque_rms),
        "motor_load_max": list(execution.motor_load_max),
        "motor_work_per_operation_J": list(execution.motor_work),
        "motor_regenerated_per_operation_J": list(execution.motor_regenerated),
        "trip": execution.trip,
        "trip_time_s": execution.trip_time,
        "trip_axis": execution.trip_axis,
    }


def _corner_facts(corner: CornerPass) -> dict[str, Any]:
    return {
        "operation": corner.operation,
        "move": corner.move,
        "side": corner.side,
        "prescribed_m": corner.prescribed,
        "planned_m": corner.planned,
        "bound": corner.bound,
        "executed_m": corner.executed,
        "reached": corner.reached,
        "time_s": corner.time,
        "nearest_m": list(corner.nearest),
        "tracking_error_m": corner.tracking_error,
        "lag_m": corner.lag,
        "joint_tracking_error_rad": list(corner.joint_tracking_error),
    }


def timing_facts(trace: Trace, realtime: Undisturbed | None) -> dict[str, Any]:
    """The `timing` object of `run --json`; frame 0 is not a step."""
    last = {name: float(trace.timing_of(name)[-1]) for name, _, _ in TIMING}
    steps = trace.timing_of("planner_step")[1:] + trace.timing_of("plant_step")[1:]
    lateness_us = 1e6 * trace.timing_of("lateness")[1:]
    return {
        "realtime": realtime is not None,
        "step_us": percentiles(steps),
        "publish_us": percentiles(trace.timing_of("publish")[1:]),
        "lateness_us": percentiles(1e-6 * lateness_us),
        "lateness_histogram_us": {"up_to": list(HISTOGRAM_US), "count": histogram(lateness_us.tolist())},
        **deadline_facts(last, realtime.priority if realtime is not None else 0),
    }


def _limit(value: float) -> str:
    return "-" if math.isinf(value) else f"{value:.5g}"


def _mark(ok: bool) -> str:
    return "[green]ok[/]" if ok else "[bold red]no[/]"


def print_plan(console: Console, scenario: Scenario, run: Schedule) -> None:
    """The report on what is planned: of one operation, or a row for each of a sequence."""
    console.print(scenario.title, style="bold", markup=False, soft_wrap=True)
    if scenario.parts:
        console.print(f"law {scenario.law.name} · {sequence_text(scenario, run)}", soft_wrap=True)
        _print_operations(console, scenario, run)
    else:
        _print_operation(console, scenario, run.operations[0].plan)


def sequence_text(scenario: Scenario, run: Schedule) -> str:
    """How much of a sequence is done how fast."""
    parts = f"{scenario.parts} part{'s' if scenario.parts > 1 else ''}"
    return f"{parts} in {run.cycle_time:.3f} s: {run.parts_per_minute:.1f} parts per minute"


def payload_text(scenario: Scenario) -> str:
    """What is carried, at most."""
    return f"payload {'up to ' if scenario.parts else ''}{max(move.payload for move in scenario.moves):g} kg"


def reduced_text(prescribed: float, planned: float, bound: str) -> str:
    """Why a planned deviation [m] is smaller than prescribed; empty where it is not."""
    return f"planned {1e3 * planned:.3g} mm of {1e3 * prescribed:g} mm: {bound}" if bound else ""


def _print_operations(console: Console, scenario: Scenario, run: Schedule) -> None:
    """A row per operation: times, planned deviations, the greatest peak of any joint; the limits, and what is special, below."""
    heads = ("rad/s", "rad/s2", "rad/s3", "N m", "m/s")
    table = Table("", "kg", "rest", "ms", "deviation (mm)", *heads, box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    remarks: list[str] = []
    for operation in run.one_pass:
        plan, name = operation.plan, operation.move.name
        beyond = {violation.quantity.split()[-1]: violation.quantity for violation in plan.violations(scenario.limits)}
        peaks = {quantity: max(getattr(plan.peaks, f"joint_{quantity}")) for quantity, _ in _JOINT_ROWS}
        cells = [
            f"[bold red]{peak:.3g}[/]" if quantity in beyond else f"{peak:.3g}"
            for quantity, peak in (peaks | {"speed": plan.peaks.tcp_speed}).items()
        ]
        deviations = " ".join(f"{1e3 * d:.3f}" for d in plan.corner_deviation)
        table.add_row(name, f"{operation.move.payload:g}", f"{plan.dwell_ms}", f"{plan.duration_ms}", deviations, *cells)
        remarks += [f"{name}: {quantity} beyond its limit" for quantity in beyond.values()]
        corners = zip(plan.task.corner_deviation, plan.corner_deviation, plan.corner_bound, strict=True)
        if operation.waited_ms:
            remarks.append(
                f"{name}: the robot waits {operation.waited_ms:g} ms for the plan, which takes longer than the way before"
            )
        remarks += [f"{name}: {why}" for why in dict.fromkeys(reduced_text(*corner) for corner in corners) if why]
    limits = [getattr(scenario.limits, f"joint_{quantity}") for quantity, _ in _JOINT_ROWS]
    bounds = ["-" if math.isinf(min(limit)) else f"{min(limit):.3g}" for limit in (*limits, (scenario.limits.tcp_speed,))]
    table.add_row("limit", "", "", "", "", *bounds)
    console.print(table)
    for remark in remarks:
        console.print(remark, soft_wrap=True)


def _print_operation(console: Console, scenario: Scenario, plan: Plan) -> None:
    console.print(
        f"law {plan.law.name} · {1e3 * plan.duration:g} ms (nominal {1e3 * plan.nominal_duration:.6f} ms, "
        f"speed factor {plan.speed_factor:.6f}) · path {1e3 * plan.length:.3f} mm",
        soft_wrap=True,
    )
    phases = Table("phase", "start (ms)", "duration (ms)", "length (mm)", box=None, pad_edge=False)
    for p in plan.phases:
        phases.add_row(p.name, f"{1e3 * p.start:.3f}", f"{1e3 * p.duration:.3f}", f"{1e3 * p.length:.3f}")
    console.print(phases)

    corners = Table("corner deviation (mm)", "prescribed", "planned", "kept", "", box=None, pad_edge=False)
    rows = zip(SIDES, plan.task.corner_deviation, plan.corner_deviation, plan.corner_bound, strict=True)
    for side, prescribed, planned, bound in rows:
        mark = _mark(planned <= prescribed * (1 + 1e-12))
        corners.add_row(side, f"{1e3 * prescribed:g}", f"{1e3 * planned:.5f}", mark, reduced_text(prescribed, planned, bound))
    console.print(corners)

    peaks = Table("peak", "joint 1", "joint 2", "joint 3", "limit", "", box=None, pad_edge=False)
    for quantity, unit in _JOINT_ROWS:
        values: Sequence[float] = getattr(plan.peaks, f"joint_{quantity}")
        limits: Sequence[float] = getattr(scenario.limits, f"joint_{quantity}")
        kept = all(value <= limit for value, limit in zip(values, limits, strict=True))
        bounds = " ".join(dict.fromkeys(_limit(limit) for limit in limits))
        peaks.add_row(f"joint {quantity} ({unit})", *(f"{value:.5g}" for value in values), bounds, _mark(kept))
    peaks.add_row(
        "tcp speed (m/s)",
        f"{plan.peaks.tcp_speed:.5g}",
        "",
        "",
        _limit(scenario.limits.tcp_speed),
        _mark(plan.peaks.tcp_speed <= scenario.limits.tcp_speed),
    )
    peaks.add_row("tcp acceleration (m/s2)", f"{plan.peaks.tcp_acceleration:.5g}", "", "", "-", "")
    console.print(peaks)


WORST = 6
"""Corners of a sequence that a summary shows, the worst ones."""


def worst_corners(facts: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Of a run's JSON report, the worst pass of every corner, one that reached it where there is one; worst first.

    A corner is one of a sequence's operations; without a sequence the way there and the way back pass the same two.
    """
    worst: dict[tuple[str, int], Mapping[str, Any]] = {}
    for corner in facts["executed"]["corners"]:
        key = (corner["move"] if facts["sequence"] else "", corner["side"])
        if key not in worst or _rank(corner) > _rank(worst[key]):
            worst[key] = corner
    if not facts["sequence"]:
        return [corner for _, corner in sorted(worst.items())]
    return sorted(worst.values(), key=corner_excess, reverse=True)


def corner_name(corner: Mapping[str, Any], facts: Mapping[str, Any]) -> str:
    """Which of the corners of a run's JSON report it is."""
    side = f"{SIDES[corner['side']]} side"
    return f"{corner['move']}, {side}" if facts["sequence"] else side


def reductions(corners: Sequence[Mapping[str, Any]], facts: Mapping[str, Any]) -> list[str]:
    """Why less was planned than prescribed; of a sequence each reason once, with the first corner that has it."""
    found: dict[str, str] = {}
    for corner in corners:
        name, why = corner_name(corner, facts), reduced_text(corner["prescribed_m"], corner["planned_m"], corner["bound"])
        if why:
            found.setdefault(why if facts["sequence"] else name, f"{name}: {why}")
    return list(found.values())[:WORST]


def _rank(corner: Mapping[str, Any]) -> tuple[bool, float]:
    return corner["reached"], corner_excess(corner)


def corner_excess(corner: Mapping[str, Any]) -> float:
    """By how much the executed deviation of a corner of the JSON report exceeds the prescribed one [m]."""
    return float(corner["executed_m"] - corner["prescribed_m"])


def _print_corners(console: Console, facts: Mapping[str, Any], tolerance: float) -> None:
    """Planned and executed deviation side by side, and why less was planned than prescribed."""
    head = "corner deviation (mm)"
    table = Table(head, "prescribed", "planned", "executed", "kept in the machine", box=None, pad_edge=False)
    corners = worst_corners(facts)
    shown = corners[:WORST] if facts["sequence"] else corners
    for corner in shown:
        excess = corner_excess(corner) - tolerance
        verdict = _mark(excess <= 0.0) + ("" if excess <= 0.0 else f", by {1e3 * excess:.4f} mm")
        if not corner["reached"]:
            verdict = "[bold red]not reached[/]"
        table.add_row(
            corner_name(corner, facts),
            f"{1e3 * corner['prescribed_m']:g}",
            f"{1e3 * corner['planned_m']:.4f}",
            f"{1e3 * corner['executed_m']:.4f}",
            verdict,
        )
    others = corners[len(shown) :]
    if others:
        lost = sum(corner_excess(corner) > tolerance for corner in others)
        table.add_row(f"and {len(others)} more", "", "", "", _mark(not lost) + (f", {lost} of them" if lost else ""))
    console.print(table)
    for remark in [*reductions(corners, facts), f"tolerance {1e3 * tolerance:g} mm"]:
        console.print(remark, soft_wrap=True)


def print_run(
    console: Console,
    scenario: Scenario,
    run: Schedule,
    report: Mapping[str, Any],
    execution: Execution,
    checks: Sequence[Check],
) -> None:
    """The summary of a run and its JSON report: planned and executed deviation side by side, tracking, load, time, expectations."""
    console.print(scenario.title, style="bold", markup=False, soft_wrap=True)
    plan = run.operations[0].plan
    what = sequence_text(scenario, run) if scenario.parts else f"{1e3 * plan.duration:g} ms"
    console.print(f"law {plan.law.name} · {what} · {scenario.gains} drive gains · {payload_text(scenario)}", soft_wrap=True)
    _print_corners(console, report, deviation_tolerance(scenario))

    facts = Table.grid(padding=(0, 2))
    if scenario.feed and execution.arrival is not None:
        late = execution.arrival - run.operations[-1].clock_ms / 1e3 - run.operations[-1].plan.duration - run.waited
        facts.add_row("arrival, later than planned by the feed", f"{1e3 * execution.arrival:g} ms, {1e3 * late:g} ms")
    if run.waited:
        late_ones = sum(operation.waited_ms > 0.0 for operation in run.operations)
        facts.add_row("waited for plans", f"{1e3 * run.waited:g} ms, before {late_ones} of {len(run.operations)} operations")
    facts.add_row("largest excursion outside the right angles", f"{1e3 * execution.overshoot:.4f} mm")
    facts.add_row(
        "tracking error, largest",
        f"tcp {1e3 * execution.tracking_error_tcp_max:.4f} mm, joint {1e3 * execution.tracking_error_joint_max:.4f} mrad",
    )
    facts.add_row("motor torque, largest", "  ".join(f"{value:.2f}" for value in execution.motor_torque_max) + " N m")
    facts.add_row("motor torque, rms", "  ".join(f"{value:.2f}" for value in execution.motor_torque_rms) + " N m")
    work = zip(execution.motor_work, execution.motor_regenerated, strict=True)
    facts.add_row("motor work per operation (taken back)", "  ".join(f"{given:.1f} ({back:.1f})" for given, back in work) + " J")
    facts.add_row("motor load, largest (1 is rated)", "  ".join(f"{value:.3f}" for value in execution.motor_load_max))
    if execution.trip_time is not None:
        facts.add_row("[bold red]trip[/]", f"{trip_text(report['executed'])} at {1e3 * execution.trip_time:g} ms")
    timing = report["timing"]
    facts.add_row("step of both FMUs", f"median {timing['step_us']['p50']:.0f} us, 99 % {timing['step_us']['p99']:.0f} us")
    facts.add_row("real-time factor", f"{timing['real_time_factor']:.2f}")
    if timing["realtime"]:
        late, publishing = timing["lateness_us"], timing["publish_us"]
        facts.add_row("lateness", f"median {late['p50']:.1f} us, 99 % {late['p99']:.0f} us, largest {late['max']:.0f} us")
        bins = timing["lateness_histogram_us"]
        names = [*(f"<= {bound} us" for bound in bins["up_to"]), "later"]
        facts.add_row("", "  ".join(f"{name}: {count}" for name, count in zip(names, bins["count"], strict=True) if count))
        facts.add_row("handing a frame to the sinks", f"median {publishing['p50']:.1f} us, 99 % {publishing['p99']:.0f} us")
        facts.add_row("missed deadlines", _missed_text(timing))
    console.print(facts)

    print_checks(console, checks)


def found_text(value: float | str) -> str:
    """What was found, for people."""
    return f"{value:.5g}" if isinstance(value, float) else value


def print_checks(console: Console, checks: Sequence[Check]) -> None:
    """The scenario's expectations."""
    if not checks:
        return
    table = Table("expectation", "found", "expected", "", box=None, pad_edge=False)
    for check in checks:
        table.add_row(check.name, found_text(check.value), check.limit, _mark(check.ok))
    console.print(table)


def within(bins: Mapping[str, Any], share: float) -> str:
    """The bound of the histogram bin below which this share of the values lies, in words."""
    counts = np.cumsum(bins["count"])
    bound = int(np.searchsorted(counts, share * counts[-1]))
    return f"{100.0 * share:g} % within {bins['up_to'][bound]} us" if bound < len(bins["up_to"]) else "later"


def print_serving(console: Console, scenario: Scenario, facts: Mapping[str, Any]) -> None:
    """The summary of a cell that served."""
    console.print(scenario.title, style="bold", markup=False, soft_wrap=True)
    table = Table.grid(padding=(0, 2))
    table.add_row("steps", f"{facts['steps']}, {facts['steps'] * facts['communication_step_s']:.3f} s")
    told = [f"{command} {_outcomes(outcomes)}" for command, outcomes in facts["commands"].items() if outcomes]
    table.add_row("commands", "; ".join(told) or "none")
    if facts["plans"] is None:
        table.add_row("plans, corners, lateness", "not known: the tally is lost")
    else:
        _add_tally(table, facts)
    console.print(table)


def _add_tally(table: Table, facts: Mapping[str, Any]) -> None:
    """What the tally of a cell that served has counted."""
    plans, timing, executed = facts["plans"], facts["timing"], facts["executed"]
    table.add_row("plans", plans_text(plans))
    table.add_row("corners kept in the machine", f"{plans['corners_kept']} of {plans['corners']}")
    if plans["worst"]:
        table.add_row("worst corner", worst_corner(plans["worst"]))
    table.add_row("tracking error of the tool, largest", f"{1e3 * executed['tracking_error_tcp_max_m']:.4f} mm")
    if executed["trip_time_s"] is not None:
        table.add_row("[bold red]trip[/]", f"{trip_text(executed)} at {executed['trip_time_s']:.3f} s")
    table.add_row("step of both FMUs", f"{within(timing['step_histogram_us'], 0.99)}, largest {timing['step_max_us']:.0f} us")
    table.add_row("lateness", f"{within(timing['lateness_histogram_us'], 0.99)}, largest {timing['lateness_max_us']:.0f} us")
    table.add_row("missed deadlines", _missed_text(timing))


def trip_text(executed: Mapping[str, Any]) -> str:
    """Why the plant of a JSON report tripped, and at which axis where one is meant."""
    axis = f" of axis {executed['trip_axis']}" if executed["trip_axis"] else ""
    return f"{executed['trip']}{axis}"


def _missed_text(timing: Mapping[str, Any]) -> str:
    """The missed deadlines of a JSON report with their causes, and the steps that slipped."""
    causes = ", ".join(f"{cause} {count}" for cause, count in timing["missed_by"].items() if count)
    slipped = f"; {timing['slipped_steps']} steps slipped" if timing["slipped_steps"] else ""
    return f"{timing['missed_deadlines']}{': ' + causes if causes else ''}{slipped}"


def _outcomes(outcomes: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())


def plans_text(plans: Mapping[str, Any]) -> str:
    """What became of the plans of a cell that served; most are never cancelled."""
    cancelled = f", {plans['cancelled']} cancelled" if plans["cancelled"] else ""
    return f"{plans['accepted']} accepted, {plans['refused']} refused{cancelled}, {plans['arrived']} arrived"


def worst_corner(worst: Mapping[str, Any]) -> str:
    """The corner that exceeds what is prescribed most, in words."""
    return (
        f"{SIDES[worst['side']]} side of plan {worst['plan']}: {1e3 * worst['executed_m']:.4f} mm executed, "
        f"{1e3 * worst['planned_m']:.4f} planned, {1e3 * worst['prescribed_m']:g} prescribed"
    )
