"""The other processes of `deltaph soak`: `python -m deltaph.soak_peer subscriber|router|flood|malformed ...`."""

from __future__ import annotations

import json
import random
import sys
import threading
import time
from collections.abc import Iterator
from itertools import repeat
from pathlib import Path

import numpy as np
import zenoh

from deltaph.execution import percentiles
from deltaph.telemetry import CellKeys, CommandClient, MessageName, Subscriber, open_client_session, open_router_session

STREAMING = "streaming"
"""The line that says that the first message, or the router, is there."""


MOST_STEPS = 1_000_000
"""A subscriber keeps what the timing says of so many, in memory that it has from the beginning: it is watched for growth."""

FLOOD_SECONDS = 8.0
"""Of commands as fast as they can be sent, one second after the first."""

MOST_COMMANDS = 50_000
"""In a flood."""

MOST_OPEN = 256
"""Commands of a flood that may be without an answer at any time."""


def _ready() -> None:
    print(STREAMING, flush=True)


def subscribe(endpoint: str, cell: str, report: Path) -> None:
    """Follow a cell to its end, and write what came: by message the first and last sequence number, how many, and in what order."""
    tally: dict[MessageName, dict[str, int]] = {}
    longest = 0
    kept = ("lateness", "publish")
    loop = np.full((MOST_STEPS, len(kept)), np.nan)
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
            if name == "timing" and 0 < sequence < MOST_STEPS:
                loop[sequence] = [record[what] for what in kept]
            if (seen := tally.get(name)) is None:
                tally[name] = {"first": sequence, "last": sequence, "out_of_order": 0}
            else:
                seen["out_of_order"] += sequence <= seen["last"]
                seen["last"] = max(sequence, seen["last"])
        for name, seen in tally.items():
            seen |= {"received": subscriber.received[name], "missing": subscriber.missing[name]}
        came = loop[~np.isnan(loop).any(axis=1)]
        facts = {
            "messages": tally,
            "longest_pause_s": longest * 1e-9,
            "summary": subscriber.summary is not None,
            **{f"{what}_us": percentiles(column) for what, column in zip(kept, came.T, strict=True)},
        }
    report.write_text(json.dumps(facts), encoding="utf-8")


def _malformed(seed: int = 1) -> Iterator[tuple[str, bytes]]:
    """Commands that are none, for ever: names with payloads."""
    chance = random.Random(seed)
    texts = (
        "{}",
        "[]",
        "null",
        '{"place": [0.1, 0.0]}',
        '{"place": [0.1, 0.0, NaN]}',
        '{"place": [0.1, 0.0, 1e400]}',
        '{"place": "here"}',
        '{"place": [0.1, 0.0, -0.8], "speed": 2}',
        '{"value": 2.0}',
        '{"value": "fast"}',
        '{"value": null}',
        "[" * 2000,
        '{"place": ' + "[" * 1000,
    )
    while True:
        yield "ppo", chance.choice(texts).encode()
        yield "ppo", chance.randbytes(chance.choice((1, 30, 4096, 4097, 100_000)))
        yield "feed", chance.choice(texts).encode()
        yield chance.choice(("hold", "resume", "stop")), b'{"now": true}'
        yield chance.choice(("fly", "*", "ppo.", "none")), b"{}"


def send_commands(endpoint: str, cell: str, report: Path, commands: Iterator[tuple[str, bytes]]) -> None:
    """Send commands as fast as they go, with a hold and a resume ten times a second, and write what became of them."""
    counts = {"sent": 0, "answered": 0, "accepted": 0, "ended": 0}
    holds: list[float] = []
    lock, keys = threading.Lock(), CellKeys(cell)
    room = threading.Semaphore(MOST_OPEN)
    ended = threading.Event()

    def on_reply(reply: zenoh.Reply) -> None:
        with lock:
            counts["answered"] += 1
            counts["accepted"] += reply.ok is not None and bool(json.loads(reply.ok.payload.to_bytes())["accepted"])

    def on_end() -> None:
        with lock:
            counts["ended"] += 1
        room.release()
        ended.set()

    with open_client_session([endpoint]) as session, CommandClient(cell, [endpoint]) as client:
        _ready()
        begin = time.monotonic()
        due = begin
        for name, payload in commands:
            if (now := time.monotonic()) - begin > FLOOD_SECONDS or counts["sent"] >= MOST_COMMANDS:
                break
            room.acquire()
            counts["sent"] += 1
            session.get(f"{keys.token}/command/{name}", zenoh.handlers.Callback(on_reply, on_end), payload=payload, timeout=10.0)
            if now >= due:
                due = now + 0.1
                client.hold()
                holds.append(time.monotonic() - now)
                client.resume()
        while counts["ended"] < counts["sent"]:
            ended.wait()
            ended.clear()
    facts = {**counts, "holds": len(holds), "hold_max_s": max(holds)}
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
        case ["flood", endpoint, cell, report]:
            send_commands(endpoint, cell, Path(report), repeat(("ppo", b'{"place": [0.1, 0.0, -0.8]}')))
        case ["malformed", endpoint, cell, report]:
            send_commands(endpoint, cell, Path(report), _malformed())
        case other:
            sys.exit(f"unknown peer: {other}")
