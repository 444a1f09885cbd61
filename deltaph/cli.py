"""The command line."""

from __future__ import annotations

import io
import json
import math
import os
import signal
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from deltaph.errors import DeltaphError, InfeasibleError, ScenarioError
from deltaph.files import STDOUT, check_writable, replace, write_text

if TYPE_CHECKING:
    from deltaph.telemetry import CommandClient, Reply

app = typer.Typer(
    name="deltaph",
    help="Pick-and-place of Delta robots on Pythagorean-hodograph corners that keep a prescribed deviation.",
    epilog="Exit codes: 0 fine, 1 expectation missed or trip, 2 wrong input or environment, 3 infeasible, 130 interrupted.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

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
    int,
    typer.Option("--realtime-priority", metavar="N", help="1 to 99: SCHED_FIFO for the step loop, memory locked", min=0, max=99),
]


def _tables(*outputs: Path | None) -> Console:
    """Where tables go: not to standard output when data goes there."""
    return Console(stderr=STDOUT in outputs, highlight=False)


def _write_json(path: Path | None, facts: dict[str, Any]) -> None:
    if path is not None:
        write_text(path, lambda stream: stream.write(json.dumps(facts, indent=2) + "\n"))


@app.callback(invoke_without_command=True)
def _root(show_version: Annotated[bool, typer.Option("--version", help="print the version and exit")] = False) -> None:
    if show_version:
        typer.echo(f"deltaph {version('deltaph')}")
        raise typer.Exit


@app.command()
def init(file: Annotated[Path, typer.Argument(metavar="FILE", help="file to write")] = Path("scenario.toml")) -> None:
    """Write a commented scenario to start from: the paper's case."""
    from deltaph.scenario import template

    if file.exists():
        raise ScenarioError(f"{file} exists: give another name, or remove it first")
    check_writable(file)
    write_text(file, lambda stream: stream.write(template()))
    if file != STDOUT:
        typer.echo(f"wrote {file}: try `deltaph plan {file}`")


@app.command()
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from deltaph.scenario_file import ScenarioFile

    typer.echo(json.dumps(ScenarioFile.model_json_schema(), indent=2))


@app.command()
def header() -> None:
    """Print a C header of the Zenoh messages, for subscribers in C and C++.

    Example: deltaph header > deltaph_messages.h
    """
    from deltaph.telemetry.c_header import c_header

    typer.echo(c_header(), nl=False)


@app.command("zenoh-config")
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


@app.command()
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
    _write_json(json_file, facts)

    console = _tables(csv, json_file)
    print_plan(console, case, run)
    checks = evaluate_expectations(case.expect, planned_values(run))
    print_checks(console, checks)
    run.require_within(case.limits)
    if not all(check.ok for check in checks):
        raise typer.Exit(1)


@app.command()
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


@app.command()
def run(
    scenario: ScenarioArgument,
    record: Annotated[Path | None, typer.Option("--record", metavar="FILE.rrd", help="write a Rerun recording")] = None,
    json_file: JsonOption = None,
    csv: CsvOption = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="keep the communication points on the clock; without it: as fast as possible")
    ] = False,
    priority: PriorityOption = 0,
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
        int, typer.Option("--wait-subscribers", metavar="N", help="wait up to 60 s until N Zenoh subscribers are there", min=0)
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
    from deltaph.pacing import Undisturbed
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
    if not realtime and (priority or cpu is not None):
        raise DeltaphError("--realtime-priority and --cpu are for the real-time loop: add --realtime")
    check_writable(json_file, csv, binary=[record], inputs=[scenario, zenoh_config])
    options = Options(
        record=record,
        realtime=Undisturbed(priority, cpu) if realtime else None,
        cycles=cycles,
        telemetry=telemetry,
        connect=tuple(connect or ()),
        listen=tuple(listen or ()),
        wait_subscribers=wait_subscribers,
        zenoh_config=zenoh_config,
        cell=cell,
    )
    if serve:
        from deltaph.serve import serve_scenario

        facts = serve_scenario(scenario, options, _tables(json_file), Console(stderr=True))
        _write_json(json_file, facts)
        if facts["executed"]["trip_time_s"] is not None:
            raise typer.Exit(1)
        return
    result = run_scenario(scenario, options, _tables(csv, json_file), Console(stderr=True))
    if csv is not None:
        from deltaph.outputs import frame_columns, write_csv

        write_text(csv, lambda stream: write_csv(stream, frame_columns(result.frames)))
    _write_json(json_file, result.facts)
    if not result.ok:
        raise typer.Exit(1)


