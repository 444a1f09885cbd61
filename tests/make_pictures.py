"""Makes the README's pictures: the paper's case with tuned and with factory gains, and compared with the time-optimal law.

    python tests/make_pictures.py

Needs a Vulkan driver; Debian's mesa-vulkan-drivers has one that needs no graphics card.
"""

import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rerun_cli
from rerun.experimental import ViewerClient

ROOT = Path(__file__).parents[1]
PICTURES = Path(__file__).parent / "pictures"
DEADLINE = 30.0


def photograph(recording: Path, picture: Path, seconds: float, size: str = "1600x1000") -> None:
    """Write a picture (PNG) of a recording with the time cursor at `seconds`."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # The binary itself: the `rerun` script starts it as a child, and ending the script would orphan it.
    binary = Path(rerun_cli.__file__).with_name("rerun")
    command = [
        binary,
        recording,
        "--headless",
        "--bind",
        "127.0.0.1",
        "--port",
        str(port),
        "--window-size",
        size,
        "--hide-welcome-screen",
    ]
    with subprocess.Popen(command, env={**os.environ, "XDG_RUNTIME_DIR": tempfile.gettempdir(), "RUST_LOG": "error"}) as viewer:
        try:
            client = loaded(f"rerun+http://127.0.0.1:{port}/proxy")
            client.set_time("sim_time", duration=seconds, play_state="paused")
            time.sleep(float(os.environ.get("SETTLE", "12")))  # a notice covers a corner of the window for some seconds
            picture.write_bytes(client.take_screenshot())
        finally:
            viewer.terminate()


def loaded(url: str) -> ViewerClient:
    """A client of the viewer once it has loaded its recording."""
    deadline = time.monotonic() + DEADLINE
    while True:
        try:
            client = ViewerClient.connect(url)
            state = client.get_state()
            if state.recordings and state.active_recording and not state.loading:
                return client
        except Exception:
            if time.monotonic() > deadline:
                raise
        if time.monotonic() > deadline:
            raise TimeoutError(f"the viewer did not load its recording within {DEADLINE:g} s")
        time.sleep(0.1)


def main() -> None:
    """Make the pictures."""
    PICTURES.mkdir(exist_ok=True)
    deltaph = Path(sys.executable).with_name("deltaph")
    with tempfile.TemporaryDirectory() as directory:
        recordings = {
            name: Path(directory) / f"{name}.rrd" for name in ("paper", "factory_gains", "time_optimal", "comparison_of_two")
        }
        *runs, both = recordings
        for name in runs:
            scenario = ROOT / "scenarios" / f"{name}.toml"
            subprocess.run([deltaph, "run", scenario, "--no-telemetry", "--record", recordings[name]], check=True)
        subprocess.run([deltaph, "compare", recordings["paper"], recordings["time_optimal"], "-o", recordings[both]], check=True)
        for name in ("paper", "factory_gains", both):
            photograph(recordings[name], PICTURES / f"{name}.png", 0.056)


if __name__ == "__main__":
    main()
