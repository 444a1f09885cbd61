"""The first page of recordings of real runs, held against the facts of the runs."""

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import fmpy
import pytest

from deltaph.scenario import load_scenario
from deltaph.verdict import summary_markdown

SCENARIOS = Path(__file__).parents[2] / "scenarios"
DELTAPH = Path(sys.executable).with_name("deltaph")

Facts = dict[str, Any]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[str, Facts]]:
    """Runs a scenario, once: its first page and its facts."""
    folder = tmp_path_factory.mktemp("verdicts")
    done: dict[tuple[str, ...], tuple[str, Facts]] = {}

    def page(name: str, *options: str) -> tuple[str, Facts]:
        if (name, *options) not in done:
            path, report = SCENARIOS / f"{name}.toml", folder / f"{len(done)}.json"
            command = [str(DELTAPH), "run", str(path), "--json", str(report), "--listen", "tcp/127.0.0.1:0", *options]
            result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
            assert result.returncode == 0, result.stderr
            facts = json.loads(report.read_text())
            done[name, *options] = summary_markdown(load_scenario(path), facts), facts
        return done[name, *options]

    return page


def millimetres(corner: Facts, name: str) -> str:
    return f"{1e3 * corner[name]:.3f}"


def test_an_excursion_to_the_outside_is_said_beside_a_deviation_that_was_kept(run: Callable[..., Any]) -> None:
    page, facts = run("torque_limit")
    assert page.startswith("# Deviation kept, by")
    assert f"**Outside the right angles by up to {1e3 * facts['executed']['overshoot_m']:.2f} mm**" in page
    assert "Outside the right angles" not in run("paper")[0]


def test_what_was_kept_before_a_corner_was_missed_is_no_verdict_on_the_whole(run: Callable[..., Any]) -> None:
    page, _ = run("fault_servo_off")
    assert "# Not reached: the place corner" in page
    assert "# Deviation kept at what was reached, by 1.19 mm" in page


@pytest.mark.parametrize(
    ("name", "headline", "word"),
    [
        ("oblique", "# Deviation kept, by 0.0", "| kept |"),
        ("paper", "# Deviation kept within the tolerance of 0.05 mm, by 0.03", "| within tolerance |"),
        ("factory_gains", "# Deviation NOT kept: 5.76 mm too far at the place corner", "| **NOT kept** |"),
    ],
)
def test_headline_and_table_say_whether_and_by_which_margin(run: Callable[..., Any], name: str, headline: str, word: str) -> None:
    page, facts = run(name)
    assert page.startswith(headline)
    for corner, side in zip(facts["executed"]["corners"], ("pick", "place"), strict=True):
        margin = 1e3 * (corner["prescribed_m"] - corner["executed_m"])
        figures = " | ".join(millimetres(corner, key) for key in ("prescribed_m", "planned_m", "executed_m"))
        assert f"| {side} | {figures} | {margin:+.3f} {word}" in page


def test_where_it_was_lost_and_why(run: Callable[..., Any]) -> None:
    page, facts = run("factory_gains")
    corner = facts["executed"]["corners"][1]
    assert "2 of 2 corners exceed what is prescribed. The scenario allows no tolerance." in page
    assert f"the tool is {1e3 * corner['tracking_error_m']:.2f} mm from its setpoint" in page
    assert f"{1e3 * corner['lag_m']:.2f} mm of path behind" in page
    assert "joints 2 and 3 are off most" in page  # they move alike
    assert "(factory drive gains)" in page


def test_trips_faults_and_corners_that_were_not_reached_come_first(run: Callable[..., Any]) -> None:
    page, _ = run("overload")
    assert page.startswith("# TRIPPED at 249.25 ms: overload of axis 1")
    page, _ = run("emergency_stop")
    assert page.startswith("# Not reached: the place corner")
    assert "The scenario sets, from 150 ms on: servo_on false, brake true." in page
    assert "| place | | | not reached | | |" in page


def test_worst_of_many_passes(run: Callable[..., Any]) -> None:
    page, facts = run("paper", "--cycles", "3")
    corners = facts["executed"]["corners"]
    worst = max(corners, key=lambda corner: corner["executed_m"])
    side = ("pick", "place")[worst["side"]]
    assert f"At the {side} corner of operation {worst['operation'] + 1} the machine is" in page
    assert f"| {side}, worst of 6 | 6.000 | 6.000 | {millimetres(worst, 'executed_m')} |" in page
    assert "6 operations of 303 ms (302.697 ms before alignment)" in page


def test_expectations_and_peaks(run: Callable[..., Any]) -> None:
    page, facts = run("time_optimal")
    assert "| expectations: met | found | expected | |" in page
    for check in facts["expect"]:
        assert f"| {check['name']} | {check['value']:.5g} | {check['limit']} | met |" in page
    assert "| planned joint velocity, rad/s | 4.4" in page
    peaks, torque = facts["plan"]["joint_velocity_max_rad_s"], facts["executed"]["motor_torque_max_Nm"]
    assert f" | 4.423 | {100.0 * max(peaks) / 4.4227:.3g} % |" in page
    assert f" | 7.1 | {100.0 * max(torque) / 7.1:.3g} % |" in page  # the motor's momentary peak
    missed = json.loads(json.dumps(facts))
    missed["expect"][0]["ok"] = False
    assert f"| expectations: 1 of {len(facts['expect'])} missed |" in summary_markdown(
        load_scenario(SCENARIOS / "time_optimal.toml"), missed
    )


def test_timing_says_how_time_was_kept(run: Callable[..., Any]) -> None:
    page, facts = run("paper")
    assert f"As fast as possible: {facts['timing']['real_time_factor']:.1f} times real time." in page
    assert "354 frames published, 0 dropped." in page
    assert "deadlines" not in page
    page, facts = run("paper", "--realtime")
    timing = facts["timing"]
    assert f"{timing['missed_deadlines']} of 353 deadlines missed" in page
    assert f"{timing['slipped_steps']} steps slipped" in page
    assert f"In real time, factor {timing['real_time_factor']:.3f}" in page


def test_provenance_is_that_of_the_installed_packages_and_the_built_fmus(run: Callable[..., Any], dist: Path) -> None:
    page, _ = run("paper")
    names = {"deltaph": "deltaph", "fmpy": "fmpy", "zenoh": "eclipse-zenoh", "rerun": "rerun-sdk"}
    assert ", ".join(f"{name} {version(package)}" for name, package in names.items()) in page
    for model, name in (("planner", "DeltaPlanner"), ("plant", "DeltaPlant")):
        assert f"- {model} FMU `{fmpy.read_model_description(dist / f'{name}.fmu').instantiationToken}`" in page
    digest = hashlib.sha256((SCENARIOS / "paper.toml").read_bytes()).hexdigest()
    assert f"- `paper.toml`, SHA-256 `{digest}`" in page


def test_a_run_that_ends_before_the_arrival_says_so(run: Callable[..., Any]) -> None:
    page, facts = run("feed_override")
    assert "; arrived at 797 ms." in page
    executed = facts["executed"] | {"arrival_s": None}
    assert "; not arrived." in summary_markdown(load_scenario(SCENARIOS / "feed_override.toml"), facts | {"executed": executed})
