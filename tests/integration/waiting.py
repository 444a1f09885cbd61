"""Waiting for what other threads and processes do."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
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
