"""The command line: its commands in order, and what becomes of their failures."""

from __future__ import annotations

import io
import os
import signal
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

from deltaph.cli import cell, command, measurement, recording, scenario
from deltaph.errors import DeltaphError, InfeasibleError

app = typer.Typer(
    name="deltaph",
    help="Pick-and-place of Delta robots on Pythagorean-hodograph corners that keep a prescribed deviation.",
    epilog="Exit codes: 0 fine, 1 expectation missed or trip, 2 wrong input or environment, 3 infeasible, 130 interrupted.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def _root(show_version: Annotated[bool, typer.Option("--version", help="print the version and exit")] = False) -> None:
    if show_version:
        typer.echo(f"deltaph {version('deltaph')}")
        raise typer.Exit


app.command()(scenario.init)
app.command()(scenario.schema)
app.command()(scenario.plan)
app.command()(cell.build)
app.command()(cell.run)
app.command()(cell.record)
app.add_typer(command.app, name="command")
app.command()(recording.view)
app.command()(recording.compare)
app.command()(recording.export)
app.command()(recording.paper)
app.command()(cell.header)
app.command("zenoh-config")(cell.zenoh_config)
app.command()(measurement.bench)
app.command()(measurement.soak)


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