@app.command()
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


command_app = typer.Typer(
    help="Tell a cell that serves what to do, and wait for its answer; see `deltaph run --serve`.",
    epilog="Exit codes: 0 accepted, 2 no cell, busy, stopped, tripped or not understood, 3 the task cannot be planned.",
    no_args_is_help=True,
)
app.add_typer(command_app, name="command")


def _send(
    send: Callable[[CommandClient], Reply],
    connect: list[str] | None,
    cell: str,
    zenoh_config: Path | None,
    json_file: Path | None = None,
) -> None:
    """Send a command, and say what became of it; a refusal is an error."""
    from deltaph.telemetry import CommandClient
    from deltaph.telemetry.commands import sentence

    check_writable(json_file, inputs=[zenoh_config])
    try:
        with CommandClient(cell, tuple(connect or ()), CONNECT_TIMEOUT, zenoh_config) as client:
            reply = send(client)
    except ValueError as error:
        raise DeltaphError(str(error)) from error
    _write_json(json_file, reply.model_dump())
    if not reply.accepted:
        reason = reply.reason or reply.outcome
        if reply.outcome == "infeasible" and reply.refused is not None:
            facts = reply.refused
            raise InfeasibleError(
                reason,
                status=facts.status,
                required=facts.required,
                available=facts.available,
                phase=facts.phase,
                joint=facts.joint,
            )
        raise DeltaphError(reason)
    if json_file != STDOUT:
        typer.echo(sentence(reply))


CONNECT_TIMEOUT = 5.0
"""Who commands does not wait for a cell to come [s]."""


