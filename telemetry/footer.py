"""The footer of a recording: Rerun's index of its chunks, without which a viewer cannot jump about in the file.

Rerun remembers one to three kilobytes of each chunk until it writes the footer: the memory of a recorder that leaves it to Rerun
grows without end. Here the footer is made from the file, by a process of its own. `rerun rrd filter`, told to filter nothing out,
writes the same bytes and then the footer; it holds a few chunks and the index, 3.5 MB for each minute at 1 kHz. Rerun's `optimize`
and `merge` hold the recording, 150 MB for each minute.
"""

from __future__ import annotations

import os
import subprocess
import warnings
from pathlib import Path

from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.viewer import rerun_binary, rerun_environment

_BLOCK = 1 << 20  # [bytes]


def has_footer(path: Path) -> bool:
    """Whether a file is a recording with its footer, which is the last thing to be written."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RerunWarning)  # of one without Rerun warns
        try:
            return bool(RrdReader(path).recordings())
        except (RerunWarning, RuntimeError, ValueError, OSError):
            return False


def add_footer(path: Path) -> None:
    """Append the footer to a recording that was written to its end without one.

    There need be no room for a copy, and who is killed meanwhile leaves a recording without a footer.

    Raises:
        EnvironmentProblem: the recording is not whole, or there is no room for the footer; the recording stays as it was.
    """
    try:
        footer = _footer_of(path)
        size = path.stat().st_size
        try:
            with path.open("ab") as recording:
                recording.write(footer)
        except OSError:
            os.truncate(path, size)
            raise
    except OSError as error:
        raise _problem(path, error.strerror or str(error)) from error


def repair(path: Path, repaired: Path) -> None:
    """Write what can be read of a recording whose writer was killed, perhaps within a message, as one with a footer.

    The original stays: its writer may still be at work.

    Raises:
        EnvironmentProblem: nothing can be read.
    """
    command = _filter(path, "--continue-on-error", "-o", str(repaired))
    done = subprocess.run(command, capture_output=True, check=False, env=_environment())
    if done.returncode != 0 or not has_footer(repaired):
        repaired.unlink(missing_ok=True)
        raise EnvironmentProblem(f"{path} is no recording, or nothing of it can be read")


def _footer_of(path: Path) -> bytes:
    """What the filter writes after the bytes of the recording, which must be the same: the footer tells where each chunk begins."""
    with (
        path.open("rb") as recording,
        subprocess.Popen(_filter(path), stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=_environment()) as program,
    ):
        assert program.stdout is not None
        assert program.stderr is not None
        while block := recording.read(_BLOCK):
            if program.stdout.read(len(block)) != block:
                program.kill()
                raise _problem(path, f"Rerun did not get beyond its first {recording.tell() - len(block)} bytes")
        footer = program.stdout.read()
        complaints = program.stderr.read().decode(errors="replace").strip().splitlines()
    if program.returncode != 0 or not footer:
        raise _problem(path, f"`rerun rrd filter` ended with {program.returncode}: {' '.join(complaints[-1:])}")
    return footer


def _filter(path: Path, *options: str) -> list[str]:
    return [str(rerun_binary()), "rrd", "filter", str(path.absolute()), *options]  # a name may begin with -


def _environment() -> dict[str, str]:
    return {**rerun_environment(), "RUST_LOG": "error"}


def _problem(path: Path, reason: str) -> EnvironmentProblem:
    return EnvironmentProblem(f"{path} is recorded, but without its index: {reason}; `deltaph view {path}` opens a copy with one")
