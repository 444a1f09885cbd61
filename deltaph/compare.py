"""`deltaph compare`: two recorded motions side by side, or the plan of one recording against what the machine made of it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from deltaph.errors import EnvironmentProblem
from deltaph.files import check_writable, replace
from deltaph.plan import Plan
from deltaph.scenario import Scenario, scenario_from_json
from deltaph.scene import corner_marks, scene_of
from deltaph.telemetry.comparison import Comparison
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
    check_writable(output)
    if output.exists() and any(path is not None and path.exists() and output.samefile(path) for path in (first, second)):
        raise EnvironmentProblem(f"{output} is one of the recordings: name another file with -o")
    readings = [Reading(path) for path in (first, second or first)]
    scenarios = [scenario_from_json(reading.scenario_json) for reading in readings]
    plans = [Plan.of(scenario) for scenario in scenarios]
    if second is None:
        names, roles = _ROLES, ("setpoint", "actual")
    else:
        names, roles = _names(readings), ("actual", "actual")
    scenes = [scene_of(scenario) for scenario in scenarios]
    sides = [
        Side(letter, name, reading, role, scene, _marks(reading, scene, plan, executed=role == "actual"))
        for letter, name, reading, role, scene, plan in zip("ab", names, readings, roles, scenes, plans, strict=True)
    ]
    figures = [
        _figures(scenario, plan, reading, executed=role == "actual")
        for scenario, plan, reading, role in zip(scenarios, plans, readings, roles, strict=True)
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


def _marks(reading: Reading, scene: Scene, plan: Plan, *, executed: bool) -> list[CornerMark]:
    """Where the motion comes closest to each vertex: the worst of all passes, or the plan's."""
    if executed:
        return corner_marks(reading.summary, scene) if reading.summary is not None else []
    move = scene.moves[0]
    nearest = [move.planned_path[np.argmin(np.linalg.norm(move.planned_path - vertex, axis=1))] for vertex in move.vertices]
    return [
        CornerMark(0, side, deviation, deviation, tuple(point.tolist()))
        for side, (deviation, point) in enumerate(zip(plan.corner_deviation, nearest, strict=True))
    ]


def _figures(scenario: Scenario, plan: Plan, reading: Reading, *, executed: bool) -> dict[str, float | str | None]:
    """What can be put side by side; None where the run ended before it was known."""
    peaks, summary = plan.peaks, reading.summary if executed else None
    figures: dict[str, float | str | None] = {
        "law": scenario.law.name,
        "drive gains": scenario.gains,
        "duration [ms]": 1e3 * plan.duration,
        **{f"prescribed deviation, {side} side [mm]": 1e3 * d for side, d in zip(_SIDES, plan.task.corner_deviation, strict=True)},
        **{f"planned deviation, {side} side [mm]": 1e3 * d for side, d in zip(_SIDES, plan.corner_deviation, strict=True)},
    }
    if executed:
        of_run = summary["executed"] if summary is not None else None
        for index, side in enumerate(_SIDES):
            found = [c["executed_m"] for c in of_run["corners"] if c["side"] == index] if of_run is not None else []
            figures[f"executed deviation, {side} side [mm]"] = 1e3 * max(found) if found else None
        figures["tracking error, tool [mm]"] = 1e3 * of_run["tracking_error_tcp_max_m"] if of_run is not None else None
        figures["motor torque, largest [N·m]"] = max(of_run["motor_torque_max_Nm"]) if of_run is not None else None
        figures["motor torque, rms [N·m]"] = max(of_run["motor_torque_rms_Nm"]) if of_run is not None else None
    figures |= {
        "planned joint velocity, peak [rad/s]": max(peaks.joint_velocity),
        "planned joint acceleration, peak [rad/s²]": max(peaks.joint_acceleration),
        "planned joint torque, peak [N·m]": max(peaks.joint_torque),
        "planned tool speed, peak [m/s]": peaks.tcp_speed,
        "planned tool acceleration, peak [m/s²]": peaks.tcp_acceleration,
    }
    if executed:
        missed = [c["name"] for c in summary["expect"] if not c["ok"]] if summary is not None else None
        figures["trip"] = summary["executed"]["trip"] if summary is not None else None
        figures["expectations"] = None if missed is None else ", ".join(f"{name} missed" for name in missed) or "all met"
    return figures


_SIDES = ("pick", "place")


def _markdown(facts: dict[str, Any], scenes: Sequence[Scene]) -> str:
    lines = []
    for letter in "ab":
        side = facts[letter]
        role = f" ({side['name']})" if side["name"] in _ROLES else ""
        verdict = ": **" + ". ".join(side["verdict"]) + "**" if side["verdict"] and role != f" ({_ROLES[0]})" else ""
        lines += [f"**{letter.upper()}** {side['title']}{role}{verdict}", ""]
    lines += ["| | A | B | B - A |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in _rows(facts)]
    lines += ["", "Of many passes the worst counts, here and at the corners. In plots of joints 1 is blue, 2 yellow, 3 green."]
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
    return "-" if value is None else f"{value:.4f}" if isinstance(value, float) else value


def _difference(x: float | str | None, y: float | str | None) -> str:
    if not isinstance(x, float) or not isinstance(y, float):
        return ""
    share = f" ({100.0 * (y / x - 1.0):+.1f} %)" if x else ""
    return f"{y - x:+.4f}{share}"
