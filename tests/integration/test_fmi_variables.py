"""Variables: readable and settable as declared, and every wrong access refused without a trace."""

from __future__ import annotations

import ctypes as c
import math
from collections.abc import Callable

import pytest
from integration.fmi_slave import DISCARD, ERROR, OK, FmiSlave

from deltaph.variables import Variable


def settable(slave: FmiSlave) -> list[Variable]:
    return [v for v in slave.table if v.causality != "output"]


def test_a_fresh_instance_has_the_start_values(slave: FmiSlave) -> None:
    if slave.version == 2:
        slave.enter()  # FMI 2.0 has no reading before that
    for variable in settable(slave):
        assert slave.get(variable.name) == [variable.start]


def test_every_variable_is_settable_as_declared(slave: FmiSlave) -> None:
    slave.enter()
    for variable in settable(slave):
        low = -1e3 if variable.min is None else variable.min
        high = 1e3 if variable.max is None else variable.max
        value = 1 if variable.type in slave.table.enumerations else low + 0.25 * (high - low)
        if variable.type == "Boolean":
            value = not variable.start
        assert slave.put({variable.name: value if variable.is_float else int(value)}) == OK, slave.messages
    for variable in settable(slave):
        assert slave.get(variable.name) != [variable.start], variable.name


def test_every_output_is_readable_and_finite(running: FmiSlave) -> None:
    assert all(math.isfinite(value) for value in running.outputs())
    assert running.step(0.0) == OK
    assert all(math.isfinite(value) for value in running.outputs())


def test_inputs_alone_are_settable_while_stepping(running: FmiSlave, new_slave: Callable[..., FmiSlave]) -> None:
    for variable in running.table.of("input"):
        assert running.put({variable.name: variable.start or 0}) == OK
    for name in ("robot.base_radius", "joint[1].position"):
        slave = new_slave(name)
        slave.initialize()
        before = slave.get(name)
        assert slave.put({name: 0.3}) == ERROR
        assert slave.last.split(": ", 1)[1].startswith("expected an input but was the ")
        assert slave.get(name) == before


def test_outputs_are_never_settable(new_slave: Callable[..., FmiSlave]) -> None:
    for output in new_slave().table.of("output"):
        slave = new_slave(output.name)
        assert slave.put({output.name: 0}) == ERROR
        assert slave.last.endswith(f"expected an input or a parameter but was the output {output.name}")


def test_outputs_of_initialization_follow_what_is_set(slave: FmiSlave) -> None:
    slave.enter()
    first = slave.get("tcp.position.x")
    name = "task.pick.x" if "Planner" in slave.table.model else "start.x"
    slave.messages.clear()
    assert slave.put({name: -0.1}) == OK
    second = slave.get("tcp.position.x")
    assert second != first
    assert slave.messages == []
    assert slave.call("ExitInitializationMode") == OK
    assert slave.get("tcp.position.x") == second


def test_reading_an_output_does_not_change_the_outcome(new_slave: Callable[..., FmiSlave]) -> None:
    curious, calm = new_slave("curious"), new_slave("calm")
    curious.enter()
    curious.outputs()
    assert curious.call("ExitInitializationMode") == OK
    calm.initialize()
    for n in range(20):
        assert curious.step(n * 1e-3) == calm.step(n * 1e-3) == OK
    assert curious.serialize(curious.save()) == calm.serialize(calm.save())


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_discarded(running: FmiSlave, value: float) -> None:
    floats = [v.name for v in running.table.of("input") if v.is_float][:2]
    before = running.get(*floats)
    assert running.put({floats[0]: 0.125, floats[1]: value}) == DISCARD
    assert f"expected a finite value of {floats[1]}" in running.last
    assert running.get(*floats) == before
    assert running.step(0.0) == OK


