"""What the step loop allocates while it publishes: as much in each step, nothing that stays, and no garbage collection."""

import gc
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from integration.allocations import counting

from deltaph.fmu import cached_fmus
from deltaph.frame import Frame, Frames
from deltaph.importer import cosimulate
from deltaph.pacing import Undisturbed
from deltaph.scenario import load_scenario
from deltaph.schedule import schedule
from deltaph.telemetry import Publisher, SinkProcess
from deltaph.telemetry.session import free_endpoint

PAPER = load_scenario(Path(__file__).parents[2] / "scenarios" / "paper.toml")
RUN = schedule(PAPER, cycles=4)
WARM = 700  # the first cycle: caches fill


def blocks_that_stay(sink: SinkProcess[Publisher], retained: list[Frame] | None = None) -> float:
    """Memory blocks that a step leaves behind, on average over the steps after the first cycle."""
    frames = Frames(RUN.steps + 1)
    found = np.zeros(2, dtype=np.int64)  # nothing is allocated to keep the numbers
    for frame in cosimulate(PAPER, RUN, cached_fmus(), dropped=lambda: sink.dropped, frames=frames):
        sink.take(frame)
        if retained is not None:
            retained.append(frame)
        if frame.step in (WARM, RUN.steps):
            gc.collect()
            found[int(frame.step == RUN.steps)] = sys.getallocatedblocks()
    return float(found[1] - found[0]) / (RUN.steps - WARM)


@pytest.fixture
def sink() -> Iterator[SinkProcess[Publisher]]:
    """A cell that publishes."""
    with SinkProcess("publisher", partial(Publisher, "flat", "{}", listen=[free_endpoint()], history=10), 20_000) as sink:
        sink.await_open()
        yield sink


def test_memory_is_flat_while_frames_are_published(sink: SinkProcess[Publisher]) -> None:
    assert blocks_that_stay(sink) < 0.05
    assert blocks_that_stay(sink, retained=[]) > 1.5  # a sink that kept its frames would be seen
    assert sink.dropped == 0


def test_a_step_allocates_little_and_always_the_same(sink: SinkProcess[Publisher], tmp_path: Path) -> None:
    counts = np.zeros((2, RUN.steps + 1), dtype=np.int64)
    with counting(tmp_path) as counter:
        for publishes in (0, 1):
            frames = Frames(RUN.steps + 1)
            for frame in cosimulate(PAPER, RUN, cached_fmus(), dropped=lambda: sink.dropped, frames=frames):
                if publishes:
                    sink.take(frame)
                counts[publishes, frame.step] = counter.off()
                counter.on()
            counter.off()
    alone, publishing = np.diff(counts)[:, 1:]
    assert 0 < np.median(alone) <= 250  # short-lived: what goes in and out of the calls of two FMUs
    assert np.median(publishing) - np.median(alone) <= 20  # copying a frame out
    assert np.percentile(publishing, 99) - np.percentile(publishing, 1) <= 20


def test_no_garbage_is_collected_in_real_time(sink: SinkProcess[Publisher]) -> None:
    collections: list[str] = []

    def note(phase: str, _: dict[str, int]) -> None:
        collections.append(phase)

    run = schedule(PAPER)
    for frame in cosimulate(PAPER, run, cached_fmus(), realtime=Undisturbed(), dropped=lambda: sink.dropped):
        if frame.step == 0:
            gc.callbacks.append(note)
        sink.take(frame)
        if frame.step == run.steps:
            gc.callbacks.remove(note)
    assert collections == []
