"""DeltaPlant when things go wrong: each fault does what physics says, each trip says why, where and when, and energy balances."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from integration.fmi_slave import OK, FmiSlave
from numpy.typing import NDArray
from reference.pinocchio_delta import PinocchioDelta

from deltaph.kernel import ffi, lib
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import load_scenario
from deltaph.variables import variable_table

Vector = NDArray[np.float64]

PAPER = load_scenario(Path(__file__).parents[2] / "scenarios" / "paper.toml")
PLAN = Plan.of(PAPER)
TABLE = variable_table("plant")
QUANTUM = 2.0 * np.pi / 2**20 / 20.0  # of the encoder, at the joint [rad]
FRICTIONLESS = {"drive.coulomb_friction": 0.0, "drive.viscous_friction": 0.0, "drive.gear_efficiency": 1.0}
POSITION, VELOCITY, TORQUE, MOTOR = (
    [f"{name.replace('[', f'[{i}')}" for i in (1, 2, 3)]
    for name in ("joint[].position", "joint[].velocity", "joint[].torque", "motor[].torque")
)
POINT = ["tcp.position.x", "tcp.position.y", "tcp.position.z"]


def columns(rows: Vector, names: list[str]) -> Vector:
    """Outputs by name from rows of all outputs (n, ...)."""
    outputs = [v.name for v in TABLE.of("output")]
    return rows[:, [outputs.index(name) for name in names]]


def trip(plant: FmiSlave) -> tuple[str, int, float]:
    """Why, which axis, when."""
    reason, axis, time = plant.get("trip", "trip_axis", "trip_time")
    return TABLE.items("Trip")[int(reason)], int(axis), time


def follow(plant: FmiSlave, first: int, steps: int, begin: int = 0) -> Vector:
    """Outputs after each of the steps from step `first` of the paper's case, which begins at step `begin`."""
    rows = []
    for n in range(first, first + steps):
        setpoint = PLAN.sample(np.array([(n - begin) * 1e-3]))[0]
        links = {"position_ref": "position", "velocity_ref": "velocity", "acceleration_ref": "acceleration", "torque_ff": "torque"}
        values = {f"joint[{i + 1}].{name}": setpoint[f"joint_{of}"][i] for name, of in links.items() for i in range(3)}
        assert plant.put(values) == OK
        assert plant.step(n * 1e-3) == OK, plant.messages
        rows.append(plant.outputs())
    return np.array(rows, dtype=np.float64)


def idle(plant: FmiSlave, first: int, steps: int) -> Vector:
    """Outputs after each of the steps from step `first`, inputs held."""
    rows = []
    for n in range(first, first + steps):
        assert plant.step(n * 1e-3) == OK, plant.messages
        rows.append(plant.outputs())
    return np.array(rows, dtype=np.float64)


def first_beyond(rows: Vector, first: int, distance: float) -> float:
    """Time [s] from step `first` until the tool centre point is that far from the plan."""
    planned = PLAN.sample(np.arange(first + 1, first + 1 + len(rows)) * 1e-3)["tcp_position"]
    off = np.linalg.norm(columns(rows, POINT) - planned, axis=1)
    return float(np.flatnonzero(off > distance)[0] + 1) * 1e-3


# Faults


def test_an_arm_without_torque_coasts_and_trips(plant: FmiSlave) -> None:
    plant.initialize()
    follow(plant, 0, 150)
    assert plant.put({"motor[1].torque_gain": 0.0}) == OK
    rows = follow(plant, 150, 200)
    assert np.abs(columns(rows[5:], ["motor[1].torque"])).max() < 1e-9
    # a separate simulation: 1 mm after 32 ms, 10 mm after 60 ms, 50 mm after 116 ms
    for distance, time in ((1e-3, 0.032), (10e-3, 0.060), (50e-3, 0.116)):
        assert first_beyond(rows, 150, distance) == pytest.approx(time, rel=0.3)
    reason, axis, time = trip(plant)
    assert (reason, axis) == ("position_deviation", 1)
    assert 0.25 < time < 0.3
    assert any("joint 1 is" in message and "away from its reference" in message for _, _, message in plant.messages)


def test_a_stuck_encoder_trips_within_milliseconds(plant: FmiSlave) -> None:
    plant.initialize()
    follow(plant, 0, 100)
    assert plant.put({"encoder[1].stuck": 1}) == OK
    follow(plant, 100, 20)
    reason, axis, time = trip(plant)
    assert (reason, axis) == ("encoder", 1)
    assert 0.1 < time < 0.105
    assert any("encoder 1 is" in message and "at most 0.2 rad" in message for _, _, message in plant.messages)


