"""DeltaPlant: rests where it starts, follows its reference, trips when it has to, and stays finite whatever it is given."""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from integration.fmi_slave import ERROR, OK, FmiSlave

from deltaph.execution import Execution, Trace, evaluate
from deltaph.fmu import cached_fmus
from deltaph.importer import cosimulate
from deltaph.kernel import ffi, lib
from deltaph.robot import Robot
from deltaph.scenario import load_scenario
from deltaph.schedule import schedule
from deltaph.variables import variable_table

SCENARIOS = Path(__file__).parents[2] / "scenarios"
TABLE = variable_table("plant")
TRIPS = TABLE.items("Trip")
QUANTUM = 2.0 * np.pi / 2**20 / 20.0  # of the encoder, at the joint [rad]
POSITIONS = [f"joint[{i}].position" for i in (1, 2, 3)]
INPUTS = [v.name for v in TABLE.of("input")]


def run(plant: FmiSlave, first: int, steps: int) -> np.ndarray:
    """Outputs after each of the steps that begin at step `first`."""
    rows = []
    for n in range(first, first + steps):
        assert plant.step(n * 1e-3) == OK, plant.messages
        rows.append(plant.outputs())
    return np.array(rows, dtype=np.float64)


def trip(plant: FmiSlave) -> str:
    return TRIPS[int(plant.get("trip")[0])]


def executed(name: str) -> Execution:
    scenario = load_scenario(SCENARIOS / f"{name}.toml")
    planned = schedule(scenario)
    return evaluate(Trace(list(cosimulate(scenario, planned, cached_fmus()))), planned)


# Rest


@pytest.mark.parametrize(
    "values",
    [
        {},
        TABLE.gains["factory"],
        {"payload.mass": 1.0},
        {"joint[1].torque_ff": 0.0, "joint[2].torque_ff": 5.0},
    ],
    ids=["unedited", "factory gains", "payload", "wrong feed-forward"],
)
def test_robot_rests_where_it_starts(plant: FmiSlave, values: dict[str, float]) -> None:
    assert not values or plant.put(values) == OK
    plant.initialize()
    start = plant.get(*POSITIONS)
    rows = run(plant, 0, 1000)
    columns = [[v.name for v in TABLE.of("output")].index(name) for name in POSITIONS]
    assert np.abs(rows[:, columns] - start).max() < 0.01 * QUANTUM
    assert np.abs(plant.get("joint[1].velocity", "joint[2].velocity", "joint[3].velocity")).max() < 1e-9
    assert trip(plant) == "none"


def test_robot_rests_at_another_start(plant: FmiSlave) -> None:
    point = np.array([0.1, 0.13, -0.75])
    theta = Robot.default().inverse_kinematics(point)
    assert plant.put(dict(zip(("start.x", "start.y", "start.z"), point, strict=True))) == OK
    assert plant.put({f"joint[{i + 1}].position_ref": theta[i] for i in range(3)}) == OK
    plant.initialize()
    run(plant, 0, 100)
    assert plant.get("tcp.position.x", "tcp.position.y", "tcp.position.z") == pytest.approx(point, abs=1e-9)


def test_start_values_of_the_reference_are_those_of_the_start_point(plant: FmiSlave) -> None:
    plant.initialize()
    references, torques = ([f"joint[{i}].{name}" for i in (1, 2, 3)] for name in ("position_ref", "torque_ff"))
    assert plant.get(*references) == plant.get(*POSITIONS)
    assert [TABLE[name].start for name in torques] == pytest.approx(
        plant.get("joint[1].torque", "joint[2].torque", "joint[3].torque"), abs=1e-14
    )


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"start.z": -1.4}, "out of reach of arm 1"),
        ({"start.x": 0.0, "start.z": -1.1394}, "too close to a singularity"),
        ({"start.x": 0.3, "start.z": -0.5}, "joint 1 would have to turn to"),
        ({"robot.upper_arm_length": 0.0}, "the robot is not valid"),
        ({"robot.drive_inertia": 0.0, "robot.upper_arm_inertia": 0.0}, "the robot is not valid"),
        ({"drive.position_gain": 1e300}, "drive.position_gain is 1e+300: at most 1e+09"),
    ],
)
def test_what_cannot_start_is_refused_with_the_reason(plant: FmiSlave, values: dict[str, float], reason: str) -> None:
    assert plant.put(values) == OK
    assert plant.enter() == OK
    assert plant.call("ExitInitializationMode") == ERROR
    assert any(reason in message for _, _, message in plant.messages)


# The paper's case


