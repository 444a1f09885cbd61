"""Waiting for what other threads and processes do."""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

DEADLINE = 60.0
"""Of what takes a moment on a machine that is free [s]."""


def wait_until(condition: Callable[[], object], process: subprocess.Popen[Any] | None = None) -> None:
    """Wait for a condition.

    Args:
        condition: asked every few milliseconds.
        process: whose doing it is; it must not end before.
    """
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < deadline, "it does not come"
        assert process is None or process.poll() is None, "the process ended"
        time.sleep(0.002)


def size(path: Path) -> int:
    """Of a file [bytes]; 0 where there is none: whoever looks whether it can be written makes one for a moment."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def sink_processes(run: subprocess.Popen[Any], count: int) -> list[int]:
    """The processes of the sinks of a run, once so many are there, in the order in which it has started them."""
    found: list[tuple[int, int]] = []

    def started() -> bool:
        found.clear()
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # it ended meanwhile
                stat = (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
                if int(stat[1]) == run.pid and b"spawn_main" in (process / "cmdline").read_bytes():
                    found.append((int(stat[19]), int(process.name)))
        return len(found) == count

    wait_until(started, run)
    return [pid for _, pid in sorted(found)]
