"""Deadlines on a clock that the test moves."""

import gc
import os
import sys

import pytest

from deltaph.errors import EnvironmentProblem
from deltaph.pacing import CAUSES, HISTOGRAM_US, PRIORITY, Pacer, Undisturbed, histogram, permitted_priority, undisturbed

STEP = 1_000_000  # [ns]
BEGIN = 5_000


class Machine:
    """A clock that stands still but for `pass_`, and sleeping that may overshoot."""

    def __init__(self) -> None:
        self.now = BEGIN
        self.overshoot = 0
        self.pacer = Pacer(STEP, clock=self.clock, sleep_until=self.sleep_until)
        self.pacer.begin()
        self.now = BEGIN

    def clock(self) -> int:
        self.now += 10  # so that looking at it ends
        return self.now

    def sleep_until(self, until: int) -> None:
        self.now = max(self.now, until) + self.overshoot

    def step(self, *, planner: int = 0, plant: int = 0, publish: int = 0, exchange: int = 0) -> float:
        self.now += planner + plant + publish + exchange
        return self.pacer.wait(planner * 1e-9, plant * 1e-9, publish * 1e-9)

    def missed(self) -> dict[str, int]:
        return {cause: count for cause, count in zip(CAUSES, self.pacer.account.missed, strict=True) if count}


def test_deadlines_are_absolute_and_do_not_drift() -> None:
    machine = Machine()
    for _ in range(1000):
        assert machine.step(planner=30_000) <= 100e-9
    assert machine.now == pytest.approx(BEGIN + 1000 * STEP, abs=100)
    assert not machine.missed()


@pytest.mark.parametrize("part", ["planner", "plant", "publish", "exchange"])
def test_a_step_too_long_is_laid_on_its_longest_part(part: str) -> None:
    machine = Machine()
    machine.step(**{part: 1_300_000})
    assert machine.missed() == {part: 1}


def test_late_waking_is_the_systems() -> None:
    machine = Machine()
    machine.overshoot = 400_000
    machine.step()
    assert machine.missed() == {"system": 1}


def test_late_within_the_tolerance_is_not_missed() -> None:
    machine = Machine()
    assert 0.0 < machine.step(plant=1_050_000) < 1e-4
    assert not machine.missed()


def test_a_step_that_only_began_late_has_its_forerunners_cause() -> None:
    machine = Machine()
    machine.step(plant=1_900_000)
    machine.step(planner=900_000)
    assert machine.missed() == {"plant": 2}


def test_whole_steps_slip_and_are_not_caught_up() -> None:
    machine = Machine()
    machine.step(planner=5 * STEP + 300_000)
    assert machine.pacer.account.slipped == 4
    times = []
    for _ in range(3):
        machine.step()
        times.append(machine.now)
    assert times == pytest.approx([BEGIN + k * STEP for k in (6, 7, 8)], abs=100)  # the phase is kept


def test_every_deadline_is_in_one_bin() -> None:
    machine = Machine()
    for late in (0, 150_000, 0, 700_000, 3_000_000):
        machine.step(plant=STEP + late if late else 0)
    account = machine.pacer.account
    assert account.deadlines == sum(account.histogram) == 5
    assert histogram([0.0, 1.0, 1.1, 1e9]) == [2, 1, *[0] * (len(HISTOGRAM_US) - 2), 1]


def test_garbage_collection_is_out_of_the_way_and_back_afterwards() -> None:
    with undisturbed(Undisturbed()):
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_a_processor_that_is_not_ours_is_refused() -> None:
    with pytest.raises(EnvironmentProblem, match="processor 4000 is not ours: choose one of"):
        Undisturbed(cpu=4000)


def test_permitted_priority_leaves_the_scheduling_as_it_was() -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    assert permitted_priority() in (0, PRIORITY)
    assert (os.sched_getscheduler(0), os.sched_getparam(0)) == before


def test_priority_that_is_not_permitted_is_none_unless_it_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert permitted_priority() == 0
    with pytest.raises(EnvironmentProblem, match="real-time priority 50 is not permitted"), undisturbed(Undisturbed(PRIORITY)):
        pass


def test_a_system_without_real_time_priorities_permits_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert permitted_priority() == 0