def _millimetres(option: str, text: str | None, counts: tuple[int, ...]) -> tuple[float, ...] | None:
    """Lengths in millimetres, separated by commas, in metres."""
    if text is None:
        return None
    try:
        values = tuple(float(part) / 1000.0 for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in counts or not all(map(math.isfinite, values)):
        raise DeltaphError(f"{option} is {text!r}: give {' or '.join(map(str, counts))} lengths in mm, separated by commas")
    return values


@command_app.command("ppo")
def command_ppo(
    place: Annotated[str, typer.Option("--place", metavar="X,Y,Z", help="place point, mm")],
    pick: Annotated[
        str | None, typer.Option("--pick", metavar="X,Y,Z", help="pick point, mm; without it: where the robot rests")
    ] = None,
    lift: Annotated[str | None, typer.Option("--lift", metavar="H[,H]", help="lift height, mm; pick side, place side")] = None,
    corner_deviation: Annotated[
        str | None, typer.Option("--corner-deviation", metavar="D[,D]", help="prescribed corner deviation, mm")
    ] = None,
    payload: Annotated[float | None, typer.Option("--payload", metavar="M", help="mass that is carried, kg", min=0.0)] = None,
    dwell: Annotated[float | None, typer.Option("--dwell", metavar="T", help="rest before the motion, ms", min=0.0)] = None,
    json_file: JsonOption = None,
    connect: ConnectOption = None,
    cell: CellOption = "cell1",
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Plan a pick-and-place operation and run it; what is left out is the scenario's. One may wait while another runs.

    Example: deltaph command ppo --place 100,0,-800 --lift 50 --corner-deviation 6
    """
    from pydantic import ValidationError

    from deltaph.telemetry import PpoRequest

    def either(option: str, text: str | None) -> Any:
        values = _millimetres(option, text, (1, 2))
        return values[0] if values is not None and len(values) == 1 else values

    given = {
        "place": _millimetres("--place", place, (3,)),
        "pick": _millimetres("--pick", pick, (3,)),
        "lift": either("--lift", lift),
        "corner_deviation": either("--corner-deviation", corner_deviation),
        "payload": payload,
        "dwell": None if dwell is None else dwell / 1000.0,
    }
    try:
        request = PpoRequest(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        # what may be one value or a pair is found wrong twice, once for being the other
        wrong = next(one for one in error.errors() if one["type"] not in ("float_type", "tuple_type"))
        said = {"lift": lift, "corner_deviation": corner_deviation, "payload": payload, "dwell": dwell}[str(wrong["loc"][0])]
        option, message = str(wrong["loc"][0]).replace("_", "-"), wrong["msg"][0].lower() + wrong["msg"][1:]
        raise DeltaphError(f"--{option} is {said}: {message}") from error
    _send(lambda client: client.ppo(request), connect, cell, zenoh_config, json_file)


@command_app.command("hold")
def command_hold(connect: ConnectOption = None, cell: CellOption = "cell1", zenoh_config: ZenohConfigOption = None) -> None:
    """Stop on the path, with bounded jerk. What is accepted waits for `resume`; `stop` discards it."""
    _send(lambda client: client.hold(), connect, cell, zenoh_config)


@command_app.command("resume")
def command_resume(connect: ConnectOption = None, cell: CellOption = "cell1", zenoh_config: ZenohConfigOption = None) -> None:
    """Go on after hold or stop, at the feed that was set last."""
    _send(lambda client: client.resume(), connect, cell, zenoh_config)


@command_app.command("stop")
def command_stop(connect: ConnectOption = None, cell: CellOption = "cell1", zenoh_config: ZenohConfigOption = None) -> None:
    """As hold; what waits or is being planned is discarded, and every ppo is refused until `resume`, when what runs goes on."""
    _send(lambda client: client.stop(), connect, cell, zenoh_config)


@command_app.command("feed")
def command_feed(
    value: Annotated[float, typer.Argument(metavar="VALUE", help="0 to 1; 1 as planned", min=0.0, max=1.0)],
    connect: ConnectOption = None,
    cell: CellOption = "cell1",
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Slow the motion down on its path; under a hold it waits for `resume`.

    Example: deltaph command feed 0.5
    """
    _send(lambda client: client.feed(value), connect, cell, zenoh_config)


@app.command()
def view(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE.rrd]", help="recording to open", show_default=False)] = None,
    live: Annotated[bool, typer.Option("--live", help="show a running cell instead: the same, while it happens")] = False,
    connect: ConnectOption = None,
    cell: CellOption = "cell1",
    url: Annotated[
        str | None,
        typer.Option(
            "--url", metavar="URL", help="a viewer that runs, rerun+http://127.0.0.1:9876/proxy for one; without it: a new one"
        ),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Open a recording in the Rerun viewer, or show a running cell. The viewer of a cell stays when the cell goes.

    A recording whose writer was killed is opened as a repaired copy, which is left beside it.

    Example: deltaph view paper.rrd
    Example: deltaph view --live   (then, elsewhere: deltaph run scenarios/paper.toml --realtime --wait-subscribers 1)
    """
    from deltaph.view import view_cell, view_file

    if (file is not None) == live:
        raise DeltaphError("give either a recording, FILE.rrd, or --live")
    if file is not None:
        if connect or url or zenoh_config:
            raise DeltaphError(
                "--connect, --zenoh-config and --url are for a running cell: add --live, and leave out the recording"
            )
        raise typer.Exit(view_file(file, Console(stderr=True)))
    view_cell(cell, tuple(connect or ()), url, Console(stderr=True), zenoh_config)


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(metavar="A.rrd", help="recording A")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.rrd", help="recording to write")],
    second: Annotated[
        Path | None,
        typer.Argument(metavar="[B.rrd]", help="recording B; without it: A's plan against its plant", show_default=False),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Compare two recordings: aligned on time and on the path, differences plotted, verdicts side by side.

    Example: deltaph compare paper.rrd time_optimal.rrd -o both.rrd && deltaph view both.rrd
    """
    from deltaph.compare import compare as compare_recordings
    from deltaph.compare import print_comparison

    check_writable(json_file, binary=[output], inputs=[first, second])
    facts = compare_recordings(first, second, output)
    _write_json(json_file, facts)
    print_comparison(_tables(json_file), facts)
    Console(stderr=True).print(f"wrote {output}: open it with `deltaph view {output}`", style="dim", soft_wrap=True)


@app.command()
def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.rrd", help="recording to read")],
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="write CSV; - is standard output")] = None,
    parquet: Annotated[Path | None, typer.Option("--parquet", metavar="FILE", help="write Parquet")] = None,
    entity: Annotated[
        str | None,
        typer.Option("--entity", metavar="ENTITY", help="only this one, such as joint/position/actual; without it: all, by time"),
    ] = None,
) -> None:
    """Write the signals of a recording as a table, under the names and in the units of `deltaph run --csv`.

    Without --entity all signals are joined on sim_time, which counts nanoseconds; the values are the run's to the last bit.
    Phase and trip are the numbers of their enumerations; operations count from 1, 0 is none. What is not
    recorded (plan.*, the plant's own tracking errors) is absent.

    Example: deltaph export paper.rrd --parquet paper.parquet --csv paper.csv
    """
    from deltaph.export import export as columns_of
    from deltaph.export import write

    if csv is None and parquet is None:
        raise DeltaphError("nothing to write: give --csv FILE, --parquet FILE or both")
    check_writable(csv, binary=[parquet], inputs=[file])
    write(columns_of(file, entity), csv, parquet)


