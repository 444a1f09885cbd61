"""`deltaph command`: tells a cell that serves what to do."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltaph.cli.options import CellOption, ConnectOption, JsonOption, ZenohConfigOption, write_json
from deltaph.errors import DeltaphError, InfeasibleError
from deltaph.files import STDOUT, check_writable

if TYPE_CHECKING:
    from deltaph.telemetry import CommandClient, Reply


app = typer.Typer(
    help="Tell a cell that serves what to do, and wait for its answer; see `deltaph run --serve`.",
    epilog="Exit codes: 0 accepted, 2 no cell, busy, stopped, tripped or not understood, 3 the task cannot be planned.",
    no_args_is_help=True,
)


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
    write_json(json_file, reply.model_dump())
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


@app.command("ppo")
def ppo(
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


@app.command("hold")
def hold(connect: ConnectOption = None, cell: CellOption = "cell1", zenoh_config: ZenohConfigOption = None) -> None:
    """Stop on the path, with bounded jerk. What is accepted waits for `resume`; `stop` discards it."""
    _send(lambda client: client.hold(), connect, cell, zenoh_config)


@app.command("resume")
def resume(connect: ConnectOption = None, cell: CellOption = "cell1", zenoh_config: ZenohConfigOption = None) -> None:
    """Go on after hold or stop, at the feed that was set last."""
    _send(lambda client: client.resume(), connect, cell, zenoh_config)


@app.command("stop")
def stop(connect: ConnectOption = None, cell: CellOption = "cell1", zenoh_config: ZenohConfigOption = None) -> None:
    """As hold; what waits or is being planned is discarded, and every ppo is refused until `resume`, when what runs goes on."""
    _send(lambda client: client.stop(), connect, cell, zenoh_config)


@app.command("feed")
def feed(
    value: Annotated[float, typer.Argument(metavar="VALUE", help="0 to 1; 1 as planned")],
    connect: ConnectOption = None,
    cell: CellOption = "cell1",
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Slow the motion down on its path; under a hold it waits for `resume`.

    Example: deltaph command feed 0.5
    """
    if not 0.0 <= value <= 1.0:
        raise DeltaphError(f"VALUE is {value:g}: give a feed from 0, which stops on the path, to 1, which is as planned")
    _send(lambda client: client.feed(value), connect, cell, zenoh_config)
