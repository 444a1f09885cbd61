"""The state machine: which call is legal when, and what becomes of an instance by a wrong one."""

from __future__ import annotations

import ctypes as c
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from integration.fmi_slave import ERROR, OK, FmiSlave

from deltaph.fmu.model_description import FmiVersion
from deltaph.variables import Model

STATES = ("instantiated", "initialization mode", "step mode", "terminated")

# Function -> states in which it is legal, by first letters (FMI 2.0.5, 4.2.4; FMI 3.0.2, 2.3 and 4.2).
LEGAL = {
    "SetDebugLogging": "iIst",
    "EnterInitializationMode": "i",
    "ExitInitializationMode": "I",
    "Terminate": "s",
    "Reset": "iIst",
    "Set": "iIs",
    "Get": "Ist",
    "DoStep": "s",
    "GetFMUState": "iIst",
}
LETTER = dict(zip(STATES, "iIst", strict=True))


def bring(slave: FmiSlave, state: str) -> None:
    """Bring a fresh instance to a state."""
    if state == "initialization mode":
        assert slave.enter() == OK
    elif state != "instantiated":
        slave.initialize()
    if state == "terminated":
        assert slave.call("Terminate") == OK


def call(slave: FmiSlave, function: str) -> int:
    """Call a function with arguments that are right in themselves."""
    times = (0, c.c_double(0.0), c.c_double(0.0), 0, c.c_double(0.0))
    first = slave.table.of("input")[0]
    if function == "SetDebugLogging":
        return slave.call(function, 1, c.c_size_t(0), None)
    if function == "SetupExperiment":
        return slave.call(function, *times)
    if function == "EnterInitializationMode":
        if slave.version == 2 and slave.call("SetupExperiment", *times) != OK:
            return ERROR
        return slave.call(function, *(times if slave.version == 3 else ()))
    if function == "DoStep":
        return slave.step(0.0)
    if function == "Set":
        return slave.put({first.name: float(first.start or 0.0)})
    if function == "Get":
        kind, c_type = slave.type_of(first)
        return slave.access(f"Get{kind}", [first.value_reference], (c_type * 1)())
    if function == "GetFMUState":
        state = c.c_void_p()
        status = slave.call("GetFMUstate" if slave.version == 2 else function, c.byref(state))
        slave.drop(state)
        return status
    return slave.call(function)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("function", LEGAL)
def test_calls_are_legal_where_the_standard_says(slave: FmiSlave, state: str, function: str) -> None:
    check(slave, state, function, LEGAL[function] + ("i" if slave.version == 3 and function == "Get" else ""))


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("version", [2], indirect=True)
def test_an_experiment_is_set_up_before_initialization(slave: FmiSlave, state: str) -> None:
    check(slave, state, "SetupExperiment", "i")


@pytest.mark.parametrize("version", [2], indirect=True)
def test_initialization_needs_a_start_time(slave: FmiSlave) -> None:
    assert slave.call("EnterInitializationMode") == ERROR
    assert slave.last == "fmi2EnterInitializationMode: expected a start time before initialization but was none"


def check(slave: FmiSlave, state: str, function: str, legal: str) -> None:
    bring(slave, state)
    status = call(slave, function)
    if LETTER[state] in legal:
        assert status == OK, slave.messages
        assert not [message for message in slave.messages if message[0] == ERROR]
    else:
        assert status == ERROR
        assert slave.last.endswith(f"but was {state}")
        assert slave.messages[-1][1] == "logStatusError"


def test_an_error_terminates(running: FmiSlave) -> None:
    assert running.step(1.0) == ERROR
    assert running.step(0.0) == ERROR
    assert running.last.endswith("but was terminated")
    assert len(running.outputs()) == len(running.table.of("output"))


def test_an_error_is_healed_by_an_earlier_state(running: FmiSlave) -> None:
    state = running.save()
    assert running.step(1.0) == ERROR
    assert running.restore(state) == OK
    assert running.step(0.0) == OK
    assert running.drop(state) == OK


def test_reset_is_like_new(running: FmiSlave, new_slave: Callable[..., FmiSlave]) -> None:
    running.step(0.0, 0.1)
    fresh = new_slave("fresh")
    payload = {"payload.mass": 0.5}
    assert running.put(payload) == OK
    assert running.call("Reset") == OK
    assert running.serialize(running.save()) == fresh.serialize(fresh.save())
    running.initialize()
    fresh.initialize()
    assert running.outputs() == fresh.outputs()