def test_values_out_of_range_are_discarded(slave: FmiSlave) -> None:
    slave.enter()
    for variable in settable(slave):
        bounds = [(variable.min, -1), (variable.max, 1)]
        if variable.type in slave.table.enumerations:
            bounds = [(0, -1), (len(slave.table.items(variable.type)) - 1, 1)]
        for bound, outwards in bounds:
            if bound is None:
                continue
            beyond = math.nextafter(bound, outwards * math.inf) if variable.is_float else int(bound) + outwards
            assert slave.put({variable.name: beyond}) == DISCARD, variable.name
            assert f"expected a value of {variable.name} from " in slave.last
            assert slave.get(variable.name) == [variable.start]
            assert slave.put({variable.name: bound if variable.is_float else int(bound)}) == OK
            assert slave.put({variable.name: variable.start or 0}) == OK


@pytest.mark.parametrize("access", ["Get", "Set"])
def test_unknown_value_references_are_errors(new_slave: Callable[..., FmiSlave], access: str) -> None:
    version = new_slave().version
    known = {v.value_reference for v in new_slave().table} | ({0} if version == 3 else set())
    for reference in (0, 14, 99, 10_000, 2**32 - 1):
        if reference in known:
            continue
        slave = new_slave("wrong")
        slave.enter()
        kind = "Float64" if version == 3 else "Real"
        assert slave.access(f"{access}{kind}", [1, reference], (c.c_double * 2)(0.3, 0.3)) == ERROR
        assert slave.last.endswith(f"but was {reference}")
        assert slave.get("robot.base_radius") == [0.2]


@pytest.mark.parametrize("access", ["Get", "Set"])
def test_every_other_type_is_an_error(new_slave: Callable[..., FmiSlave], access: str) -> None:
    version = new_slave().version
    kinds = {
        2: ["Real", "Integer", "Boolean", "String"],
        3: [
            "Float64",
            "Float32",
            *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
            "Boolean",
            "String",
            "Clock",
        ],
    }[version]
    for variable in [v for v in new_slave().table if v.index in (None, 0) and (access == "Get" or v.causality != "output")]:
        for kind in kinds:
            slave = new_slave(kind)
            slave.enter()
            if kind == slave.type_of(variable)[0]:
                continue
            buffer = (c.c_char * 8)()
            assert slave.access(f"{access}{kind}", [variable.value_reference], buffer) == ERROR
            function, sentence = slave.last.split(": ")
            assert function == f"fmi{version}{access}{kind}"
            assert sentence.startswith(f"expected a variable of the function's type but was {variable.name}, a ")
            slave.free()


def test_nothing_asked_is_nothing_wrong(running: FmiSlave) -> None:
    for kind in ("Real", "String") if running.version == 2 else ("Float64", "UInt8", "String"):
        assert running.call(f"Get{kind}", None, c.c_size_t(0), None, c.c_size_t(0)) == OK


def test_null_pointers_are_errors(new_slave: Callable[..., FmiSlave]) -> None:
    one = c.c_size_t(1)
    reference, value = (c.c_uint32 * 1)(1), (c.c_double * 1)(0.2)
    for arguments in ((None, one, value, one), (reference, one, None, one)):
        for access in ("Get", "Set"):
            slave = new_slave("null")
            slave.enter()
            kind = "Real" if slave.version == 2 else "Float64"
            assert slave.call(f"{access}{kind}", *arguments) == ERROR
            assert slave.last.endswith("but was NULL")


@pytest.mark.parametrize("n", [0, 1, 3])
@pytest.mark.parametrize("version", [3], indirect=True)
def test_a_wrong_number_of_values_is_an_error(slave: FmiSlave, n: int) -> None:
    slave.enter()
    assert slave.access("GetFloat64", [1, 2], (c.c_double * 3)(), n) == ERROR
    assert slave.last == f"fmi3GetFloat64: expected nValues 2 but was {n}"


@pytest.mark.parametrize("version", [3], indirect=True)
def test_time_is_a_variable_of_fmi_3(slave: FmiSlave) -> None:
    value = (c.c_double * 1)()
    slave.initialize(start=2.5)
    for n in range(10):
        assert slave.access("GetFloat64", [0], value) == OK
        assert value[0] == 2.5 + n * 1e-3
        assert slave.step(2.5 + n * 1e-3) == OK
        assert slave.last_time == 2.5 + (n + 1) * 1e-3
    assert slave.access("SetFloat64", [0], value) == ERROR
    assert slave.last.endswith("but was the independent variable time")
