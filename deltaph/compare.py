"""`deltaph compare`: two recorded motions side by side, or the plan of one recording against what the machine made of it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from deltaph.errors import EnvironmentProblem
from deltaph.files import replace
from deltaph.report import SIDES, corner_excess
from deltaph.scenario import Scenario, scenario_from_json
from deltaph.scene import corner_marks, scene_of
from deltaph.schedule import Operation, Schedule, schedule
from deltaph.telemetry.comparison import Comparison
from deltaph.telemetry.corner import worst
from deltaph.telemetry.reading import Reading
from deltaph.telemetry.scene import CornerMark, Scene
from deltaph.telemetry.side import Side

_ROLES = ("planned", "executed")

_NAME_LENGTH = 32
"""A longer title does not fit into a legend."""


def compare(first: Path, second: Path | None, output: Path) -> dict[str, Any]:
    """Write the comparison of two recordings, or of one recording's plan and plant.

    Args:
        first: recording A.
        second: recording B; None compares A's plan with its execution.
        output: recording to write.

    Returns:
        title, file and figures of both.

    Raises:
        DeltaphError: one is no recording of deltaph, or the output cannot be written.
    """
    readings = [Reading(path) for path in (first, second or first)]
    for reading in readings:
        if "commands" in (reading.summary or {}):
            raise EnvironmentProblem(
                f"{reading.path} is of a cell that served: its plans come from commands, not from its scenario"
            )
    scenarios = [scenario_from_json(reading.scenario_json) for reading in readings]
    runs = [schedule(scenario) for scenario in scenarios]
    if second is None:
        names, roles = _ROLES, ("setpoint", "actual")
    else:
        names, roles = _names(readings), ("actual", "actual")
    scenes = [scene_of(scenario) for scenario in scenarios]
    sides = [
        Side(letter, name, reading, role, scene, _marks(reading, scene, run.one_pass, executed=role == "actual"))
        for letter, name, reading, role, scene, run in zip("ab", names, readings, roles, scenes, runs, strict=True)
    ]
    figures = [
        _figures(scenario, run, reading, executed=role == "actual")
        for scenario, run, reading, role in zip(scenarios, runs, readings, roles, strict=True)
    ]
    facts = {
        letter: {"name": name, "title": reading.title, "file": str(reading.path), "verdict": reading.headlines, "figures": found}
        for letter, name, reading, found in zip("ab", names, readings, figures, strict=True)
    }
    comparison = Comparison((sides[0], sides[1]), _markdown(facts, scenes), json.dumps(facts))
    replace(output, comparison.write)
    return facts


def _names(readings: list[Reading]) -> tuple[str, str]:
    """Short names from the titles; from the files where the titles are the same."""
    titles = [reading.title for reading in readings]
    if titles[0] == titles[1]:
        titles = [reading.path.stem for reading in readings]
    short = [title if len(title) <= _NAME_LENGTH else title[: _NAME_LENGTH - 1].rstrip() + "…" for title in titles]
    return short[0], short[1]


def _of_side(operation: Operation, deviations: Sequence[float], side: int) -> float:
    """Of deviations in path order the one on the pick (0) or the place side (1); a return begins at the place side."""
    return float(deviations[side ^ operation.move.is_return])


def _marks(reading: Reading, scene: Scene, operations: Sequence[Operation], *, executed: bool) -> list[CornerMark]:
    """Where the motion comes closest to each vertex: the worst of all passes, or of the plans."""
    if executed:
        return worst(scene, corner_marks(reading.summary, scene)) if reading.summary is not None else []
    marks = []
    for side in (0, 1):
        planned = [_of_side(operation, operation.plan.corner_deviation, side) for operation in operations]
        number = int(np.argmax(planned))
        path, vertex = scene.moves[number].planned_path, scene.moves[number].vertices[side]
        nearest = path[np.argmin(np.linalg.norm(path - vertex, axis=1))]
        marks.append(CornerMark(number, side, planned[number], planned[number], tuple(nearest.tolist())))
    return marks


def _figures(scenario: Scenario, run: Schedule, reading: Reading, *, executed: bool) -> dict[str, float | str | None]:
    """What can be put side by side, the worst of all operations; None where the run ended before it was known."""
    plans, summary = [operation.plan for operation in run.one_pass], reading.summary if executed else None
    figures: dict[str, float | str | None] = {
        "law": scenario.law.name,
        "drive gains": scenario.gains,
        "duration [ms]": float(run.pass_ms),
        **({"parts a minute": run.parts_per_minute} if scenario.parts else {}),
    }
    for word in ("prescribed", "planned"):
        for index, side in enumerate(SIDES):
            figures[f"{word} deviation, {side} side [mm]"] = 1e3 * max(
                _of_side(o, o.plan.task.corner_deviation if word == "prescribed" else o.plan.corner_deviation, index)
                for o in run.one_pass
            )
    of_run = summary["executed"] if summary is not None else None
    beyond = [d - p for o in run.one_pass for d, p in zip(o.plan.corner_deviation, o.plan.task.corner_deviation, strict=True)]
    if executed:
        beyond = [corner_excess(corner) for corner in of_run["corners"] if corner["reached"]] if of_run is not None else []
    figures["beyond the prescribed deviation, worst corner [mm]"] = 1e3 * max(beyond) if beyond else None
    if executed:
        for index, side in enumerate(SIDES):
            corners = of_run["corners"] if of_run is not None else []
            found = [corner["executed_m"] for corner in corners if corner["side"] == index and corner["reached"]]
            figures[f"executed deviation, {side} side [mm]"] = 1e3 * max(found) if found else None
        figures["tracking error, tool [mm]"] = 1e3 * of_run["tracking_error_tcp_max_m"] if of_run is not None else None
        figures["motor torque, largest [N·m]"] = max(of_run["motor_torque_max_Nm"]) if of_run is not None else None
        figures["motor torque, rms [N·m]"] = max(of_run["motor_torque_rms_Nm"]) if of_run is not None else None
    figures |= {
        "planned joint velocity, peak [rad/s]": max(max(plan.peaks.joint_velocity) for plan in plans),
        "planned joint acceleration, peak [rad/s²]": max(max(plan.peaks.joint_acceleration) for plan in plans),
        "planned joint torque, peak [N·m]": max(max(plan.peaks.joint_torque) for plan in plans),
        "planned tool speed, peak [m/s]": max(plan.peaks.tcp_speed for plan in plans),
        "planned tool acceleration, peak [m/s²]": max(plan.peaks.tcp_acceleration for plan in plans),
    }
    if executed:
        missed = [c["name"] for c in summary["expect"] if not c["ok"]] if summary is not None else None
        figures["trip"] = summary["executed"]["trip"] if summary is not None else None
        figures["expectations"] = None if missed is None else ", ".join(f"{name} missed" for name in missed) or "all met"
    return figures


def _markdown(facts: dict[str, Any], scenes: Sequence[Scene]) -> str:
    lines = []
    for letter in "ab":
        side = facts[letter]
        role = f" ({side['name']})" if side["name"] in _ROLES else ""
        verdict = ": **" + ". ".join(side["verdict"]) + "**" if side["verdict"] and role != f" ({_ROLES[0]})" else ""
        lines += [f"**{letter.upper()}** {side['title']}{role}{verdict}", ""]
    lines += ["| | A | B | B - A |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in _rows(facts)]
    lines += [
        "",
        "Of many operations and passes the worst counts, here and at the corners. In plots of joints 1 is blue, 2 yellow, 3 green.",
    ]
    if all(scene.coinciding_joints == (2, 3) for scene in scenes):
        lines[-1] += " Joints 2 and 3 move alike: 3 lies on 2, whose rim is seen."
    lines[-1] += (
        " On the timeline `sim_time` both begin together; along the path they are compared where their planned paths have the same "
        "length, as on the timeline `arc_length_um` (bottom left), which counts thousandths of a millimetre."
    )
    return "\n".join(lines) + "\n"


def print_comparison(console: Console, facts: dict[str, Any]) -> None:
    """The figures side by side."""
    for letter in "ab":
        console.print(f"{letter.upper()}: {facts[letter]['title']} ({facts[letter]['file']})", markup=False, soft_wrap=True)
    table = Table("", "A", "B", "B - A", box=None, pad_edge=False)
    for row in _rows(facts):
        table.add_row(*map(escape, row))
    console.print(table)


def _rows(facts: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    a, b = facts["a"]["figures"], facts["b"]["figures"]
    for key in dict.fromkeys((*a, *b)):
        x, y = a.get(key), b.get(key)
        yield key, _shown(x), _shown(y), _difference(x, y)


def _shown(value: float | str | None) -> str:
    return "-" if value is None else value if isinstance(value, str) else f"{value:.5g}" if abs(value) >= 1e-9 else "0"


def _difference(x: float | str | None, y: float | str | None) -> str:
    if not isinstance(x, float) or not isinstance(y, float):
        return ""
    if math.isclose(x, y, rel_tol=1e-9, abs_tol=1e-9):
        return "0"
    share = f" ({100.0 * (y / x - 1.0):+.1f} %)" if x > 1e-9 and y < 10.0 * x else ""  # beyond, a share tells nobody anything
    return (f"{y - x:+.3g}" if abs(y - x) < 1e3 else f"{y - x:+.0f}") + share
