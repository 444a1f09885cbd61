"""The other processes of `deltaph soak`: `python -m deltaph.soak_peer subscriber|router ...`. They end when they are told to."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from deltaph.telemetry import MessageName, Subscriber, open_router_session

STREAMING = "streaming"
"""The line that says that the first message, or the router, is there."""


def _ready() -> None:
    print(STREAMING, flush=True)


def subscribe(endpoint: str, cell: str, report: Path) -> None:
    """Follow a cell to its end, and write what came: by message the first and last sequence number, how many, and in what order."""
    tally: dict[MessageName, dict[str, int]] = {}
    longest = 0
    with Subscriber(cell, [endpoint]) as subscriber:
        subscriber.wait_for_cell()
        before = 0
        for name, record in subscriber.messages():
            now = time.monotonic_ns()
            if before:
                longest = max(longest, now - before)
            else:
                _ready()
            before = now
            sequence = int(record["sequence"])
            if (seen := tally.get(name)) is None:
                tally[name] = {"first": sequence, "last": sequence, "out_of_order": 0}
            else:
                seen["out_of_order"] += sequence <= seen["last"]
                seen["last"] = max(sequence, seen["last"])
        for name, seen in tally.items():
            seen |= {"received": subscriber.received[name], "missing": subscriber.missing[name]}
        facts = {"messages": tally, "longest_pause_s": longest * 1e-9, "summary": subscriber.summary is not None}
    report.write_text(json.dumps(facts), encoding="utf-8")


def route(endpoint: str) -> None:
    """A Zenoh router, until killed."""
    with open_router_session([endpoint]):
        _ready()
        sys.stdin.read()


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["subscriber", endpoint, cell, report]:
            subscribe(endpoint, cell, Path(report))
        case ["router", endpoint]:
            route(endpoint)
        case other:
            sys.exit(f"unknown peer: {other}")
