"""Steps: on the grid of milliseconds, tolerant of sums, strict about the rest."""

from __future__ import annotations

import ctypes as c
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from integration.fmi_slave import DISCARD, ERROR, OK, FmiSlave

from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.package import file_name


def test_accumulated_time_is_tolerated(new_slave: Callable[..., FmiSlave]) -> None:
    exact, adding = new_slave("exact"), new_slave("adding")
    exact.initialize()
    adding.initialize()
    time = 0.0
    for n in range(2000):
        assert exact.step(n * 1e-3) == OK
        assert adding.step(time) == OK, adding.messages
        time += 1e-3
    assert time != 2.0
    assert adding.outputs() == exact.outputs()


@pytest.mark.parametrize("error", [9e-10, -9e-10])
def test_rounding_is_tolerated(running: FmiSlave, error: float) -> None:
    assert running.step(error) == OK
    assert running.step(1e-3, 1e-3 + error) == OK


@pytest.mark.parametrize("point", [1e-3, -1e-3, 2e-9, -2e-9, math.nan, math.inf])
def test_a_wrong_communication_point_is_an_error(running: FmiSlave, point: float) -> None:
    assert running.step(point) == ERROR
    assert "expected the communication point 0 s but was" in running.last


def test_a_wrong_step_is_found_however_late_it_is(slave: FmiSlave) -> None:
    slave.initialize(start=1e8)
    assert slave.step(1e8) == OK
    assert slave.step(1e8) == ERROR


@pytest.mark.parametrize("size", [1e-3 + 2e-9, 1.2e-3])
def test_a_step_off_the_grid_is_found_however_late_it_is(slave: FmiSlave, size: float) -> None:
    slave.initialize(start=1e6)
    assert slave.step(1e6, size) == (ERROR if slave.version == 2 else DISCARD)


@pytest.mark.parametrize("start", [0.1, 1e6, 1.8e9])
def test_a_step_may_be_the_difference_of_two_times(slave: FmiSlave, start: float) -> None:
    slave.initialize(start=start)
    times = [start + n * 1e-3 for n in range(50)]
    for before, after in pairwise(times):
        assert slave.step(before, after - before) == OK, slave.messages


@pytest.mark.parametrize("size", [0.0, -1e-3, math.nan, -math.inf])
def test_a_step_that_is_not_positive_is_an_error(running: FmiSlave, size: float) -> None:
    assert running.step(0.0, size) == ERROR
    assert "expected a communication step greater than 0 s" in running.last


OFF_GRID = pytest.mark.parametrize("size", [1.5e-3, 1e-4, 1e-12, 1e-3 + 2e-9, math.inf, 1e300, 5e9])


@OFF_GRID
@pytest.mark.parametrize("version", [2], indirect=True)
def test_a_step_off_the_grid_is_an_error_of_fmi_2(running: FmiSlave, size: float) -> None:
    assert running.step(0.0, size) == ERROR
    assert "expected a communication step that is a multiple of 0.001 s but was" in running.last


def test_an_importer_that_steps_off_the_grid_is_told_and_ends(dist: Path, version: FmiVersion) -> None:
    with pytest.raises(FMICallException):
        simulate_fmu(str(dist / file_name("planner", version)), stop_time=0.01, output_interval=5e-4)


@OFF_GRID
@pytest.mark.parametrize("version", [3], indirect=True)
def test_a_step_off_the_grid_is_discarded_and_changes_nothing(running: FmiSlave, size: float) -> None:
    state = running.serialize(running.save())
    assert running.step(0.0, size) == DISCARD
    assert "expected a communication step that is a multiple of 0.001 s but was" in running.last
    assert running.serialize(running.save()) == state
    assert running.step(0.0) == OK


def test_time_does_not_pass_the_stop_time(slave: FmiSlave) -> None:
    slave.initialize(stop=0.002)
    assert slave.step(0.0, 2e-3) == OK
    assert slave.step(2e-3) == ERROR
    assert "expected a step to the stop time 0.002 s at most but was to 0.003 s" in slave.last


def test_the_start_time_is_only_an_offset(new_slave: Callable[..., FmiSlave]) -> None:
    here, there = new_slave("here"), new_slave("there")
    here.initialize()
    there.initialize(start=12.5)
    for n in range(100):
        assert here.step(n * 1e-3) == there.step(12.5 + n * 1e-3) == OK
    assert here.outputs() == there.outputs()


@pytest.mark.parametrize("version", [3], indirect=True)
def test_early_return_is_never_made_use_of(running: FmiSlave) -> None:
    assert running.step(0.0) == OK
    assert not running.early
    assert running.last_time == 1e-3


@pytest.mark.parametrize("version", [3], indirect=True)
def test_null_results_are_errors(running: FmiSlave) -> None:
    assert running.call("DoStep", c.c_double(0.0), c.c_double(1e-3), True, None, None, None, None) == ERROR
    assert running.last.endswith("as argument eventHandlingNeeded but was NULL")


@pytest.mark.parametrize("version", [2], indirect=True)
def test_status_after_a_step(running: FmiSlave) -> None:
    assert running.step(0.0) == OK
    time, terminated, anything = c.c_double(), c.c_int(7), c.c_int()
    assert running.call("GetRealStatus", 2, c.byref(time)) == OK
    assert time.value == 1e-3
    assert running.call("GetBooleanStatus", 3, c.byref(terminated)) == OK
    assert terminated.value == 0
    for function in ("GetStatus", "GetRealStatus", "GetIntegerStatus", "GetStringStatus"):
        assert running.call(function, 0, c.byref(anything)) == DISCARD
