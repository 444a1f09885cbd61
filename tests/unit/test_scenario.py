"""Scenario files: units removed once, everything wrong said in one line that names the key and the way out."""

import hashlib
import math
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from deltaph.errors import ScenarioError
from deltaph.scenario import load_scenario, parse_scenario, template
from deltaph.scenario_file import DriveSection, RobotSection, ScenarioFile, TripSection
from deltaph.sources import ROBOTS
from deltaph.variables import variable_table

ROOT = Path(__file__).parents[2]
PATH = Path("test.toml")


def changed(old: str, new: str) -> str:
    text = template()
    assert old in text, old
    return text.replace(old, new)


def test_units_are_removed_once() -> None:
    scenario = parse_scenario(template(), PATH)
    assert scenario.task.pick == (-0.1525, 0.0, -0.8)
    assert scenario.task.lift == (0.05, 0.05)
    assert scenario.task.corner_deviation == (0.006, 0.006)
    assert scenario.law.corner_mid_speed == 0.8
    assert scenario.settle == 0.05
    assert scenario.communication_step_ms == 1


def test_limits_replace_those_of_the_drives_and_absent_means_unlimited() -> None:
    assert parse_scenario(template(), PATH).limits.joint_velocity == pytest.approx((4500 / 60 * 2 * math.pi / 20,) * 3)
    limits = parse_scenario(template() + "\n[limits]\njoint_torque_Nm = [80.0, 60, 70.0]\n", PATH).limits
    assert limits.joint_torque == (80.0, 60.0, 70.0)
    assert limits.joint_velocity == (math.inf,) * 3
    assert limits.tcp_speed == math.inf


def test_any_robot_is_a_scenario_away() -> None:
    scenario = parse_scenario(template() + "\n[robot]\nforearm_mm = 790.0\njoint_position_max_deg = 90.0\n", PATH)
    assert scenario.robot.parameters["robot.forearm_length"] == 0.79
    assert scenario.robot.parameters["robot.joint_position_max"] == math.pi / 2
    assert scenario.robot.parameters["robot.base_radius"] == 0.2


def test_a_named_robot_brings_its_drives_and_single_keys_override() -> None:
    text = template() + '\n[robot]\nname = "rl5-1450-6kg"\nplatform_mass_kg = 3.0\n'
    scenario = parse_scenario(text.replace('gains = "tuned"', 'gains = "tuned"\ntorque_max_Nm = 9.0'), PATH)
    assert scenario.robot.parameters["robot.upper_arm_length"] == 0.42
    assert scenario.robot.parameters["robot.platform_mass"] == 3.0
    assert scenario.plant["drive.gear_ratio"] == 55.0
    assert scenario.plant["drive.torque_max"] == 9.0
    assert scenario.limits.joint_torque == pytest.approx((9.0 * 0.95 * 55.0,) * 3)
    assert scenario.robot.parameters["robot.drive_inertia"] == pytest.approx(55**2 * (2.07e-4 + 1.51e-4), rel=1e-3)


@pytest.mark.parametrize("path", sorted(ROBOTS.glob("*.toml")), ids=lambda path: path.stem)
def test_a_named_robot_is_complete_and_says_where_each_value_is_from(path: Path) -> None:
    values = [line for line in path.read_text(encoding="utf-8").splitlines() if " = " in line.split("#")[0]]
    for line in values:
        assert len(line.partition("#")[2]) > 5, line
    given = {line.partition(" = ")[0] for line in values}
    assert given >= set(RobotSection.model_fields) - {"name"}


def test_every_drive_and_trip_key_is_a_parameter_of_the_plant() -> None:
    table = variable_table("plant")
    drive = {name: 1.0 for name in DriveSection.model_fields if name not in ("gains", "encoder_counts")}
    trip = dict.fromkeys(TripSection.model_fields, 2.0)
    text = template().replace('gains = "tuned"', 'gains = "factory"\nencoder_counts = 4096\n' + lines(drive))
    scenario = parse_scenario(text + "\n[trip]\n" + lines(trip), PATH)
    given = [name for name in scenario.plant if name not in table.gains["factory"]]
    assert len(scenario.plant) == len(drive) + 1 + len(trip)
    assert given
    for name in scenario.plant:
        assert table[name].causality == "parameter"


def lines(values: dict[str, float]) -> str:
    return "\n".join(f"{key} = {value}" for key, value in values.items())


