"""Many instances: they leave nothing behind, and in threads they compute what one computes alone."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from integration.fmi_slave import OK, FmiSlave

from deltaph.fmu.model_description import FmiVersion
from deltaph.variables import Model

STATM = Path("/proc/self/statm")
INSTANCES = 1000


def resident_pages() -> int:
    return int(STATM.read_text().split()[1])


@pytest.mark.skipif(not STATM.is_file(), reason="needs /proc")
def test_a_thousand_instances_leave_nothing_behind(dist: Path, model: Model, version: FmiVersion, tmp_path: Path) -> None:
    def live() -> None:
        for _ in range(INSTANCES):
            slave = FmiSlave(dist, model, version, tmp_path, logging=False)
            slave.initialize()
            assert slave.step(0.0) == OK
            state = slave.save()
            assert slave.drop(state) == OK
            slave.free()

    live()  # Python's own memory settles
    before = resident_pages()
    live()
    # An instance takes half a page at least (2 kB): left behind they would be 500 pages.
    assert resident_pages() - before < INSTANCES / 8


def test_eight_threads_compute_the_bits_of_one(new_slave: Callable[..., FmiSlave]) -> None:
    """A call of the library releases Python's lock: the threads step at the same time, a long step each."""

    def run(slave: FmiSlave) -> list[list[float]]:
        rows = []
        for n in range(30):
            assert slave.step(n * 10e-3, 10e-3) == OK
            rows.append(slave.outputs())
        return rows

    alone, *others = (new_slave(f"slave {k}", logging=False) for k in range(9))
    for slave in (alone, *others):
        slave.initialize()
    expected = run(alone)
    with ThreadPoolExecutor(max_workers=8) as pool:
        assert list(pool.map(run, others)) == [expected] * 8
