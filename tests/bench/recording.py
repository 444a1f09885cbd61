"""What recording costs: share of a core, size, memory over ten minutes, the end of them, how long they take to load and to scrub.

    python tests/bench/recording.py [SCENARIO.toml]

The frames are those of a real run of one minute, written again and again with their times moved on. The viewer needs a Vulkan
driver, as `tests/make_pictures.py`; without one the last lines are missing.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
os.environ.setdefault("RUST_LOG", "error")  # Rerun reads it when it is imported, and warns of files without a footer

from integration.synthetic_cell import replaced
from make_pictures import viewer_of

from deltaph.fmu import cached_fmus
from deltaph.frame import Frame
from deltaph.importer import cosimulate
from deltaph.scenario import load_scenario
from deltaph.scene import scene_of
from deltaph.schedule import schedule
from deltaph.telemetry import Recorder
from deltaph.telemetry.viewer import rerun_binary, rerun_environment

ROOT = Path(__file__).parents[2]
MINUTES = 10


def resident() -> float:
    """Memory of this process [MB]."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) / 1e3
    raise OSError("no VmRSS in /proc/self/status: this needs Linux")


def minute_of(scenario_file: Path) -> list[Frame]:
    """The frames of a run that takes a minute or a little more."""
    scenario = load_scenario(scenario_file)
    (first, *_) = schedule(scenario).operations
    cycles = -(-60_000 // (2 * first.plan.duration_ms))
    return list(cosimulate(scenario, schedule(scenario, cycles), cached_fmus()))


def moved_on(frame: Frame, steps: int, seconds: float) -> Frame:
    """The same frame later."""
    return replaced(frame, step=frame.step + steps, time=frame.time + seconds)


def main() -> None:
    """Measure and print."""
    scenario_file = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "scenarios" / "paper.toml"
    scene = scene_of(load_scenario(scenario_file))
    frames = minute_of(scenario_file)
    seconds = frames[-1].time - frames[0].time
    with tempfile.TemporaryDirectory() as directory:
        one, optimized, ten = (Path(directory) / name for name in ("one.rrd", "optimized.rrd", "ten.rrd"))
        Recorder(one, scene).close()  # warm: what Rerun does once
        recorder = Recorder(one, scene)
        recorder.take(frames[0])
        begun, longest = time.process_time(), 0.0
        for frame in frames[1:]:
            before = time.perf_counter()
            recorder.take(frame)
            longest = max(longest, time.perf_counter() - before)
        recorder.close()
        share = (time.process_time() - begun) / seconds
        print(
            f"share of a core at {len(frames) / seconds:.0f} frames/s: {100.0 * share:.2f} %; longest take {1e3 * longest:.1f} ms"
        )

        optimize = [rerun_binary(), "rrd", "optimize", one, "-o", optimized]
        subprocess.run(optimize, check=True, capture_output=True, env=rerun_environment())
        for name, path in (("as written", one), ("optimized", optimized)):
            print(f"size {name}: {path.stat().st_size / 1e6 * 60.0 / seconds:.1f} MB per minute of run")

        recorder = Recorder(ten, scene)
        memory = []
        for minute in range(MINUTES):
            for frame in frames:
                recorder.take(moved_on(frame, minute * len(frames), minute * (seconds + 1e-3)))
            memory.append(resident())
        print(f"memory after each minute: {' '.join(f'{megabytes:.1f}' for megabytes in memory)} MB")
        begun = time.monotonic()
        recorder.close()
        ended = time.monotonic() - begun
        slope = (memory[-1] - memory[0]) / (MINUTES - 1)
        print(f"growth after the first: {slope:.2f} MB a minute; to end {MINUTES} minutes takes {ended:.1f} s")

        begun = time.monotonic()
        with viewer_of(ten) as viewer:
            opened, size = time.monotonic() - begun, ten.stat().st_size / 1e6
            print(f"{MINUTES} minutes, {size:.0f} MB: open in the viewer after {opened:.1f} s")
            waits = []
            for part in (0.1, 0.9, 0.5, 0.3, 0.7):
                begun = time.monotonic()
                viewer.set_time("sim_time", duration=part * MINUTES * seconds, play_state="paused")
                viewer.take_screenshot()
                waits.append(time.monotonic() - begun)
            print(f"from one moment to another and its picture: {' '.join(f'{wait:.2f}' for wait in waits)} s")


if __name__ == "__main__":
    main()