def test_faults_become_plant_inputs_in_order_of_time() -> None:
    text = (
        template()
        + """
[[fault]]
time_ms = 150.0
encoder_offset_deg = 90.0
tcp_force_N = [1.0, 2.0, 3.0]

[[fault]]
time_ms = 20
axis = 2
torque_gain = 0.5
encoder_stuck = true

[[fault]]
time_ms = 160.0
payload_mass_kg = 0.25
servo_on = false
"""
    )
    faults = parse_scenario(text, PATH).faults
    assert [fault.time for fault in faults] == [0.02, 0.15, 0.16]
    assert faults[0].inputs == {"motor[2].torque_gain": 0.5, "encoder[2].stuck": 1.0}
    offsets = {f"encoder[{i}].offset": math.pi / 2 for i in (1, 2, 3)}
    assert faults[1].inputs == offsets | {"tcp.force.x": 1.0, "tcp.force.y": 2.0, "tcp.force.z": 3.0}
    assert faults[2].inputs == {"payload.mass": 0.25, "servo_on": 0.0}


def test_unequal_sides() -> None:
    text = changed("lift_mm = 50.0 ", "lift_pick_mm = 50.0\nlift_place_mm = 40.0 ")
    text = text.replace("corner_deviation_mm = 6.0 ", "corner_deviation_mm = [6.0, 4.0] ")
    task = parse_scenario(text, PATH).task
    assert task.lift == (0.05, 0.04)
    assert task.corner_deviation == (0.006, 0.004)
    assert task.reversed().lift == (0.04, 0.05)
    assert task.reversed().pick == task.place


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("pick_mm", "pick_m", "unknown key task.pick_m: did you mean pick_mm?"),
        ("lift_mm", "lift_m", "unknown key task.lift_m: did you mean lift_mm?"),
        ("[payload]", "[paylod]", "unknown key paylod: did you mean payload?"),
        ("corner_deviation_mm = 6.0 ", "", "key task.corner_deviation_mm is missing"),
        (
            "corner_deviation_mm = 6.0 ",
            "corner_deviation_mm = nan ",
            "task.corner_deviation_mm is nan: input should be a finite number",
        ),
        (
            "corner_deviation_mm = 6.0 ",
            "corner_deviation_mm = -6.0 ",
            "task.corner_deviation_mm is -6.0: input should be greater than 0",
        ),
        ("corner_deviation_mm = 6.0 ", "corner_deviation_mm = 0 ", "deviation_mm is 0: input should be greater than 0\n"),
        ("deviation_mm = 6.0 ", "deviation_mm = [6.0, -1.0] ", "deviation_mm.1 is -1.0: input should be greater than 0\n"),
        ("deviation_mm = 6.0 ", "deviation_mm = [6.0] ", "deviation_mm is [6.0]: more values are needed\n"),
        ("deviation_mm = 6.0 ", "deviation_mm = [1, 2, 3] ", "deviation_mm is [1, 2, 3]: at most 2 values are needed\n"),
        ("[-152.5, 0.0, -800.0]", "5.0", "task.pick_mm is 5.0: an array is needed\n"),
        ("schema = 1", "schema = 1\nrobot = 5.0", "robot is 5.0: a table is needed\n"),
        ("[run]", "[sequence]\nparts = [5.0]\n[run]", "part 1 of the sequence: it is 5.0: a table is needed"),
        ("{ max = 0.1 }", "{ max = 0.1, tolerance = 1.0 }", "tracking_error_tcp_mm: tolerance goes with equals"),
        ("{ max = 0.1 }", "{ min = 0.2, max = 0.1 }", "tracking_error_tcp_mm: nothing is at least 0.2 and at most 0.1"),
        ("lift_mm = 50.0 ", 'lift_mm = "50" ', "task.lift_mm is '50': input should be a valid number"),
        ("lift_mm = 50.0 ", "lift_pick_mm = 50.0 ", "task: give either lift_mm or both lift_pick_mm and lift_place_mm"),
        ("[-152.5, 0.0, -800.0]", "[-152.5, 0.0]", "task.pick_mm is [-152.5, 0.0]: more values are needed"),
        ('name = "paper"', 'name = "papper"', "law.name: 'papper' is not one of paper, comparison, paper_limited, time_optimal"),
        ('gains = "tuned"', 'gains = "hot"', "drive.gains: 'hot' is not one of tuned, factory"),
        (
            "communication_step_ms = 1.0",
            "communication_step_ms = 1.5",
            "communication_step_ms is 1.5, which is not a whole multiple of 1 ms",
        ),
        ('cell = "cell1"', 'cell = "a/b"', "run.cell is 'a/b'"),
        ("{ max = 0.1 }", "{ maximum = 0.1 }", "unknown key expect.tracking_error_tcp_mm.maximum: did you mean max?"),
        ("{ max = 0.1 }", "{ }", "give either equals, with a tolerance, or min or max"),
        ("schema = 1", "schema = 2", "schema is 2"),
        ("[task]", "[task", "not TOML"),
        ("[payload]", '[robot]\nname = "rl6"\n[payload]', "robot.name: 'rl6' is not one of default, rl5-1450-6kg"),
        (
            "[payload]",
            "[[fault]]\ntime_ms = 1.0\ntorque_gian = 0.0\n[payload]",
            "fault 1: unknown key torque_gian: did you mean torque_gain?",
        ),
        ("[payload]", "[[fault]]\ntime_ms = 1.0\n[payload]", "fault 1: give what happens, such as torque_gain = 0.0"),
        ("[payload]", "[[fault]]\ntime_ms = 1.0\naxis = 1\nbrake = true\n[payload]", "fault 1: axis goes with torque_gain"),
        (
            "[payload]",
            "[[fault]]\ntime_ms = 1.0\ntorque_gain = 1.5\n[payload]",
            "fault 1: torque_gain is 1.5: input should be less than",
        ),
        ("[expect]", '[expect]\ntrip = "crash"', "expect.trip: 'crash' is not one of none, position_deviation"),
        ("[payload]", "[robot]\nforearm_inertia_kg_m2 = 0.1\n[payload]", "robot.forearm_inertia_kg_m2 is 0.1: rods of 0.273 kg"),
        ("[payload]", "[robot]\njoint_position_max_deg = -50.0\n[payload]", "robot.joint_position_max_deg is -50"),
    ],
)
def test_wrong_files_are_refused_with_the_key_and_the_way_out(old: str, new: str, says: str) -> None:
    with pytest.raises(ScenarioError) as refusal:
        parse_scenario(changed(old, new), PATH)
    assert says in str(refusal.value) + "\n"
    assert str(refusal.value).startswith("test.toml: ")


