"""FMU states: what is restored goes on bit for bit, and nothing foreign is taken."""

from __future__ import annotations

import ctypes as c
from collections.abc import Callable
from pathlib import Path

import pytest
from integration.fmi_slave import ERROR, OK, FmiSlave

from deltaph.fmu.model_description import FmiVersion
from deltaph.importer import planner_values, task_inputs
from deltaph.scenario import load_scenario


def run(slave: FmiSlave, first: int, n: int) -> list[list[float]]:
    """Outputs after each of n steps from step `first` on."""
    results = []
    for k in range(first, first + n):
        assert slave.step(k * 1e-3) == OK, slave.messages
        results.append(slave.outputs())
    return results


def test_a_restored_state_goes_on_bit_for_bit(running: FmiSlave, new_slave: Callable[..., FmiSlave]) -> None:
    run(running, 0, 100)
    state = running.save()
    content = running.serialize(state)
    expected = run(running, 100, 200)
    assert running.restore(state) == OK
    assert run(running, 100, 200) == expected

    other = new_slave("another")
    status, copy = other.deserialize(content)
    assert status == OK
    assert other.restore(copy) == OK
    assert other.serialize(copy) == content
    assert run(other, 100, 200) == expected
    for slave, it in ((running, state), (other, copy)):
        assert slave.drop(it) == OK


@pytest.mark.parametrize("law", ["paper_limited", "time_optimal"])
@pytest.mark.parametrize("steps", [1, 5])
def test_unfinished_planning_goes_on_bit_for_bit(dist: Path, version: FmiVersion, tmp_path: Path, law: str, steps: int) -> None:
    planner, other = (FmiSlave(dist, "planner", version, tmp_path, name=name) for name in ("one", "another"))
    table, scenario = planner.table, load_scenario(Path(__file__).parents[2] / "scenarios" / f"{law}.toml")
    for name, value in planner_values(scenario).items():
        assert planner.put({name: value if table[name].is_float else int(value)}) == OK
    planner.initialize()
    run(planner, 0, 50)
    assert planner.put(task_inputs(scenario.task.reversed())) == OK
    assert planner.put({"task.trigger": 2}) == OK
    run(planner, 50, steps)
    assert planner.get("plan.status", "plan.count") == [table.items("PlanStatus").index("planning"), 1]

    state = planner.save()
    content = planner.serialize(state)
    expected = run(planner, 50 + steps, 400)
    assert planner.get("plan.count") == [2]
    final = planner.serialize(planner.save())
    assert planner.restore(state) == OK
    assert run(planner, 50 + steps, 400) == expected
    assert planner.serialize(planner.save()) == final

    status, copy = other.deserialize(content)
    assert status == OK
    assert other.restore(copy) == OK
    assert run(other, 50 + steps, 400) == expected
    for slave in (planner, other):
        slave.free()


def test_equal_instances_have_equal_bytes(new_slave: Callable[..., FmiSlave]) -> None:
    """No pointers, no padding, no leftovers."""
    one, two = new_slave("one"), new_slave("a longer name")
    one.initialize()
    two.initialize()
    run(one, 0, 10)
    run(two, 0, 10)
    assert one.serialize(one.save()) == two.serialize(two.save())


def test_memory_of_a_state_is_used_again(running: FmiSlave) -> None:
    state = running.save()
    address = state.value
    run(running, 0, 3)
    assert running.call("GetFMUstate" if running.version == 2 else "GetFMUState", c.byref(state)) == OK
    assert state.value == address
    assert run(running, 3, 1)
    assert running.restore(state) == OK
    assert run(running, 3, 1)


def test_states_are_freed_to_null_and_null_is_ignored(running: FmiSlave) -> None:
    state = running.save()
    name = "FreeFMUstate" if running.version == 2 else "FreeFMUState"
    assert running.call(name, c.byref(state)) == OK
    assert state.value is None
    assert running.call(name, c.byref(state)) == OK
    assert running.call(name, None) == OK


def test_initialization_can_be_repeated_from_a_state(slave: FmiSlave) -> None:
    slave.enter()
    state = slave.save()
    assert slave.put({"payload.mass": 0.5}) == OK
    assert slave.call("ExitInitializationMode") == OK
    loaded = run(slave, 0, 5)
    assert slave.restore(state) == OK
    assert slave.call("ExitInitializationMode") == OK
    assert run(slave, 0, 5) != loaded


@pytest.mark.parametrize("position", [0, 4, 8, 16, 24, 60, 64, 200, -1])
def test_damaged_states_are_refused(running: FmiSlave, position: int) -> None:
    content = bytearray(running.serialize(running.save()))
    content[position] ^= 0x10
    status, state = running.deserialize(bytes(content))
    assert status == ERROR
    assert "expected" in running.last
    assert state.value is None


def test_states_of_another_size_are_refused(new_slave: Callable[..., FmiSlave]) -> None:
    content = new_slave().serialize(new_slave().save())
    for wrong in (b"", content[:10], content[:-1], content + b"\0"):
        slave = new_slave()
        status, _ = slave.deserialize(wrong)
        assert status == ERROR
        assert slave.last.endswith(f"but was {len(wrong)}")


def test_null_states_are_errors(new_slave: Callable[..., FmiSlave]) -> None:
    slave = new_slave()
    assert slave.restore(c.c_void_p()) == ERROR
    assert slave.last.endswith("expected a pointer as argument FMUState but was NULL")
    slave = new_slave()
    assert slave.call("GetFMUstate" if slave.version == 2 else "GetFMUState", None) == ERROR


def test_a_cancel_is_part_of_the_state(dist: Path, version: FmiVersion, tmp_path: Path) -> None:
    """What waits, what was cancelled and which value cancelled it: a restored state discards once, and only then."""
    planner = FmiSlave(dist, "planner", version, tmp_path)
    planner.initialize()
    back = task_inputs(load_scenario(Path(__file__).parents[2] / "scenarios" / "paper.toml").task.reversed())
    assert planner.put(back) == OK
    assert planner.put({"task.trigger": 2}) == OK
    run(planner, 0, 10)
    waiting = planner.save()
    assert planner.put({"task.cancel": 5, "task.trigger": 3}) == OK
    expected = run(planner, 10, 1)
    cancelled = planner.save()
    expected += run(planner, 11, 700)
    assert planner.get("plan.count", "plan.cancelled", "plan.refused") == [3, 1, 0]
    assert planner.restore(cancelled) == OK
    assert run(planner, 11, 700) == expected[1:]
    assert planner.restore(waiting) == OK
    assert planner.get("plan.cancelled") == [0]
    assert planner.put({"task.cancel": 5, "task.trigger": 3}) == OK
    assert run(planner, 10, 701) == expected
    planner.free()
