"""The main job without telemetry: every scenario meets its own expectations; cycles, steps and frames are what they should be."""

import gc
import itertools
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from integration.sinks import ListSink
from rich.console import Console

from deltaph.checks import evaluate_expectations, executed_values, planned_values
from deltaph.errors import InfeasibleError
from deltaph.execution import Trace, evaluate, nearest_point, overshoot
from deltaph.fmu import cached_fmus
from deltaph.frame import Frame
from deltaph.importer import cosimulate
from deltaph.outputs import planner_columns
from deltaph.pacing import Pacer, Undisturbed
from deltaph.plan import Plan
from deltaph.report import timing_facts
from deltaph.run import Options, run_scenario
from deltaph.scenario import Scenario, load_scenario, parse_scenario, template
from deltaph.schedule import Schedule, schedule
from deltaph.sinks import Sinks
from deltaph.telemetry import SinkProcess

SCENARIOS = sorted((Path(__file__).parents[2] / "scenarios").glob("*.toml"))


def frames_of(scenario: Scenario, run: Schedule) -> list[Frame]:
    return list(cosimulate(scenario, run, cached_fmus()))


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_scenario_meets_its_expectations(path: Path) -> None:
    scenario = load_scenario(path)
    if scenario.expect.refused is not None:
        with pytest.raises(InfeasibleError) as refusal:
            Plan.of(scenario)
        assert refusal.value.status == scenario.expect.refused
        return
    run = schedule(scenario)
    execution = evaluate(Trace(frames_of(scenario, run)), run)
    values = planned_values(run) | executed_values(execution)
    checks = evaluate_expectations(scenario.expect, values, execution.trip)
    assert checks
    assert [check for check in checks if not check.ok] == []


def test_the_importer_shows_the_plan_bit_for_bit() -> None:
    scenario = load_scenario(SCENARIOS[0].with_name("paper.toml"))
    run = schedule(scenario)
    trace = Trace(frames_of(scenario, run))
    assert len(trace.time) == run.steps + 1
    assert (trace.time == np.arange(run.steps + 1) * 1e-3).all()
    columns = planner_columns(run.operations[0].plan, np.arange(run.steps + 1) / 1000.0)
    for i, axis in enumerate("xyz"):
        assert (trace["planner", "tcp_position"][:, i] == columns[f"tcp.position.{axis}"]).all()
    assert (trace["planner", "path_phase"] == columns["path.phase"]).all()


def test_frames_are_immutable_and_distinct() -> None:
    scenario = load_scenario(SCENARIOS[0].with_name("paper.toml"))
    frames = frames_of(scenario, schedule(scenario))
    with pytest.raises(ValueError, match="read-only"):
        frames[0].plant_floats[0] = 1.0
    assert not np.array_equal(frames[100].plant_floats, frames[101].plant_floats)


def test_there_and_back_twice_without_losing_a_step() -> None:
    scenario = load_scenario(SCENARIOS[0].with_name("paper.toml"))
    run = schedule(scenario, cycles=2)
    assert run.steps == 4 * 303 + 50
    trace = Trace(frames_of(scenario, run))
    count = trace["planner", "plan_count"]
    assert count[-1] == 4
    assert trace["planner", "plan_refused"][-1] == 0
    position = trace["planner", "tcp_position"]
    for k, point in enumerate([scenario.task.pick, scenario.task.place] * 2 + [scenario.task.pick]):
        assert position[303 * k].tolist() == list(point)
    execution = evaluate(trace, run)
    assert len(execution.corner_deviation) == 8
    assert execution.corner_deviation == pytest.approx([0.006] * 8, abs=5e-5)


def test_longer_communication_steps() -> None:
    text = template().replace("communication_step_ms = 1.0", "communication_step_ms = 2.0")
    scenario = parse_scenario(text, Path("two.toml"))
    run = schedule(scenario)
    assert run.steps == 177
    execution = evaluate(Trace(frames_of(scenario, run)), run)
    assert execution.trip == "none"
    assert execution.corner_deviation == pytest.approx([0.006] * 2, abs=2e-4)