def test_tuned_drives_keep_the_papers_path() -> None:
    result = executed("paper")
    assert result.tracking_error_tcp_max < 0.1e-3
    assert result.corner_deviation == pytest.approx((6e-3, 6e-3), abs=0.05e-3)
    assert result.tracking_error_joint_max < 0.25e-3
    assert max(result.motor_torque_max) == pytest.approx(2.76, abs=0.05)
    assert max(result.motor_torque_rms) == pytest.approx(0.926, abs=0.02)
    assert result.trip == "none"


def test_factory_gains_lag_behind_and_cut_the_corner() -> None:
    result = executed("factory_gains")
    assert result.tracking_error_tcp_max == pytest.approx(31e-3, abs=0.5e-3)
    assert result.corner_deviation[0] == pytest.approx(9.2e-3, abs=0.1e-3)
    assert result.trip == "none"


# Steps


def test_a_long_step_is_as_many_single_ones_with_the_reference_extrapolated(new_plant: Callable[[], FmiSlave]) -> None:
    plants = new_plant(), new_plant()
    for plant in plants:
        plant.initialize()
    n, position, velocity, acceleration = 20, plants[0].get(*POSITIONS), 0.8, -12.0
    for plant, size in zip(plants, (n, 1), strict=True):
        for k in range(0, n, size):
            t = k * 1e-3
            values = {
                f"joint[{i + 1}].{name}": value
                for i in range(3)
                for name, value in (
                    ("position_ref", position[i] + velocity * t + acceleration * t**2 / 2),
                    ("velocity_ref", velocity + acceleration * t),
                    ("acceleration_ref", acceleration),
                )
            }
            assert plant.put(values) == OK
            assert plant.step(t, size * 1e-3) == OK
    one, many = (np.array(plant.outputs()) for plant in plants)
    assert np.abs(plants[0].get(*POSITIONS)[0] - position[0]) > 0.01
    # rounding of the reference may move an encoder reading by a count
    scale = np.array([{"rad": 1.0, "m": 1.0, None: 1.0}.get(v.unit, 1e4) for v in TABLE.of("output")])
    assert (np.abs(one - many) <= 2.0 * QUANTUM * scale).all()


def test_instances_are_independent(new_plant: Callable[[], FmiSlave]) -> None:
    still, moving = new_plant(), new_plant()
    for plant in (still, moving):
        plant.initialize()
    before = still.outputs()
    assert moving.put({"joint[1].velocity_ref": 1.0}) == OK
    run(moving, 0, 5)
    assert still.outputs() == before
    run(still, 0, 5)
    assert moving.outputs() != still.outputs()
    assert still.get(*POSITIONS) == before[:3]


def test_payload_takes_effect_at_once(plant: FmiSlave) -> None:
    plant.initialize()
    rods = [f"rod[{i}].force" for i in (1, 2, 3)]
    before = sum(plant.get(*rods))
    assert plant.put({"payload.mass": 2.0}) == OK
    assert plant.step(0.0) == OK
    assert sum(plant.get(*rods)) > before + 10.0
    assert plant.get("tcp.velocity.z")[0] < 0.0


def test_without_torque_and_friction_the_robot_falls_as_the_kernel_says(plant: FmiSlave) -> None:
    values = {"drive.torque_max": 0.0, "drive.coulomb_friction": 0.0, "drive.viscous_friction": 0.0}
    assert plant.put(values | {"trip_threshold.position_deviation": 10.0}) == OK
    plant.initialize()
    theta, rate = np.array(plant.get(*POSITIONS)), np.zeros(3)
    run(plant, 0, 100)

    def acceleration(theta: np.ndarray, rate: np.ndarray) -> np.ndarray:
        motion = ffi.new("dph_motion *", {"theta": list(theta), "theta_d": list(rate)})
        assert lib.dph_forward_dynamics(Robot.default().struct, 0.0, motion)
        return np.array(list(motion.theta_dd))

    h = 2.5e-4  # RK4 at twice the plant's step
    for _ in range(400):
        v1, a1 = rate, acceleration(theta, rate)
        v2, a2 = rate + h / 2 * a1, acceleration(theta + h / 2 * v1, rate + h / 2 * a1)
        v3, a3 = rate + h / 2 * a2, acceleration(theta + h / 2 * v2, rate + h / 2 * a2)
        v4, a4 = rate + h * a3, acceleration(theta + h * v3, rate + h * a3)
        theta, rate = theta + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4), rate + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    assert np.abs(rate).max() > 1.0
    assert plant.get(*POSITIONS) == pytest.approx(theta, abs=2e-12)


# Trips


