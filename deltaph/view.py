"""`deltaph view`: a recording, or a running cell, in the Rerun viewer."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from deltaph.errors import EnvironmentProblem
from deltaph.files import check_writable, replace

QUIET = "off"
"""Of Rerun's own log in this process: that the viewer was closed is said once, by deltaph."""


def view_file(file: Path, log: Console) -> int:
    """Open a recording and wait until the viewer is closed. Of one whose writer was killed, open a repaired copy, left beside it.

    Returns:
        the viewer's exit code.

    Raises:
        EnvironmentProblem: there is no such recording, or it cannot be read.
    """
    from deltaph.telemetry.footer import has_footer, repair
    from deltaph.telemetry.viewer import rerun_binary, rerun_environment

    if not file.is_file():
        raise EnvironmentProblem(f"there is no recording {file}: write one with `deltaph run SCENARIO --record {file}`")
    if not has_footer(file):
        repaired = file.with_suffix(".repaired.rrd")
        check_writable(repaired)
        replace(repaired, lambda path: repair(file, path))
        log.print(
            f"{file} was not finished: what could be read of it is in {repaired}, which is opened", style="dim", soft_wrap=True
        )
        file = repaired
    return subprocess.run([rerun_binary(), str(file), "--bind", "127.0.0.1"], check=False, env=rerun_environment()).returncode


def view_cell(cell: str, connect: Sequence[str], url: str | None, log: Console, zenoh_config: Path | None = None) -> None:
    """Show a cell while it runs, until it goes, the viewer is closed, or Ctrl-C. The viewer stays.

    Args:
        cell: name of the cell.
        connect: endpoints to connect to; the first that answers is taken.
        url: of a viewer that runs; None starts one.
        log: for what happens meanwhile.
        zenoh_config: a Zenoh configuration file.

    Raises:
        DeltaphError: there is no viewer, nothing answers, or the cell does not say what it runs.
    """
    os.environ.setdefault("RUST_LOG", QUIET)  # read once, when Rerun is imported
    from deltaph.record import follow_cell
    from deltaph.telemetry.destination import RunningViewer, ViewerGoneError
    from deltaph.telemetry.viewer import start_viewer

    if url is None:
        with log.status("starting the viewer"):
            url = start_viewer().url
    try:
        found = follow_cell(cell, connect, RunningViewer(url), log, zenoh_config)
    except ViewerGoneError as gone:
        found = str(gone)
    log.print(f"showed cell {cell}: {found}", style="dim", soft_wrap=True)