def test_a_stuck_encoder_nobody_checks_runs_away(plant: FmiSlave) -> None:
    assert plant.put({"trip_threshold.encoder": 1e6}) == OK
    plant.initialize()
    follow(plant, 0, 100)
    assert plant.put({"encoder[1].stuck": 1}) == OK
    rows = follow(plant, 100, 250)
    assert np.isfinite(rows).all()
    # a separate simulation: 1 mm after 4 ms, 10 mm after 11 ms, 50 mm after 24 ms
    for distance, time in ((1e-3, 0.004), (10e-3, 0.011), (50e-3, 0.024)):
        assert first_beyond(rows, 100, distance) == pytest.approx(time, abs=2e-3, rel=0.3)
    assert trip(plant)[0] != "none"
    assert columns(rows, VELOCITY)[-1].tolist() == [0.0] * 3


def test_an_offset_encoder_moves_the_robot_unnoticed(plant: FmiSlave) -> None:
    plant.initialize()
    home, offset = np.array(plant.get(*POSITION)), 0.008
    assert plant.put({"encoder[3].offset": offset}) == OK
    rows = idle(plant, 0, 400)
    moved = columns(rows, POSITION)[-1] - home
    assert moved == pytest.approx([0.0, 0.0, -offset], abs=2.0 * QUANTUM)
    assert trip(plant) == ("none", 0, 0.0)
    assert plant.put({"encoder[3].offset": 0.02}) == OK
    idle(plant, 400, 1)
    assert trip(plant)[:2] == ("encoder", 3)


def test_motors_give_no_more_than_their_limit(plant: FmiSlave) -> None:
    plant.initialize()
    assert plant.put({f"motor[{i}].torque_limit": limit for i, limit in ((1, 1.0), (2, 1.5), (3, 100.0))}) == OK
    rows = follow(plant, 0, 300)
    most = np.abs(columns(rows, MOTOR)).max(axis=0)
    assert most[0] == pytest.approx(1.0, rel=1e-6)
    assert most[1] == pytest.approx(1.5, rel=1e-6)
    assert most[2] > 2.0


def test_what_is_caught_in_motion_keeps_the_momentum_and_what_is_dropped_flies_on(plant: FmiSlave) -> None:
    assert plant.put(FRICTIONLESS) == OK
    plant.initialize()
    assert plant.put({"servo_on": 0}) == OK
    idle(plant, 0, 80)
    payload = 0.0
    for n, mass in ((80, 1.0), (81, 0.25)):
        theta, point, rate = (np.array(plant.get(*names)) for names in (POSITION, POINT, VELOCITY))
        assert np.abs(rate).max() > 1.0
        motion = ffi.new("dph_motion *", {"theta": list(theta), "point": list(point), "theta_d": list(rate)})
        robot = Robot.default().struct
        if mass > payload:
            assert lib.dph_take_up(robot, payload, mass - payload, motion)
            assert np.abs(np.array(list(motion.theta_d)) - rate).max() > 0.1
        assert lib.dph_forward_dynamics(robot, mass, motion)
        expected = np.array(list(motion.theta_d)) + 1e-3 * np.array(list(motion.theta_dd))
        assert plant.put({"payload.mass": mass}) == OK
        idle(plant, n, 1)
        assert plant.get(*VELOCITY) == pytest.approx(expected, abs=1e-3)  # of second order in the step
        payload = mass


def test_a_force_on_the_platform_is_held_and_felt(plant: FmiSlave) -> None:
    plant.initialize()
    force = {"tcp.force.x": 10.0, "tcp.force.y": -20.0, "tcp.force.z": 30.0}
    assert plant.put(force) == OK
    rows = idle(plant, 0, 1000)
    motion = ffi.new("dph_motion *", {"theta": plant.get(*POSITION), "point": plant.get(*POINT), "force": list(force.values())})
    lib.dph_inverse_dynamics(Robot.default().struct, 0.0, motion)
    # a tenth of the holding torque on the way, none of it in the end but for friction at rest
    assert columns(rows, TORQUE)[-1] == pytest.approx(list(motion.torque), abs=1e-3)
    assert np.linalg.norm(columns(rows, POINT)[-1] - columns(rows, POINT)[0]) < 1e-3


def test_a_force_that_is_there_from_the_start_is_in_equilibrium(plant: FmiSlave) -> None:
    assert plant.put({"tcp.force.z": 40.0}) == OK
    plant.initialize()
    home = plant.get(*POSITION)
    rows = idle(plant, 0, 200)
    assert np.abs(columns(rows, POSITION) - home).max() < 0.01 * QUANTUM