@app.command()
def paper(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.rrd", help="recording to write")],
    json_file: JsonOption = None,
) -> None:
    """The paper's section 4: figures 4 to 8 for both methods in a recording, and its claims beside what is measured here and now.

    Example: deltaph paper -o paper.rrd && deltaph view paper.rrd
    """
    from deltaph.claims import print_claims
    from deltaph.paper import section_4

    check_writable(json_file, binary=[output])
    with Console(stderr=True).status("planning and co-simulating both methods"):
        facts = section_4(output)
    _write_json(json_file, facts)
    print_claims(_tables(json_file), facts["claims"], "The paper's section 4")
    Console(stderr=True).print(f"wrote {output}: open it with `deltaph view {output}`", style="dim", soft_wrap=True)


@app.command()
def bench() -> None:
    """The benchmarks of the README: planning, stepping, co-simulating the paper's case, peers, the paper's claims on its cost."""
    from dataclasses import asdict

    from deltaph.bench import run_benchmarks
    from deltaph.claims import print_claims
    from deltaph.cost import cost_claims
    from deltaph.scenario import parse_scenario, template

    console, scenario = _tables(), parse_scenario(template(), Path("paper.toml"))
    run_benchmarks(scenario, console)
    print_claims(console, [asdict(claim) for claim in cost_claims(scenario)], "What the paper says of its cost")


@app.command()
def soak(
    minutes: Annotated[float, typer.Option("--minutes", metavar="M", help="length of the undisturbed case")] = 10.0,
    priority: PriorityOption = 0,
    json_file: JsonOption = None,
) -> None:
    """A cell in real time while its consumers stop, die and fail: what that costs the loop, and what is lost.

    The paper's case, there and back. Each case runs beside a bare loop, without consumers, for comparison. The first has a
    subscriber and a recorder and is left alone for --minutes; the others take two minutes together. The exit code is 1 where
    messages were lost for good, came out of order, or service did not resume; lateness is shown, not judged. With a real-time
    priority the loops are disturbed by their own process alone, and not by how many processors the consumers keep busy.

    Example: deltaph soak --minutes 0.5 --realtime-priority 50
    """
    from dataclasses import asdict

    from deltaph.soak import run_soak

    check_writable(json_file)
    found = run_soak(minutes, priority, _tables(json_file), Console(stderr=True))
    _write_json(json_file, {"cases": [asdict(observed) for observed in found]})
    if any(observed.failures for observed in found):
        raise typer.Exit(1)


INTERRUPTED = 130  # 128 + SIGINT, as shells have it

UsageError: Any = typer.BadParameter.__bases__[0]  # typer carries its parser inside and exports only this one of its errors


def main() -> None:
    """Entry point: every failure is one line on standard error and an exit code."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup's wish to ignore one is kept
            signal.signal(number, signal.default_int_handler)  # end as Ctrl-C does: with a readable recording
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by who started us; a file that is opened must not get its number
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115, it stays open
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    code = 2
    try:
        code, line = _outcome()
        if line:
            print("deltaph: " + " ".join(line.split()), file=sys.stderr, flush=True)
    except BrokenPipeError:  # the reader of our output has gone, and nobody is left to tell, nor when Python flushes at its end
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.__stdout__, sys.__stderr__):
            if stream is not None:
                os.dup2(nowhere, stream.fileno())
    sys.exit(code)


def _outcome() -> tuple[int, str]:
    """Do what the arguments say; the exit code, and what is to be said of a failure.

    Raises:
        BrokenPipeError: who reads standard output or standard error has gone.
    """
    try:
        code = app(standalone_mode=False) or 0
        sys.stdout.flush()
    except InfeasibleError as error:
        return error.exit_code, f"infeasible: {error}"
    except DeltaphError as error:
        return error.exit_code, f"error: {error}"
    except UsageError as error:
        message = error.format_message().strip()  # empty where the help has been shown instead
        return 2, f"usage: {message}" if message else ""
    except BrokenPipeError:
        raise
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        return 2, f"error: the system refuses{where}: {error.strerror or error}"
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED, "interrupted"
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # typer and rich answer it with the code of a missed expectation
            raise end.__context__ from None
        raise
    return code, "interrupted" if code == INTERRUPTED else ""  # typer makes the code of Ctrl-C