def test_instances_do_not_touch_each_other(new_slave: Callable[..., FmiSlave]) -> None:
    alone, *others = (new_slave(f"slave {k}") for k in range(9))
    alone.initialize()
    for slave in others:
        slave.initialize()
    expected = []
    for n in range(50):
        assert alone.step(n * 1e-3) == OK
        expected.append(alone.outputs())
    for n in range(50):
        for slave in others:
            assert slave.step(n * 1e-3) == OK
            assert slave.outputs() == expected[n]


def test_a_null_instance_is_an_error(slave: FmiSlave) -> None:
    slave.free()
    assert slave.call("Reset") == ERROR
    assert slave.step(0.0) == ERROR
    slave.free()  # ignored


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"guid": "{0}"}, "expected the token {"),
        ({"name": ""}, "expected an instance name"),
        ({"name": " \t"}, "expected an instance name"),
        ({"name": None}, "expected an instance name"),
        ({"model_exchange": True}, "expected Co-Simulation but was Model Exchange"),
    ],
)
@pytest.mark.parametrize("logging", [False, True])
def test_instantiation_is_refused_with_a_reason(
    dist: Path, model: Model, version: FmiVersion, tmp_path: Path, arguments: dict[str, Any], sentence: str, logging: bool
) -> None:
    slave = FmiSlave(dist, model, version, tmp_path, logging=logging, **arguments)
    assert slave.component is None
    assert slave.messages[-1][:2] == (ERROR, "logStatusError")
    assert sentence in slave.last


@pytest.mark.parametrize("version", [3], indirect=True)
def test_event_mode_is_refused(dist: Path, model: Model, version: FmiVersion, tmp_path: Path) -> None:
    slave = FmiSlave(dist, model, version, tmp_path, events=True)
    assert slave.component is None
    assert "expected eventModeUsed false" in slave.last


@pytest.mark.parametrize(("start", "stop"), [(float("nan"), None), (float("inf"), None), (1.0, 0.5), (0.0, float("nan"))])
def test_impossible_times_are_refused(slave: FmiSlave, start: float, stop: float | None) -> None:
    assert slave.enter(start, stop) == ERROR
    assert "expected a" in slave.messages[0][2]


def test_what_the_models_do_not_have_is_refused(new_slave: Callable[..., FmiSlave]) -> None:
    functions = {
        2: ["EnterEventMode", "EnterContinuousTimeMode", "CancelStep", "SetTime", "GetDerivatives", "GetDirectionalDerivative"],
        3: ["EnterEventMode", "EnterStepMode", "EnterConfigurationMode", "UpdateDiscreteStates", "GetOutputDerivatives", "SetTime"],
    }
    version = new_slave().version
    for function in functions[version]:
        slave = new_slave(function)
        slave.initialize()
        assert slave.call(function, *(None,) * 8) == ERROR
        assert slave.last.startswith(f"fmi{version}{function}: expected no such call (")


def test_initialization_with_an_impossible_robot_is_an_error_with_a_reason(slave: FmiSlave) -> None:
    assert slave.enter() == OK
    assert slave.put({"robot.forearm_length": 0.0}) == OK
    assert slave.call("ExitInitializationMode") == ERROR
    assert "but were others" in slave.last
    assert len(slave.messages) >= 2
    assert slave.call("Reset") == OK
    slave.initialize()


def test_logging_follows_its_switches(slave: FmiSlave) -> None:
    categories = (c.c_char_p * 1)(b"logStatusDiscard")
    slave.initialize()
    assert slave.call("SetDebugLogging", 0, c.c_size_t(0), None) == OK
    slave.messages.clear()
    assert slave.put({"payload.mass": float("nan")}) == 2
    assert slave.messages == []
    assert slave.call("SetDebugLogging", 1, c.c_size_t(1), categories) == OK
    assert slave.put({"payload.mass": float("nan")}) == 2
    assert [message[1] for message in slave.messages] == ["logStatusDiscard"]
    unknown = (c.c_char_p * 1)(b"100 % of #all")
    assert slave.call("SetDebugLogging", 1, c.c_size_t(1), unknown) == ERROR
    assert slave.last.endswith('but was "100 _ of _all"')


def test_errors_are_logged_even_without_logging(new_slave: Callable[..., FmiSlave]) -> None:
    slave = new_slave(logging=False)
    slave.initialize()
    assert slave.messages == []
    assert slave.step(1.0) == ERROR
    assert [message[:2] for message in slave.messages] == [(ERROR, "logStatusError")]
