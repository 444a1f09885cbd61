"""`deltaph record` and `deltaph view --live`: follow a cell over Zenoh, into the recording that `deltaph run --record` writes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console

from deltaph.errors import DeltaphError
from deltaph.recorder import finish, open_recorder, record_summary
from deltaph.scenario import scenario_from_json
from deltaph.telemetry import CellKeys, Destination, Subscriber


def follow_cell(
    cell: str, connect: Sequence[str], destination: Path | Destination, log: Console, zenoh_config: Path | None = None
) -> str:
    """Wait for a cell and follow it until it goes or Ctrl-C.

    Args:
        cell: name of the cell.
        connect: endpoints to connect to; the first that answers is taken; without any as `Subscriber` has it.
        destination: file to write, or another place.
        log: for what happens meanwhile.
        zenoh_config: a Zenoh configuration file.

    Returns:
        what came and what was lost on the way, in words.

    Raises:
        DeltaphError: nothing answers, the cell does not say what it runs, or the destination fails.
    """
    try:
        CellKeys(cell)
    except ValueError as error:
        raise DeltaphError(str(error)) from error
    with ExitStack() as stack:
        where = f" on {' or '.join(connect)}" if connect else ""
        with log.status(f"waiting for cell {cell}{where}"):
            subscriber = stack.enter_context(Subscriber(cell, connect, config=zenoh_config))
            subscriber.wait_for_cell()
            document = subscriber.ask("scenario")
            serves = bool(document.pop("serves", False))
            scenario = scenario_from_json(json.dumps(document))
        recorder = open_recorder(destination, scenario, serves=serves)
        stack.callback(finish, recorder, log)
        try:
            with log.status(f"following {scenario.title}"):
                for name, record in subscriber.messages():
                    recorder.take_message(name, record)
        except KeyboardInterrupt:
            log.print("interrupted: the recording ends here", style="dim", soft_wrap=True)
        if subscriber.summary is not None:
            record_summary(recorder, scenario, subscriber.summary)
    found = f"{subscriber.received['actual']} frames, {sum(subscriber.missing.values()) or 'no'} messages lost"
    return found if subscriber.summary is not None else f"{found}, without the cell's end"


def record_cell(cell: str, connect: Sequence[str], output: Path, log: Console, zenoh_config: Path | None = None) -> None:
    """Record a cell into a file.

    Raises:
        DeltaphError: as `follow_cell`.
    """
    found = follow_cell(cell, connect, output, log, zenoh_config)
    log.print(f"recorded {output}: {found}; open it with `deltaph view {output}`", style="dim", soft_wrap=True)
