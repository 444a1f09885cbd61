"""What the step loop pays for publishing: handing over a frame, allocations in a step, memory that stays.

python tests/bench/loop.py [SECONDS]
"""

import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from integration.allocations import counting

from deltaph.execution import Trace, percentiles
from deltaph.fmu import cached_fmus
from deltaph.frame import Frames
from deltaph.importer import cosimulate
from deltaph.pacing import Undisturbed
from deltaph.scenario import load_scenario
from deltaph.schedule import schedule
from deltaph.telemetry import Publisher, SinkProcess
from deltaph.telemetry.session import free_endpoint

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    scenario = load_scenario(ROOT / "scenarios" / "paper.toml")
    (first, *_) = schedule(scenario).operations
    run = schedule(scenario, max(1, round(1000.0 * seconds / (2 * first.plan.duration_ms))))
    sink = SinkProcess("publisher", partial(Publisher, "bench", "{}", listen=[free_endpoint()]), 20_000)
    sink.await_open()
    with tempfile.TemporaryDirectory() as folder:
        for name in ("alone", "publishing"):
            frames = Frames(run.steps + 1)
            for frame in cosimulate(
                scenario, run, cached_fmus(), realtime=Undisturbed(), dropped=lambda: sink.dropped, frames=frames
            ):
                if name == "publishing":
                    sink.take(frame)
            trace = Trace(frames)
            for what in ("publish", "lateness"):
                cost = percentiles(trace.timing_of(what)[1:])
                print(f"{name}, {run.steps} steps in real time: {what} {cost['p50']:.2f} us median, {cost['p999']:.1f} us p99.9")

        counts, blocks = np.zeros(run.steps + 1, dtype=np.int64), np.zeros(2, dtype=np.int64)
        with counting(Path(folder)) as counter:
            for frame in cosimulate(scenario, run, cached_fmus(), dropped=lambda: sink.dropped, frames=Frames(run.steps + 1)):
                sink.take(frame)
                counts[frame.step] = counter.off()
                if frame.step in (run.steps // 4, run.steps):
                    blocks[int(frame.step == run.steps)] = sys.getallocatedblocks()
                counter.on()
            counter.off()
        stay = (blocks[1] - blocks[0]) / (run.steps - run.steps // 4)
        print(f"publishing: {np.median(np.diff(counts)):.0f} allocations in a step, {stay:.4f} blocks stay")
    sink.close()


if __name__ == "__main__":
    main()