def test_deviation_trips_and_the_trip_latches(plant: FmiSlave) -> None:
    plant.initialize()
    home = plant.get("joint[2].position")[0]
    assert plant.put({"joint[2].position_ref": home + 0.2}) == OK
    assert plant.step(0.0) == OK
    assert trip(plant) == "position_deviation"
    said = [message for _, _, message in plant.messages if "tripped" in message]
    assert len(said) == 1
    assert "tripped after 0.000 steps of 1 ms: joint 2 is 0.2 rad away from its reference, at most 0.15 rad" in said[0]

    assert plant.put({"joint[2].position_ref": home}) == OK
    rows = run(plant, 1, 300)
    assert trip(plant) == "position_deviation"
    going_on = [v.name.endswith((".load", ".torque_rms")) for v in plant.table.of("output")]
    assert (rows[0] == rows[-1])[np.logical_not(going_on)].all()
    assert (rows[0] > rows[-1])[going_on].all()
    assert plant.get("motor[1].torque", "motor[2].torque", "motor[3].torque") == [0.0] * 3


def test_motors_cool_after_a_trip(plant: FmiSlave) -> None:
    plant.initialize()
    assert plant.step(0.0, 5.0) == OK
    assert plant.put({"encoder[1].offset": 0.5}) == OK
    assert plant.step(5.0, 0.1) == OK
    hot = plant.get(*(f"motor[{i}].load" for i in (1, 2, 3)))
    assert plant.get("trip") != [0]
    assert plant.step(5.1, 10.0) == OK
    cooled = plant.get(*(f"motor[{i}].load" for i in (1, 2, 3)))
    assert cooled == pytest.approx([x * math.exp(-10.0 / 25.0) for x in hot], rel=1e-9)


def test_a_moving_robot_brakes_to_a_standstill(plant: FmiSlave) -> None:
    plant.initialize()
    home = np.array(plant.get(*POSITIONS))
    for n in range(100):  # all arms down, up to 4 rad/s
        t = n * 1e-3
        reference = {
            f"joint[{i + 1}].{name}": value
            for i in range(3)
            for name, value in (("position_ref", home[i] + 20.0 * t**2), ("velocity_ref", 40.0 * t), ("acceleration_ref", 40.0))
        }
        assert plant.put(reference) == OK
        assert plant.step(t) == OK
    assert trip(plant) == "none"
    at_trip, speed = plant.get("joint[2].position", "joint[2].velocity")
    assert speed > 3.5
    assert plant.put({"joint[3].position_ref": 5.0}) == OK
    run(plant, 100, 200)
    stopped, speed = plant.get("joint[2].position", "joint[2].velocity")
    assert speed == 0.0
    assert 0.01 < stopped - at_trip < 0.2


def test_overspeed_trips(plant: FmiSlave) -> None:
    values = {"drive.speed_max": 10.0, "trip_threshold.overspeed": 1.0, "trip_threshold.position_deviation": 10.0}
    assert plant.put(values) == OK
    plant.initialize()
    assert plant.put({"joint[3].position_ref": 2.0}) == OK
    run(plant, 0, 100)
    assert trip(plant) == "overspeed"
    assert any("motor 3 runs at" in message and "at most 10 rad/s" in message for _, _, message in plant.messages)


def test_a_joint_that_leaves_its_range_stops_there(plant: FmiSlave) -> None:
    assert plant.put({"trip_threshold.position_deviation": 10.0, "trip_threshold.overspeed": 100.0}) == OK
    plant.initialize()
    assert plant.put({f"joint[{i}].position_ref": -3.0 for i in (1, 2, 3)}) == OK
    rows = run(plant, 0, 1000)
    assert trip(plant) == "joint_range"
    assert np.isfinite(rows).all()
    assert min(plant.get(*POSITIONS)) > TABLE["robot.joint_position_min"].start - 0.05
    assert plant.get("joint[1].velocity") == [0.0]


HUGE = sys.float_info.max
wild = st.floats(allow_nan=False, allow_infinity=False)


def put_legal(plant: FmiSlave, name: str, value: float) -> None:
    """Set a variable to a value, or to the nearest legal one."""
    variable = TABLE[name]
    low, high = (-HUGE if variable.min is None else variable.min), (HUGE if variable.max is None else variable.max)
    value = min(max(value, low), high)
    assert plant.put({name: value if variable.is_float else int(value > 0.0)}) == OK


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.sampled_from(INPUTS), wild), min_size=1, max_size=4), st.integers(1, 50))
@example([("payload.mass", HUGE)], 1)
@example([("joint[1].position_ref", HUGE), ("joint[1].velocity_ref", HUGE), ("joint[1].acceleration_ref", HUGE)], 2000)
@example([("joint[2].torque_ff", -HUGE)], 50)
def test_outputs_are_finite_whatever_the_inputs_are(
    new_plant: Callable[[], FmiSlave], values: list[tuple[str, float]], n: int
) -> None:
    plant = new_plant()
    plant.initialize()
    for name, value in values:
        put_legal(plant, name, value)
    for k in range(3):
        assert plant.step(k * n * 1e-3, n * 1e-3) == OK
        assert np.isfinite(plant.outputs()).all()
