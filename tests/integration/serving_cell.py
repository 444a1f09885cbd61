"""A cell that serves, in a process of its own, and what it sends."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from integration.waiting import DEADLINE, wait_until
from numpy.typing import NDArray

from deltaph.telemetry import CommandClient, Message, MessageName, Reply, Subscriber, layout
from deltaph.telemetry.session import free_endpoint

DELTAPH = Path(sys.executable).with_name("deltaph")
CELL = "serving-cell"


class Serving:
    """The process.

    Attributes:
        endpoint: where it listens.
        said: its standard error.
        report: its JSON report, after `end`.
    """

    def __init__(self, process: subprocess.Popen[bytes], endpoint: str, directory: Path) -> None:
        self.process = process
        self.endpoint = endpoint
        self._directory = directory
        self.report: dict[str, Any] = {}

    @property
    def said(self) -> str:
        return (self._directory / "errors").read_text(encoding="utf-8")

    @property
    def printed(self) -> str:
        return (self._directory / "output").read_text(encoding="utf-8")

    def client(self) -> CommandClient:
        return CommandClient(CELL, [self.endpoint], timeout=DEADLINE)

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Ask it to end; returns its exit code."""
        self.process.send_signal(number)
        code = self.process.wait(DEADLINE)
        report = self._directory / "report.json"
        self.report = json.loads(report.read_text(encoding="utf-8")) if report.exists() else {}
        return code


@contextmanager
def serving(directory: Path, scenario: str, *options: str, endpoint: str | None = None) -> Iterator[Serving]:
    """A cell of its own, ready for commands; killed at the end at the latest."""
    file, endpoint = directory / "scenario.toml", endpoint or free_endpoint()
    file.write_text(scenario.replace("[run]", f'[run]\ncell = "{CELL}"').replace('cell = "cell1"', ""), encoding="utf-8")
    command = [str(DELTAPH), "run", str(file), "--serve", "--listen", endpoint, "--json", "report.json", *options]
    with (directory / "errors").open("wb") as errors, (directory / "output").open("wb") as output:
        process = subprocess.Popen(command, cwd=directory, stdout=output, stderr=errors)
    cell = Serving(process, endpoint, directory)
    try:
        wait_until(lambda: "takes commands" in cell.said or process.poll() is not None)
        assert process.poll() is None, cell.said
        yield cell
    finally:
        process.kill()
        process.wait()


class Following:
    """The messages of a cell as they come."""

    def __init__(self, subscriber: Subscriber) -> None:
        self.messages: dict[MessageName, list[np.void]] = {}
        self._subscriber = subscriber
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        message: Message
        for message in self._subscriber.messages():
            self.messages.setdefault(message.name, []).append(message.record)

    def of(self, name: MessageName) -> NDArray[np.void]:
        return np.array(self.messages.get(name, []), dtype=layout(name).dtype)

    def values(self, name: MessageName, group: str) -> NDArray[Any]:
        return layout(name).values(self.of(name), group)

    @property
    def time(self) -> float:
        """Simulation time of the newest setpoint [s]."""
        setpoints = self.messages.get("setpoint")
        return float(setpoints[-1]["time"]) if setpoints else -1.0

    def wait_for_time(self, until: float) -> None:
        wait_until(lambda: self.time >= until)

    def wait_for_arrival(self, reply: Reply) -> None:
        """Wait until an accepted plan, after which no other was accepted, has been run."""
        assert reply.plan is not None, reply
        count = reply.plan.count
        wait_until(lambda: any(plan["plan.count"] >= count for plan in self.messages.get("plan", ())))
        begun = self.messages["plan"][-1]["time"]
        wait_until(lambda: self.time > begun and self.messages["setpoint"][-1]["path.phase"] == 0)

    def missing(self) -> int:
        return sum(self._subscriber.missing.values())


@contextmanager
def following(cell: Serving) -> Iterator[Following]:
    """Follow a cell from now on."""
    with Subscriber(CELL, [cell.endpoint], timeout=DEADLINE, history=0) as subscriber:
        subscriber.wait_for_cell(DEADLINE)
        found = Following(subscriber)
        wait_until(lambda: found.messages.keys() >= {"setpoint", "actual", "timing"})
        yield found


@contextmanager
def session(cell: Serving) -> Iterator[zenoh.Session]:
    """A client that knows nothing of deltaph."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([cell.endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as opened:
        yield opened


def ask(opened: zenoh.Session, key: str, payload: bytes | None, timeout: float = DEADLINE) -> list[zenoh.Reply]:
    """All replies to a query."""
    collected: list[zenoh.Reply] = []
    complete = threading.Event()
    handler = zenoh.handlers.Callback(collected.append, complete.set)
    opened.get(key, handler, payload=payload, timeout=timeout)
    assert complete.wait(timeout + 5.0)
    return collected
