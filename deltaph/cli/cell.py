"""`deltaph build`, `run`, `record`, `header`, `zenoh-config`: the FMUs, a cell that runs, and who follows it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from deltaph.cli.options import (
    CellOption,
    ConnectOption,
    CsvOption,
    JsonOption,
    PriorityOption,
    ScenarioArgument,
    ZenohConfigOption,
    tables,
    write_json,
)
from deltaph.errors import DeltaphError
from deltaph.files import check_writable, write_text

if TYPE_CHECKING:
    from deltaph.pacing import Undisturbed


def build(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="where to write")] = Path("dist"),
    fmi: Annotated[str, typer.Option("--fmi", metavar="2|3|all", help="FMI versions to build")] = "all",
    platform: Annotated[
        str,
        typer.Option("--platform", metavar="NAME", help="host, all, or one such as aarch64-linux (takes deltaph\\[cross])"),
    ] = "host",
) -> None:
    """Build the FMUs and the system descriptions from the C sources in the package.

    Example: deltaph build -o dist && fmpy info dist/DeltaPlanner.fmu
    """
    from deltaph.fmu import FMI_VERSIONS
    from deltaph.fmu import build as build_fmus

    versions = [version for version in FMI_VERSIONS if fmi in (str(version), "all")]
    if not versions:
        raise DeltaphError(f"--fmi is {fmi!r}: choose 2, 3 or all")
    for path in build_fmus(output, versions, platform):
        typer.echo(f"wrote {path}")


def run(
    scenario: ScenarioArgument,
    record: Annotated[Path | None, typer.Option("--record", metavar="FILE.rrd", help="write a Rerun recording")] = None,
    json_file: JsonOption = None,
    csv: CsvOption = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="keep the communication points on the clock; without it: as fast as possible")
    ] = False,
    priority: PriorityOption = None,
    cpu: Annotated[int | None, typer.Option("--cpu", metavar="N", help="processor for the step loop", min=0)] = None,
    cycles: Annotated[
        int | None,
        typer.Option("--cycles", metavar="N", help="there and back, or the sequence, N times", min=1, max=100_000),
    ] = None,
    telemetry: Annotated[bool, typer.Option("--telemetry/--no-telemetry", help="publish over Zenoh")] = True,
    connect: ConnectOption = None,
    listen: Annotated[
        list[str] | None,
        typer.Option("--listen", metavar="ENDPOINT", help="Zenoh endpoint to listen on (default tcp/127.0.0.1:7447)"),
    ] = None,
    wait_subscribers: Annotated[
        int,
        typer.Option(
            "--wait-subscribers", metavar="N", help="wait up to 60 s for N Zenoh sessions, at least one a subscriber", min=0
        ),
    ] = 0,
    zenoh_config: ZenohConfigOption = None,
    cell: Annotated[str | None, typer.Option("--cell", metavar="NAME", help="name of the cell, instead of the scenario's")] = None,
    serve: Annotated[
        bool,
        typer.Option(
            "--serve", help="rest at the scenario's pick point and wait for `deltaph command`, in real time, until Ctrl-C"
        ),
    ] = False,
) -> None:
    """The main job: co-simulate planner and plant, publish, record, report, and check the scenario's expectations.

    With --serve the scenario's task is not run: it says where the robot rests, and what a command leaves out. Who can reach the
    cell's endpoint can command it: by default only this machine. Without --serve a cell takes no commands.

    Example: deltaph run scenarios/paper.toml --record paper.rrd && deltaph view paper.rrd

    Example: deltaph run scenarios/paper.toml --serve   (then, elsewhere: deltaph command ppo --place 100,0,-800)
    """
    from deltaph.run import Options, run_scenario

    if serve:
        if not telemetry:
            raise DeltaphError("--serve takes its commands over Zenoh: leave out --no-telemetry")
        if cycles is not None:
            raise DeltaphError("--serve does what it is told, --cycles what the scenario says: choose one")
        if csv is not None:
            raise DeltaphError("--serve has no end to write a table at: use --record, and `deltaph export` afterwards")
        realtime = True
    if not telemetry and (connect or listen or wait_subscribers or zenoh_config or cell):
        raise DeltaphError(
            "--connect, --listen, --wait-subscribers, --zenoh-config, --cell need telemetry: leave out --no-telemetry"
        )
    if not realtime and (priority is not None or cpu is not None):
        raise DeltaphError("--realtime-priority and --cpu are for the real-time loop: add --realtime")
    check_writable(json_file, csv, binary=[record], inputs=[scenario, zenoh_config])
    options = Options(
        record=record,
        realtime=_undisturbed(priority, cpu) if realtime else None,
        cycles=cycles,
        telemetry=telemetry,
        connect=tuple(connect or ()),
        listen=tuple(listen or ()),
        wait_subscribers=wait_subscribers,
        zenoh_config=zenoh_config,
        cell=cell,
    )
    log = Console(stderr=True)
    if serve:
        from deltaph.serve import serve_scenario

        facts, errors = serve_scenario(scenario, options, tables(json_file), log)
        with _raised_behind(errors, log):
            write_json(json_file, facts)
        if facts["executed"]["trip_time_s"] is not None:
            raise typer.Exit(1)
        return
    result = run_scenario(scenario, options, tables(csv, json_file), log)
    with _raised_behind(result.errors, log):
        if csv is not None:
            from deltaph.outputs import frame_columns, write_csv

            write_text(csv, lambda stream: write_csv(stream, frame_columns(result.frames)))
        write_json(json_file, result.facts)
    if not result.ok:
        raise typer.Exit(1)


@contextmanager
def _raised_behind(errors: Sequence[DeltaphError], log: Console) -> Iterator[None]:
    """Write the outputs; then the first of the errors of sinks is raised, the others are said.

    Where an output cannot be written, that is raised, and all of them are said.
    """
    from deltaph.sinks import say

    unsaid = list(errors)
    try:
        yield
        if unsaid:
            raise unsaid.pop(0)
    finally:
        say(unsaid, log)


def _undisturbed(priority: int | None, cpu: int | None) -> Undisturbed:
    from deltaph.pacing import PRIORITY, Undisturbed, permitted_priority

    if priority is not None:
        return Undisturbed(priority, cpu)
    permitted = permitted_priority()
    if not permitted:
        reason = f"no real-time priority: it is not permitted (`ulimit -r {PRIORITY}`), and what else runs may delay the loop"
        Console(stderr=True).print(reason, style="dim", soft_wrap=True)
    return Undisturbed(permitted, cpu)


def record(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.rrd", help="recording to write")],
    connect: ConnectOption = None,
    cell: CellOption = "cell1",
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Record a running cell from another process: waits for it, subscribes over Zenoh, ends when the cell goes or on Ctrl-C.

    Example: deltaph record -o paper.rrd   (then, elsewhere: deltaph run scenarios/paper.toml --realtime --wait-subscribers 1)
    """
    from deltaph.record import record_cell

    check_writable(binary=[output], inputs=[zenoh_config])
    record_cell(cell, tuple(connect or ()), output, Console(stderr=True), zenoh_config)


def header() -> None:
    """Print a C header of the Zenoh messages, for subscribers in C and C++.

    Example: deltaph header > deltaph_messages.h
    """
    from deltaph.telemetry.c_header import c_header

    typer.echo(c_header(), nl=False)


def zenoh_config(
    whose: Annotated[str, typer.Argument(metavar="cell|client", help="for `deltaph run`, or for those who follow and command")],
) -> None:
    """Print a commented Zenoh configuration to start from: mutual TLS, and who may read and who may command.

    Options of the command line, --connect and --listen, go before what the file says, and the file before deltaph's defaults.

    Example: deltaph zenoh-config cell > cell.json5
    """
    from deltaph.telemetry.session import CONFIGURATIONS

    if whose not in CONFIGURATIONS:
        raise DeltaphError(f"there is no configuration for {whose!r}: choose {' or '.join(CONFIGURATIONS)}")
    typer.echo(CONFIGURATIONS[whose].read_text(encoding="utf-8"), nl=False)
