"""`deltaph bench`, `soak`: what it costs, and what it withstands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from deltaph.cli.options import JsonOption, PriorityOption, tables, write_json
from deltaph.files import check_writable


def bench() -> None:
    """The benchmarks of the README: planning, stepping, co-simulating the paper's case, peers, the paper's claims on its cost."""
    from dataclasses import asdict

    from deltaph.bench import run_benchmarks
    from deltaph.claims import print_claims
    from deltaph.cost import cost_claims
    from deltaph.scenario import parse_scenario, template

    console, scenario = tables(), parse_scenario(template(), Path("paper.toml"))
    run_benchmarks(scenario, console)
    print_claims(console, [asdict(claim) for claim in cost_claims(scenario)], "What the paper says of its cost")


def soak(
    minutes: Annotated[float, typer.Option("--minutes", metavar="M", help="length of the undisturbed case")] = 10.0,
    priority: PriorityOption = None,
    json_file: JsonOption = None,
) -> None:
    """A cell in real time while its consumers stop, die and fail: what that costs the loop, and what is lost.

    The paper's case, there and back. Before each case a bare loop, without consumers, runs as long, for comparison. The first
    case has a subscriber and a recorder and is left alone for --minutes; all others take some three minutes together. The exit
    code is 1 where messages were lost for good, came out of order, service did not resume, or a case could not be run to its
    end; lateness is shown, not judged. Without a real-time priority the loops are late as well where they and the consumers want
    more processors than there are.

    Example: deltaph soak --minutes 0.5
    """
    from dataclasses import asdict

    from deltaph.soak import run_soak

    check_writable(json_file)
    found, ended = run_soak(minutes, priority, tables(json_file), Console(stderr=True))
    write_json(json_file, {"cases": [asdict(observed) for observed in found], "ended": ended})
    if ended or any(observed.failures for observed in found):
        raise typer.Exit(1)
