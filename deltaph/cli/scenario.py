"""`deltaph init`, `schema`, `plan`: scenarios, and what is planned of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from deltaph.cli.options import CsvOption, JsonOption, ScenarioArgument, tables, write_json
from deltaph.errors import DeltaphError, ScenarioError
from deltaph.files import STDOUT, check_writable, replace, write_text


def init(file: Annotated[Path, typer.Argument(metavar="FILE", help="file to write")] = Path("scenario.toml")) -> None:
    """Write a commented scenario to start from: the paper's case."""
    from deltaph.scenario import template

    if file.exists():
        raise ScenarioError(f"{file} exists: give another name, or remove it first")
    check_writable(file)
    write_text(file, lambda stream: stream.write(template()))
    if file != STDOUT:
        typer.echo(f"wrote {file}: try `deltaph plan {file}`")


def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from deltaph.scenario_file import ScenarioFile

    typer.echo(json.dumps(ScenarioFile.model_json_schema(), indent=2))


def plan(
    scenario: ScenarioArgument,
    csv: CsvOption = None,
    sample_ms: Annotated[float, typer.Option("--sample-ms", metavar="MS", help="time between the rows of --csv")] = 1.0,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE.png", help="draw path, speeds, accelerations, jerks, torques"),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Plan only: report duration, corner deviation, peaks against their limits.

    Example: deltaph plan scenarios/paper.toml --plot paper.png
    """
    from deltaph.checks import evaluate_expectations, planned_values
    from deltaph.outputs import pass_columns, write_csv
    from deltaph.report import operation_facts, phase_facts, plan_facts, print_checks, print_plan, sequence_facts
    from deltaph.scenario import load_scenario
    from deltaph.schedule import schedule

    if not 1e-3 <= sample_ms < float("inf"):
        raise DeltaphError(f"--sample-ms is {sample_ms:g}: give a time of at least 0.001 ms")
    case = load_scenario(scenario)
    check_writable(csv, json_file, binary=[plot], inputs=[scenario])
    run = schedule(case)
    if plot is not None:
        from deltaph.plot import draw_plan, image_formats

        if plot.suffix.removeprefix(".") not in image_formats():
            raise DeltaphError(f"--plot {plot}: the name must end in one of .{', .'.join(image_formats())}")
        replace(plot, lambda path: draw_plan(run, case.limits, case.title, path))
    if csv is not None:
        time = run.grid(sample_ms)
        write_text(csv, lambda stream: write_csv(stream, {"time": time, **pass_columns(run, time)}))
    found = run.operations[0].plan
    facts = {
        "scenario": str(scenario),
        "law": case.law.name,
        "plan": plan_facts(found),
        "phases": phase_facts(found),
        "sequence": sequence_facts(case, run),
        "operations": operation_facts(run),
    }
    write_json(json_file, facts)

    console = tables(csv, json_file)
    print_plan(console, case, run)
    checks = evaluate_expectations(case.expect, planned_values(run))
    print_checks(console, checks)
    run.require_within(case.limits)
    if not all(check.ok for check in checks):
        raise typer.Exit(1)
