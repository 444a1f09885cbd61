"""Makes the README's pictures: the paper's case with tuned and with factory gains, and compared with the time-optimal law.

    python tests/make_pictures.py

Needs a Vulkan driver; Debian's mesa-vulkan-drivers has one that needs no graphics card.
"""

import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from rerun.experimental import ViewerClient

from deltaph.telemetry.session import free_port
from deltaph.telemetry.viewer import rerun_binary, rerun_environment

ROOT = Path(__file__).parents[1]
PICTURES = Path(__file__).parent / "pictures"
DEADLINE = 120.0
CORNERS = ("Pick corner [mm]", "Place corner [mm]")
GAP = 12
"""Between pictures side by side [pixels]."""

COLORS = 192
"""Of a picture: a viewer's has few, and a palette makes a third of the file."""


@contextmanager
def viewer_of(recording: Path, size: str = "1600x1000") -> Iterator[ViewerClient]:
    """A viewer without a screen that has loaded a recording."""
    port = free_port()
    command = [
        str(rerun_binary()),
        str(recording),
        "--headless",
        "--bind",
        "127.0.0.1",
        "--port",
        str(port),
        "--window-size",
        size,
        "--hide-welcome-screen",
    ]
    environment = {**rerun_environment(), "XDG_RUNTIME_DIR": tempfile.gettempdir(), "RUST_LOG": "error"}
    with subprocess.Popen(command, env=environment) as viewer:
        try:
            yield loaded(f"rerun+http://127.0.0.1:{port}/proxy")
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


def photograph(recording: Path, seconds: float) -> tuple[bytes, list[bytes]]:
    """Pictures (PNG) of a recording with the time cursor at `seconds`: the whole window, and its corner views where it has them."""
    with viewer_of(recording) as client:
        client.set_time("sim_time", duration=seconds, play_state="paused")
        time.sleep(float(os.environ.get("SETTLE", "12")))  # a notice covers a corner of the window for some seconds
        views = {view.name: view.view_id for view in client.get_state().views}
        return client.take_screenshot(), [client.take_screenshot(views[name]) for name in CORNERS if name in views]


def save(pictures: list[bytes], path: Path) -> None:
    """Write pictures side by side, with a palette."""
    images = [Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures]
    width = sum(image.width for image in images) + GAP * (len(images) - 1)
    whole = Image.new("RGB", (width, max(image.height for image in images)), "white")
    left = 0
    for image in images:
        whole.paste(image, (left, 0))
        left += image.width + GAP
    whole.quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)


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
            window, corners = photograph(recordings[name], 0.056)
            save([window], PICTURES / f"{name}.png")
            if corners:
                save(corners, PICTURES / f"{name}_corners.png")


if __name__ == "__main__":
    main()
