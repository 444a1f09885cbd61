"""Recordings whose writer was killed: without a footer, and perhaps with half a message at the end."""

from __future__ import annotations

import subprocess
import warnings
from pathlib import Path

from rerun.chunk import RrdReader

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.viewer import rerun_binary, rerun_environment


def is_whole(path: Path) -> bool:
    """Whether a recording has its footer, which is the last thing to be written."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            RrdReader(path).store()
        except (RuntimeError, ValueError, OSError):
            return False
    return True


def repair(path: Path, repaired: Path) -> None:
    """Write what can be read of a recording as a whole one. The original stays: its writer may still be at work.

    Raises:
        EnvironmentProblem: nothing can be read.
    """
    command = [str(rerun_binary()), "rrd", "optimize", "--continue-on-error", str(path), "-o", str(repaired)]
    done = subprocess.run(command, capture_output=True, check=False, env=rerun_environment())
    if done.returncode != 0 or not is_whole(repaired):
        repaired.unlink(missing_ok=True)
        raise EnvironmentProblem(f"{path} is no recording, or nothing of it can be read")