def test_brakes_hold_while_drives_are_off_and_let_go_when_they_are_on(plant: FmiSlave) -> None:
    plant.initialize()
    home = np.array(plant.get(*POSITION))
    assert plant.put({"servo_on": 0, "brake": 1}) == OK
    rows = idle(plant, 0, 500)
    assert np.abs(columns(rows, POSITION) - home).max() < 1e-4
    assert columns(rows, MOTOR)[-1].tolist() == [0.0] * 3
    assert plant.put({"servo_on": 1, "brake": 0}) == OK
    follow(plant, 500, 350, begin=500)
    assert np.linalg.norm(np.array(plant.get(*POINT)) - PAPER.task.place) < 1e-4
    assert trip(plant)[0] == "none"


@pytest.mark.parametrize(
    "stop", [{}, {"hard_stop.stiffness": 1e9, "hard_stop.damping": 1e9}], ids=["default", "too stiff to integrate"]
)
def test_without_drives_and_brakes_the_robot_falls_into_its_hard_stops(plant: FmiSlave, stop: dict[str, float]) -> None:
    most = 0.9
    assert plant.put(FRICTIONLESS | stop | {"robot.joint_position_max": most, "trip_threshold.joint_range": 1.0}) == OK
    plant.initialize()
    assert plant.put({"servo_on": 0}) == OK
    assert plant.put({"payload.mass": 2.0}) == OK
    rows = idle(plant, 0, 3000)
    assert np.isfinite(rows).all()
    depth = columns(rows, POSITION) - (most + TABLE["hard_stop.clearance"].start)
    assert depth.max() < 0.05
    assert (depth.max(axis=0) > 0.0).all()
    # at rest on springs: 6 N m over 2e5 N m/rad
    assert np.abs(columns(rows, VELOCITY)[-1]).max() < 1e-3
    assert depth[-1] == pytest.approx(0.0, abs=1e-4)
    assert trip(plant)[0] == "none"


# Trips


@pytest.mark.parametrize(
    ("values", "inputs", "reason", "axis"),
    [
        ({"drive.torque_rated": 0.05, "drive.thermal_time_constant": 0.05}, {}, "overload", 2),
        ({"trip_threshold.constraint": 0.0}, {}, "constraint", 0),
        ({"robot.joint_position_min": 0.2}, {}, "joint_range", 1),
        ({"robot.joint_position_max": 3.0}, {"servo_on": 0, "payload.mass": 5.0}, "singularity", 0),
        ({"robot.joint_position_max": 3.0, "trip_threshold.overspeed": 1e3}, {"tcp.force.z": -1e9}, "kinematics", 0),
    ],
)
def test_trips_say_why_and_where(
    plant: FmiSlave, values: dict[str, float], inputs: dict[str, float], reason: str, axis: int
) -> None:
    assert plant.put(values) == OK
    plant.initialize()
    for name, value in inputs.items():
        assert plant.put({name: value}) == OK
    rows = follow(plant, 0, 600)
    assert np.isfinite(rows).all()
    assert trip(plant)[:2] == (reason, axis)
    time = trip(plant)[2]
    row = int(np.flatnonzero(columns(rows, ["trip"])[:, 0])[0])
    assert row * 1e-3 - 1e-12 <= time <= (row + 1) * 1e-3 + 1e-12
    assert sum("tripped" in message for _, _, message in plant.messages) == 1
    assert columns(rows, VELOCITY)[-1].tolist() == [0.0] * 3


# Energy


def energy(rows: Vector, payload: float) -> Vector:
    """Kinetic and potential energy [J] after each step, by Pinocchio's model of the true mechanism."""
    parameters = {name.removeprefix("robot."): value for name, value in Robot.default().parameters.items()}
    oracle = PinocchioDelta(parameters, payload)
    result = []
    for theta, point, rate in zip(columns(rows, POSITION), columns(rows, POINT), columns(rows, VELOCITY), strict=True):
        q = oracle.configuration(theta, point)
        result.append(oracle.energy(q, oracle.velocity(q, rate)))
    return np.array(result)


def test_a_fall_without_torque_and_friction_keeps_its_energy(plant: FmiSlave) -> None:
    assert plant.put(FRICTIONLESS) == OK
    plant.initialize()
    assert plant.put({"servo_on": 0}) == OK
    rows = idle(plant, 0, 250)[20:]  # the torque loop takes some milliseconds to let go of the holding torque
    assert np.abs(columns(rows, VELOCITY)).max() > 4.0
    energies = energy(rows, 0.0)
    drift = np.abs(energies - energies[0]).max() / (len(rows) * 1e-3)
    assert drift < 1e-8


