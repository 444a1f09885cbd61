"""Scenario files: units removed once, everything wrong said in one line that names the key and the way out."""

import math
from pathlib import Path

import pytest

from deltaph.errors import ScenarioError
from deltaph.scenario import load_scenario, parse_scenario, template

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
        ("lift_mm = 50.0 ", 'lift_mm = "50" ', "task.lift_mm is '50': input should be a valid number"),
        ("lift_mm = 50.0 ", "lift_pick_mm = 50.0 ", "task: give either lift_mm or both lift_pick_mm and lift_place_mm"),
        ("[-152.5, 0.0, -800.0]", "[-152.5, 0.0]", "task.pick_mm.2 is missing"),
        ('name = "paper"', 'name = "papper"', "law: 'papper' is not one of paper, comparison, paper_limited, time_optimal"),
        ('gains = "tuned"', 'gains = "hot"', "drive: 'hot' is not one of tuned, factory"),
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
    ],
)
def test_wrong_files_are_refused_with_the_key_and_the_way_out(old: str, new: str, says: str) -> None:
    with pytest.raises(ScenarioError) as refusal:
        parse_scenario(changed(old, new), PATH)
    assert says in str(refusal.value)
    assert str(refusal.value).startswith("test.toml: ")


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="No such file"):
        load_scenario(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ScenarioError, match="not UTF-8"):
        load_scenario(tmp_path / "binary.toml")


def test_the_template_is_the_papers_case() -> None:
    assert template() == (ROOT / "scenarios" / "paper.toml").read_text(encoding="utf-8")
