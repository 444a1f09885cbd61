"""The recorder of a cell: what of its scenario and of its report goes into the recording."""

from __future__ import annotations

import contextlib
import ctypes
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from deltaph.frame import Sink
from deltaph.scenario import Scenario
from deltaph.scene import corner_marks, scene_of, served_marks, served_scene
from deltaph.verdict import serving_markdown, summary_markdown

if TYPE_CHECKING:
    from deltaph.telemetry import Destination, Recorder

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE = 1 << 18  # what is given back as soon as it is freed [bytes]


def open_recorder(destination: Path | Destination, scenario: Scenario, *, serves: bool) -> Recorder:
    """Open a recording, in the process that is there for it.

    Args:
        destination: file to write, or another place.
        scenario: that is run.
        serves: the cell does what commands say.

    Raises:
        EnvironmentProblem: the file cannot be written.
    """
    from deltaph.telemetry import Recorder  # Rerun takes a second to import

    _keep_memory_flat()
    return Recorder(destination, served_scene(scenario) if serves else scene_of(scenario))


def _keep_memory_flat() -> None:
    """Have the arrays of a chunk given back once it is written.

    By itself the GNU C library takes what is freed for a reason to keep as much (mallopt(3), M_MMAP_THRESHOLD): it lies scattered
    over the heaps of all threads, 10 MB more after ten minutes.
    """
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE)


def record_summary(recorder: Recorder, scenario: Scenario, facts: Mapping[str, Any]) -> None:
    """Give a recorder the verdict, from the cell's JSON report."""
    document = json.dumps(facts)
    if recorder.scene.served:
        recorder.summary(serving_markdown(scenario, facts), document, served_marks(facts), served_scene(scenario, facts))
    else:
        recorder.summary(summary_markdown(scenario, facts), document, corner_marks(facts, recorder.scene))


def finish(recorder: Sink, log: Console) -> None:
    """Close a recorder, or the process that it is in: of a long recording this takes seconds."""
    with log.status("finishing the recording"):
        recorder.close()
