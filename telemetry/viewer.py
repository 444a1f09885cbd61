"""The Rerun viewer, as a process of its own."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import rerun_cli
from rerun.experimental import ViewerClient

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.session import free_port

_STARTUP = 60.0  # software rendering on a busy machine takes some seconds [s]
_POLL = 0.05  # between two looks at a viewer that starts [s]


def rerun_binary() -> Path:
    """The program itself: the `rerun` script only starts it as a child, which would outlive an end of the script."""
    return Path(rerun_cli.__file__).with_name("rerun")


def rerun_environment() -> dict[str, str]:
    """The environment of a Rerun program that is started here: it stores and sends nothing on its use.

    The viewer and `rerun rrd` note in the user's home what they are used for, and from the second time on send it to its makers.
    Rerun 0.41 listens to no variable of its own against that, but to CI; its switch, `rerun analytics disable`, would change the
    user's other uses of Rerun. Recording itself notes nothing.
    """
    return {**os.environ, "CI": "true"}


class StartedViewer(NamedTuple):
    """A viewer that runs.

    Attributes:
        url: where it answers.
        process: outlives this one.
    """

    url: str
    process: subprocess.Popen[bytes]


def start_viewer(options: Sequence[str] = ()) -> StartedViewer:
    """Start a viewer that this machine alone can reach.

    Args:
        options: more of `rerun`'s, such as --headless.

    Raises:
        EnvironmentProblem: it does not start, for want of a screen for one.
    """
    port = free_port()
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    command = [
        str(rerun_binary()),
        "--bind",
        "127.0.0.1",
        "--port",
        str(port),
        "--hide-welcome-screen",
        "--expect-data-soon",
        *options,
    ]
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as complaints:  # a pipe would end with this process
        environment = {**rerun_environment(), "RUST_LOG": "error"}
        viewer = subprocess.Popen(command, stderr=complaints, stdout=subprocess.DEVNULL, env=environment, start_new_session=True)
        deadline = time.monotonic() + _STARTUP
        while viewer.poll() is None and time.monotonic() < deadline:
            try:
                ViewerClient.connect(url).get_state()
            except (ConnectionError, RuntimeError, TimeoutError):
                time.sleep(_POLL)
            else:
                return StartedViewer(url, viewer)
        viewer.kill()
        complaints.seek(0)
        last = (complaints.read().strip().splitlines() or ["it does not answer"])[-1]
    raise EnvironmentProblem(f"the Rerun viewer did not start: {last.removeprefix('Error: ')}")