@pytest.mark.parametrize("payload", [0.0, 1.0])
def test_the_power_balance_closes(plant: FmiSlave, payload: float) -> None:
    assert plant.put({"payload.mass": payload}) == OK
    plant.initialize()
    start = np.array([plant.outputs()])
    rows = np.vstack([start, follow(plant, 0, 303)])
    work = columns(rows, [f"joint[{i}].work" for i in (1, 2, 3)])
    # what the joints get is what the mechanism has: to 1e-8 of the 10 J that go in and out
    assert work.sum(axis=1) == pytest.approx(energy(rows, payload) - energy(start, payload)[0], abs=1e-7)
    # what the motors give and the joints do not get is lost in gears and friction, which never give anything back
    given_, back = (columns(rows, [f"motor[{i}].{name}" for i in (1, 2, 3)]) for name in ("work", "regenerated"))
    lost = given_ - back - work
    assert (np.diff(lost, axis=0) >= -1e-12).all()
    assert (lost[-1] > 0.5).all()
    power = columns(rows, MOTOR) * columns(rows, [f"motor[{i}].speed" for i in (1, 2, 3)])
    assert columns(rows, [f"motor[{i}].power" for i in (1, 2, 3)]) == pytest.approx(power)
    # samples of a torque that steps with its feed-forward every millisecond
    assert (given_ - back)[-1] == pytest.approx(np.trapezoid(power, dx=1e-3, axis=0), abs=0.2)


def test_load_is_first_order_and_rms_is_that_of_the_run(plant: FmiSlave) -> None:
    rated, constant = 0.2, 0.5
    values = {"drive.torque_rated": rated, "drive.thermal_time_constant": constant, "trip_threshold.overload": 100.0}
    assert plant.put(values) == OK
    plant.initialize()
    holding = np.array(plant.get(*MOTOR))
    idle(plant, 0, 700)
    final = (holding / rated) ** 2
    loads = plant.get(*(f"motor[{i}].load" for i in (1, 2, 3)))
    assert loads == pytest.approx(final * (1.0 - np.exp(-0.7 / constant)), rel=1e-6)
    assert plant.get(*(f"motor[{i}].torque_rms" for i in (1, 2, 3))) == pytest.approx(np.abs(holding), rel=1e-6)


# Whatever it is given

HUGE = sys.float_info.max
PARAMETERS = [v.name for v in TABLE.of("parameter")]
INPUTS = [v.name for v in TABLE.of("input")]
values = st.one_of(st.floats(-HUGE, HUGE), st.floats(-10.0, 10.0), st.sampled_from([0.0, 1.0, 1e-9, 1e9, -1e9]))


def put_legal(plant: FmiSlave, name: str, value: float) -> None:
    """Set a variable to a value, or to the nearest legal one."""
    variable = TABLE[name]
    value = max(value, -HUGE if variable.min is None else variable.min)
    value = min(value, HUGE if variable.max is None else variable.max)
    if variable.type == "Boolean":
        value = value > 0.0
    assert plant.put({name: value if variable.is_float else int(value)}) == OK


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(st.sampled_from(PARAMETERS), values), max_size=4),
    st.lists(st.tuples(st.sampled_from(INPUTS), values), max_size=6),
    st.lists(st.tuples(st.sampled_from(INPUTS), values), max_size=6),
)
def test_outputs_are_finite_whatever_goes_wrong(
    new_plant: Callable[[], FmiSlave],
    parameters: list[tuple[str, float]],
    before: list[tuple[str, float]],
    after: list[tuple[str, float]],
) -> None:
    plant = new_plant()
    for name, value in parameters:
        put_legal(plant, name, value)
    assert plant.enter() == OK
    if plant.call("ExitInitializationMode") != OK:
        assert plant.messages  # no robot can be made of it, and the log says why
        return
    for n, changes in enumerate((before, after)):
        for name, value in changes:
            put_legal(plant, name, value)
        for k in range(2):
            assert plant.step((2 * n + k) * 0.02, 0.02) == OK
            assert np.isfinite(plant.outputs()).all()


def test_a_state_amid_faults_goes_on_bit_for_bit(plant: FmiSlave) -> None:
    plant.initialize()
    follow(plant, 0, 100)
    assert plant.put({"encoder[2].offset": 0.005, "tcp.force.y": 30.0, "motor[1].torque_gain": 0.7}) == OK
    follow(plant, 100, 20)
    state = plant.save()
    content = plant.serialize(state)
    expected = follow(plant, 120, 150)
    assert plant.restore(state) == OK
    assert (follow(plant, 120, 150) == expected).all()
    status, copy = plant.deserialize(content)
    assert status == OK
    assert plant.restore(copy) == OK
    assert (follow(plant, 120, 150) == expected).all()
