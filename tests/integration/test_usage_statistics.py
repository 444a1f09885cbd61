"""Rerun's programs would keep and send statistics on their use: a tool for machine cells keeps and sends none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from integration.test_following import headless_viewer, needs_vulkan
from rerun.experimental import ViewerClient

from deltaph.telemetry.footer import repair
from deltaph.telemetry.viewer import rerun_binary

PAPER = Path(__file__).parents[2] / "scenarios" / "paper.toml"
DELTAPH = Path(sys.executable).with_name("deltaph")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A new user's, outside of any CI."""
    folder = tmp_path / "home"
    folder.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache")))  # has the FMUs
    for name in ("CI", "FORCE_RERUN_ANALYTICS", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(folder))
    return folder


def statistics(home: Path) -> list[Path]:
    return [path for path in home.rglob("*") if "analytics" in str(path.relative_to(home))]


def test_recording_and_repairing_keep_none(home: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    run = [DELTAPH, "run", PAPER, "--no-telemetry", "--record", path]
    subprocess.run(run, capture_output=True, timeout=60, check=True)
    repair(path, tmp_path / "repaired.rrd")
    assert not statistics(home)
    subprocess.run([rerun_binary(), "rrd", "verify", path], capture_output=True, timeout=60, check=True)
    assert statistics(home), "Rerun keeps none by itself: this test says nothing any more"


@needs_vulkan
def test_viewer_keeps_none(home: Path) -> None:
    with headless_viewer() as viewer:
        ViewerClient.connect(viewer.url).get_state()
    assert not statistics(home)
