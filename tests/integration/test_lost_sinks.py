"""What becomes of a cell that loses one of its sinks: real processes, killed."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from integration.serving_cell import Serving, following, serving
from integration.waiting import DEADLINE, sink_processes, size, wait_until

from deltaph.scenario import template
from deltaph.telemetry import PpoRequest
from deltaph.telemetry.footer import has_footer
from deltaph.telemetry.reading import Reading
from deltaph.telemetry.session import free_endpoint

PAPER = Path(__file__).parents[2] / "scenarios" / "paper.toml"
DELTAPH = Path(sys.executable).with_name("deltaph")
DIED = "the process of the {} has died, exit code -9"


def run_and_lose(directory: Path, which: Sequence[str], *options: str) -> tuple[subprocess.CompletedProcess[str], dict[str, Any]]:
    """A run in real time whose recorder, publisher or both are killed once it records; its report."""
    path = directory / "k.rrd"
    command = [str(DELTAPH), "run", str(PAPER), "--realtime", "--cycles", "12", "--listen", free_endpoint()]
    command += ["--record", str(path), "--json", "k.json", "--csv", "k.csv", *options]
    with subprocess.Popen(command, cwd=directory, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            wait_until(lambda: size(path) > 100_000, process)
            for name, pid in zip(("recorder", "publisher"), sink_processes(process, 2), strict=True):
                if name in which:
                    os.kill(pid, signal.SIGKILL)
            printed, said = process.communicate(timeout=60)
        finally:
            process.kill()
    report = json.loads((directory / "k.json").read_text(encoding="utf-8"))
    return subprocess.CompletedProcess(command, process.returncode, printed, said), report


def test_run_without_its_recorder_goes_on_and_reports(tmp_path: Path) -> None:
    done, report = run_and_lose(tmp_path, ["recorder"])
    assert done.returncode == 2
    died = DIED.format("recorder")
    assert [line for line in done.stderr.splitlines() if "record" in line] == [
        f"{died}: the run goes on without it",
        f"deltaph: error: {died}",
    ]
    assert "missed deadlines" in done.stdout
    assert report["telemetry"] == {"published": report["steps"] + 1, "dropped": 0}
    assert report["timing"]["dropped_frames"] > 0
    assert all(check["ok"] for check in report["expect"])
    assert len((tmp_path / "k.csv").read_text(encoding="utf-8").splitlines()) == report["steps"] + 2


def test_run_without_its_publisher_records_and_says_what_was_published(tmp_path: Path) -> None:
    done, report = run_and_lose(tmp_path, ["publisher"])
    assert done.returncode == 2
    died = DIED.format("publisher")
    assert f"{died}: the run goes on without it\n" in done.stderr
    assert f"recorded {tmp_path / 'k.rrd'}" in done.stderr
    assert done.stderr.endswith(f"deltaph: error: {died}\n")
    assert 0 < report["telemetry"]["published"] < report["steps"]
    assert sum(report["telemetry"].values()) == report["steps"] + 1
    assert report["recording"] == str(tmp_path / "k.rrd")
    dropped = Reading(tmp_path / "k.rrd").rows["timing/dropped_frames"].values  # before the ring of the dead is full
    assert (dropped[0], dropped[-1]) == (0, report["telemetry"]["dropped"] - 1)  # each frame knows of those before
    assert has_footer(tmp_path / "k.rrd")


def test_each_lost_sink_is_said(tmp_path: Path) -> None:
    done, report = run_and_lose(tmp_path, ["recorder", "publisher"])
    assert done.returncode == 2
    assert sum(report["telemetry"].values()) == report["steps"] + 1
    for name in ("recorder", "publisher"):
        assert done.stderr.count(f"{DIED.format(name)}: the run goes on without it\n") == 1
        assert done.stderr.count(f"deltaph: error: {DIED.format(name)}\n") == 1
    assert "recorded" not in done.stderr


def test_run_whose_recording_has_no_room_reports(tmp_path: Path) -> None:
    path = tmp_path / "k.rrd"
    command = [str(DELTAPH), "run", str(PAPER), "--no-telemetry", "--cycles", "5", "--record", str(path), "--json", "k.json"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            resource.prlimit(sink_processes(process, 1)[0], resource.RLIMIT_FSIZE, (200_000, 200_000))
            printed, said = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 2
    assert said == f"deltaph: error: cannot write {path}: File too large\n"
    assert "real-time factor" in printed
    report = json.loads((tmp_path / "k.json").read_text(encoding="utf-8"))
    assert report["recording"] is None
    assert not path.exists()


def lose(cell: Serving, name: str) -> None:
    os.kill(dict(zip(("recorder", "publisher", "tally"), sink_processes(cell.process, 3), strict=True))[name], signal.SIGKILL)


def test_cell_that_nobody_can_command_ends(tmp_path: Path) -> None:
    with serving(tmp_path, template(), "--record", "k.rrd") as cell:
        with following(cell) as found:
            found.wait_for_time(1.5)
        begin = time.monotonic()
        lose(cell, "publisher")
        assert cell.process.wait(DEADLINE) == 2
        assert time.monotonic() - begin < 0.5 * DEADLINE  # by itself
        died = DIED.format("publisher")
        assert f"{died}: nobody can command the cell any more, and it ends\n" in cell.said
        assert cell.said.endswith(f"deltaph: error: {died}\n")
        assert "plans" in cell.printed
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert report["telemetry"]["published"] > 0
    assert 500 < report["telemetry"]["dropped"] + report["telemetry"]["published"] == report["steps"] + 1
    assert report["plans"]["accepted"] == 0
    assert report["recording"] == "k.rrd"
    assert has_footer(tmp_path / "k.rrd")


@pytest.mark.parametrize("name", ["recorder", "tally"])
def test_cell_goes_on_without_another_sink(tmp_path: Path, name: str) -> None:
    said = f"{DIED.format(name)}: the cell goes on without it\n"
    with serving(tmp_path, template(), "--record", "k.rrd") as cell:
        lose(cell, name)
        wait_until(lambda: said in cell.said, cell.process)
        with cell.client() as client:
            assert client.ppo(PpoRequest(place=(0.1, 0.0, -0.8))).accepted
        assert cell.end() == 2
        assert cell.said.count(said) == 1
        assert cell.said.endswith(f"deltaph: error: {DIED.format(name)}\n")
        assert "1 accepted" in cell.printed
        assert ("the tally is lost" in cell.printed) == (name == "tally")
    assert cell.report["steps"] > 0
    assert (cell.report["plans"] is None) == (name == "tally")
    assert cell.report["telemetry"] == {"published": cell.report["steps"] + 1, "dropped": 0}
    if name == "tally":
        assert has_footer(tmp_path / "k.rrd")