SCHEMA = Draft202012Validator(ScenarioFile.model_json_schema())


@pytest.mark.parametrize("path", sorted((ROOT / "scenarios").glob("*.toml")), ids=lambda path: path.stem)
def test_the_json_schema_accepts_every_scenario(path: Path) -> None:
    SCHEMA.validate(tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("lift_mm", "lift_m"),
        ("pick_mm", "pik_mm"),
        ("corner_deviation_mm = 6.0 ", "corner_deviation_mm = [6.0] "),
        ("lift_mm = 50.0 ", "lift_pick_mm = 50.0 "),
        ("lift_mm = 50.0 ", "lift_mm = 50.0\nlift_pick_mm = 50.0 "),
        ("[run]", "[sequence]\nparts = [ { lift_mm = 1.0, lift_place_mm = 1.0 } ]\n[run]"),
        ('name = "paper"', 'name = "papper"'),
        ("{ max = 0.1 }", "{ }"),
        ("{ max = 0.1 }", "{ max = 0.1, equals = 0.1 }"),
        ("{ max = 0.1 }", "{ max = 0.1, tolerance = 0.1 }"),
    ],
)
def test_the_json_schema_refuses_what_the_product_refuses(old: str, new: str) -> None:
    with pytest.raises(ScenarioError):
        parse_scenario(changed(old, new), PATH)
    assert not SCHEMA.is_valid(tomllib.loads(changed(old, new)))


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="No such file"):
        load_scenario(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ScenarioError, match="not UTF-8"):
        load_scenario(tmp_path / "binary.toml")


def test_the_template_is_the_papers_case() -> None:
    assert template() == (ROOT / "scenarios" / "paper.toml").read_text(encoding="utf-8")


def test_a_feed_that_ends_in_a_standstill_is_refused_also_where_two_overrides_share_a_time() -> None:
    def feed(*overrides: float) -> str:
        return template() + "".join(f"\n[[feed]]\ntime_ms = 100.0\noverride = {override}\n" for override in overrides)

    with pytest.raises(ScenarioError, match=r"the last override is 0, too slow to arrive: end with at least 0\.01"):
        parse_scenario(feed(1.0, 0.0), PATH)
    assert [change.override for change in parse_scenario(feed(0.0, 1.0), PATH).feed] == [0.0, 1.0]


@pytest.mark.parametrize(
    "content", [template().encode(), template().replace("\n", "\r\n").encode("utf-8-sig")], ids=["unix", "windows"]
)
def test_hash_is_that_of_the_file_as_it_lies_there(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "scenario.toml").write_bytes(content)
    scenario = load_scenario(tmp_path / "scenario.toml")
    assert scenario.sha256 == hashlib.sha256(content).hexdigest()
    assert scenario.task == parse_scenario(template(), PATH).task
