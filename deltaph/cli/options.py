"""What several commands have in common."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from deltaph.files import STDOUT, write_text

ScenarioArgument = Annotated[
    Path, typer.Argument(metavar="SCENARIO", help="scenario file (TOML); see `deltaph init` and `deltaph schema`")
]
JsonOption = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write the report as JSON; - is standard output")]
CsvOption = Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="write a table of all outputs; - is standard output")]
ConnectOption = Annotated[
    list[str] | None, typer.Option("--connect", metavar="ENDPOINT", help="Zenoh endpoint to connect to, such as tcp/127.0.0.1:7447")
]
CellOption = Annotated[str, typer.Option("--cell", metavar="NAME", help="name of the cell")]
ZenohConfigOption = Annotated[
    Path | None,
    typer.Option("--zenoh-config", metavar="FILE.json5", help="Zenoh configuration, such as TLS; see `deltaph zenoh-config`"),
]
PriorityOption = Annotated[
    int | None,
    typer.Option(
        "--realtime-priority",
        metavar="N",
        help="1 to 99: SCHED_FIFO for the step loop, memory locked; 0: none; without it 50 where the system permits it",
        min=0,
        max=99,
        show_default=False,
    ),
]


PIPE_WIDTH = 132
"""Columns of text for a file or a pipe, unless COLUMNS says how many: no table is cut off."""


def tables(*outputs: Path | None) -> Console:
    """Where tables go: not to standard output when data goes there."""
    console = Console(stderr=STDOUT in outputs, highlight=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = PIPE_WIDTH
    return console


def write_json(path: Path | None, facts: dict[str, Any]) -> None:
    """Write a report, where one is asked for."""
    if path is not None:
        write_text(path, lambda stream: stream.write(json.dumps(facts, indent=2) + "\n"))