def test_a_run_of_one_communication_step_has_a_report() -> None:
    text = template().replace("communication_step_ms = 1.0", "communication_step_ms = 1000.0")
    scenario = parse_scenario(text.replace("settle_ms = 50.0", "settle_ms = 0.0"), Path("one.toml"))
    run = schedule(scenario)
    assert run.steps == 1
    trace = Trace(frames_of(scenario, run))
    for name in ("step_us", "publish_us", "lateness_us"):
        assert timing_facts(trace, None)[name]["max"] >= 0.0
    assert executed_values(evaluate(trace, run))["arrival_ms"] == [1000.0]


def test_warming_up_does_not_take_longer_where_steps_are_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    text = template().replace("communication_step_ms = 1.0", "communication_step_ms = 1000.0")
    scenario = parse_scenario(text, Path("one.toml"))
    steps: list[int] = []

    def pacer(step_ns: int) -> Pacer:
        steps.append(step_ns)
        return Pacer(step_ns, sleep_until=lambda _: None, clock=itertools.count(0, step_ns).__next__)

    monkeypatch.setattr("deltaph.importer.Pacer", pacer)
    frames = list(cosimulate(scenario, schedule(scenario), cached_fmus(), realtime=Undisturbed()))
    assert len(frames) == 2
    assert steps == [1_000_000, 1_000_000_000]


def test_an_interrupted_loop_gives_back_what_it_has_of_the_system_before_its_sinks_are_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    collected: list[bool] = []

    class Interrupted(ListSink):
        dropped = 0

        def await_open(self) -> None:
            pass

        def take(self, frame: Frame) -> None:
            if frame.step == 5:
                raise KeyboardInterrupt

        def death(self) -> None:
            pass

        def close(self) -> None:
            collected.append(gc.isenabled())

    def recording(_path: Path, _scenario: Scenario, _log: Console, sinks: Sinks, **_: bool) -> SinkProcess[Any]:
        return sinks.add(cast(SinkProcess[Any], Interrupted()))

    monkeypatch.setattr("deltaph.run.recording", recording)
    options = Options(record=tmp_path / "paper.rrd", realtime=Undisturbed(), telemetry=False)
    with pytest.raises(KeyboardInterrupt):
        run_scenario(SCENARIOS[0].with_name("paper.toml"), options, Console(), Console(stderr=True, force_terminal=True))
    assert collected == [True]


def test_payload_reaches_both_fmus() -> None:
    light = parse_scenario(template(), Path("light.toml"))
    heavy = parse_scenario(template().replace("mass_kg = 0.0", "mass_kg = 1.0"), Path("heavy.toml"))
    torque, deviation = {}, {}
    for name, scenario in (("light", light), ("heavy", heavy)):
        run = schedule(scenario)
        execution = evaluate(Trace(frames_of(scenario, run)), run)
        torque[name], deviation[name] = max(execution.motor_torque_max), execution.tracking_error_tcp_max
    assert torque["heavy"] > 1.2 * torque["light"]
    assert deviation["heavy"] < 1.5 * deviation["light"]  # known to the planner: fed forward


def test_executed_deviation_is_interpolated_not_sampled() -> None:
    plan = Plan.of(load_scenario(SCENARIOS[0].with_name("paper.toml")))
    time = np.arange(0.0, 0.3, 0.004)  # a coarse grid that misses the closest point
    s = plan.sample(time)
    sampled = np.linalg.norm(s["tcp_position"] - plan.vertices[0], axis=1).min()
    found = nearest_point(time, s["tcp_position"], s["tcp_velocity"], plan.vertices[0])[0]
    assert sampled - 0.006 > 2e-5
    assert found == pytest.approx(0.006, abs=1e-6)


def test_overshoot_is_the_distance_outside_the_right_angles() -> None:
    plan = Plan.of(load_scenario(SCENARIOS[0].with_name("paper.toml")))
    inside = plan.sample(plan.grid())["tcp_position"]
    assert overshoot(inside, plan) == pytest.approx(0.0, abs=1e-12)
    for shift in ((0.0, 0.002, 0.0), (0.0, 0.0, 0.002), (0.002, 0.0, 0.0)):
        assert overshoot(inside + np.array(shift), plan) == pytest.approx(0.002, abs=1e-9)
