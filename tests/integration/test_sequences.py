"""Sequences of parts in the co-simulation, on the command line, in the recording and in the verdict."""

import json
import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from integration.read_back import Recording, last_blueprint
from integration.test_cli import DELTAPH, assert_refused, deltaph, table
from integration.test_following import process, rerun_binary

from deltaph.errors import DeltaphError
from deltaph.execution import Trace, evaluate
from deltaph.export import export
from deltaph.fmu import cached_fmus
from deltaph.importer import cosimulate
from deltaph.outputs import pass_columns
from deltaph.plan import Plan
from deltaph.scenario import Scenario, load_scenario, parse_scenario
from deltaph.schedule import Schedule, schedule
from deltaph.telemetry.session import free_endpoint
from deltaph.variables import variable_table
from deltaph.verdict import summary_markdown

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STACK = SCENARIOS / "stack.toml"

Recorded = tuple[Path, Path, dict[str, Any]]
"""A run, recorded by itself and over Zenoh, and its facts."""

PAIR = """
schema = 1
title = "two parts"

[task]
place_mm = [150.0, 0.0, -800.0]
lift_mm = 50.0
corner_deviation_mm = 6.0

[sequence]
grip_ms = 25.0
release_ms = 10.0
parts = [
    { pick_mm = [-150.0, -40.0, -800.0] },
    { pick_mm = [-150.0, 40.0, -800.0], payload_mass_kg = 0.4 },
]
"""


def trace_of(scenario: Scenario, run: Schedule) -> Trace:
    return Trace(list(cosimulate(scenario, run, cached_fmus())))


def test_the_planner_fmu_does_what_is_planned_bit_for_bit() -> None:
    scenario = load_scenario(STACK)
    run = schedule(scenario)
    trace = trace_of(scenario, run)
    end = run.pass_ms + 1
    columns = pass_columns(run, run.grid())
    assert len(columns["path.phase"]) == end
    for quantity in ("position", "velocity", "acceleration"):
        for i, axis in enumerate("xyz"):
            assert (trace["planner", f"tcp_{quantity}"][:end, i] == columns[f"tcp.{quantity}.{axis}"]).all(), quantity
    for quantity in ("position", "velocity", "acceleration", "torque"):
        for i in (1, 2, 3):
            assert (trace["planner", f"joint_{quantity}"][:end, i - 1] == columns[f"joint[{i}].{quantity}"]).all(), quantity
    assert (trace["planner", "path_phase"][:end] == columns["path.phase"]).all()
    assert (trace["planner", "plan_busy"][:end] == columns["plan.busy"]).all()
    assert trace["planner", "plan_refused"][-1] == 0


def test_the_gripper_rests_as_long_as_it_is_asked_to() -> None:
    scenario = load_scenario(STACK)
    run = schedule(scenario)
    trace = trace_of(scenario, run)
    dwell = variable_table("planner").items("Phase").index("dwell")
    rests = trace["planner", "path_phase"] == dwell
    begins = np.flatnonzero(np.diff(rests.astype(int), prepend=0) == 1).tolist()
    ends = np.flatnonzero(np.diff(rests.astype(int)) == -1) + 1
    assert begins == [operation.begin_ms for operation in run.operations]
    assert (ends - begins).tolist() == [25, 15, 25, 15, 25, 15, 25, 40]
    assert np.linalg.norm(trace["planner", "tcp_velocity"][rests], axis=1).max() == 0.0


def test_cycles_of_a_sequence_lose_no_step() -> None:
    scenario = parse_scenario(PAIR, Path("pair.toml"))
    run = schedule(scenario, cycles=3)
    trace = trace_of(scenario, run)
    assert trace["planner", "plan_count"][-1] == 12
    for operation in run.operations:
        assert trace["planner", "tcp_position"][int(operation.begin_ms)].tolist() == list(operation.plan.task.pick)
    execution = evaluate(trace, run)
    assert execution.arrival == 3 * run.cycle_time
    assert [corner.move for corner in execution.corners[::2]] == ["part 1", "return 1", "part 2", "return 2"] * 3
    sides = [corner.side for corner in execution.corners]
    assert sides == [0, 1, 1, 0] * 6
    for number, corner in enumerate(execution.corners):
        vertex = run.operations[corner.operation].plan.vertices[number % 2]
        assert np.linalg.norm(np.array(corner.nearest) - vertex) == pytest.approx(corner.executed)
        assert corner.executed == pytest.approx(0.006, abs=1e-4)
        assert corner.reached


def test_the_part_is_in_the_gripper_from_half_way_through_the_rest_on() -> None:
    """At rest the motors hold what is there: before, the empty platform, afterwards the part, and so on the other side."""
    text = PAIR.replace("grip_ms = 25.0", "grip_ms = 1600.0").replace("release_ms = 10.0", "release_ms = 1600.0")
    scenario = parse_scenario(text, Path("slow.toml"))
    heavy = replace(scenario, moves=tuple(replace(move, payload=2.0 * (not move.is_return)) for move in scenario.moves))
    run = schedule(heavy)
    torque = trace_of(heavy, run)["plant", "joint_torque"]

    def held(mass: float, move: int) -> float:
        plan = run.operations[move].plan
        return float(Plan(heavy.robot, plan.task, heavy.law, mass).sample(np.array([0.0]))["joint_torque"].sum())

    for number, (before, after) in enumerate([(0.0, 2.0), (2.0, 0.0)]):
        begin = int(run.operations[number].begin_ms)
        for step, mass in ((begin + 790, before), (begin + 1590, after)):
            friction = 0.2 * abs(held(2.0, number) - held(0.0, number))  # what it may hold of the difference, at rest
            assert torque[step].sum() == pytest.approx(held(mass, number), abs=friction), (number, mass)


FEED = """
[[feed]]
time_ms = 200.0
override = 0.4

[[feed]]
time_ms = 900.0
override = 0.0

[[feed]]
time_ms = 1300.0
override = 0.85
"""


@pytest.mark.parametrize("step_ms", [1, 2, 5])
def test_feed_slows_a_sequence_and_the_schedule_knows(step_ms: int) -> None:
    scenario = parse_scenario(PAIR + FEED + f"[run]\ncommunication_step_ms = {step_ms}.0\n", Path("slow.toml"))
    run = schedule(scenario)
    trace = trace_of(scenario, run)
    execution = evaluate(trace, run)
    assert execution.arrival == pytest.approx(run.operations[-1].end_ms / 1000.0, abs=step_ms / 1000.0)
    assert execution.arrival is not None
    assert execution.arrival > run.cycle_time + 0.6
    clock = run.clock.at(trace.time)
    begins = np.array([operation.begin_ms for operation in run.operations])
    running = np.searchsorted(begins, 1000.0 * trace.time + 1e-6, side="right") - 1
    for number, operation in enumerate(run.operations):
        here = running == number
        planned = operation.plan.sample(clock[here] - operation.clock_ms / 1000.0)
        np.testing.assert_allclose(trace["planner", "tcp_position"][here], planned["tcp_position"], atol=1e-9)
    assert max(corner.executed - corner.prescribed for corner in execution.corners) < 1e-4
    assert max(corner.tracking_error for corner in execution.corners) < 2e-4


def short_text(law: str, step_ms: int) -> str:
    """Ways so short that planning takes longer than moving, where it takes more than one slice, and a long one."""
    return f"""
schema = 1
title = "short ways"

[task]
lift_mm = 0.5
corner_deviation_mm = 0.06

[law]
name = "{law}"

[sequence]
grip_ms = 3.0
release_ms = 0.0
parts = [
    {{ pick_mm = [0.0, 0.0, -800.0], place_mm = [1.0, 0.0, -800.0] }},
    {{ pick_mm = [0.0, 1.0, -800.0], place_mm = [1.0, 1.0, -800.0] }},
    {{ pick_mm = [0.0, 0.0, -800.0], place_mm = [60.0, 60.0, -800.0] }},
]

[run]
communication_step_ms = {step_ms}.0
"""


def short(law: str, step_ms: int, feed: str = "") -> Scenario:
    return parse_scenario(short_text(law, step_ms) + feed, Path("short.toml"))


@pytest.mark.parametrize("step_ms", [1, 2, 5])
@pytest.mark.parametrize("law", ["paper_limited", "time_optimal", "paper"])
def test_a_plan_that_takes_longer_than_the_way_before_is_waited_for(law: str, step_ms: int) -> None:
    scenario = short(law, step_ms)
    run = schedule(scenario, cycles=2)
    operations = run.operations
    # a plan of one slice may be too late only because it cannot be asked for within a step
    assert any(o.waited_ms > 0.0 for o in operations) == (law != "paper" or step_ms == 5)
    assert not all(o.waited_ms > 0.0 for o in operations[1:])  # the long way is time enough
    for before, after in pairwise(operations):
        assert after.begin_ms == before.end_ms + after.waited_ms
        assert after.waited_ms == 0.0 or after.ready_ms == after.begin_ms
    trace = trace_of(scenario, run)
    ms = np.rint(1000.0 * trace.time).astype(int)
    # what is ready only in the millisecond in which it begins shows in the next one
    shown = [sum(o.begin_ms <= t and o.ready_ms < t for o in operations) - 1 for t in ms]
    for number, operation in enumerate(operations):
        here = np.array(shown) == number
        planned = operation.plan.sample((ms[here] - operation.start_ms) / 1000.0)
        for output in ("joint_position", "joint_velocity", "joint_acceleration", "joint_torque", "tcp_position"):
            assert (trace["planner", output][here] == planned[output]).all(), (operation, output)
        assert (trace["planner", "path_phase"][here] == planned["phase"]).all()
        moving = (ms > operation.start_ms) & (ms < operation.end_ms)
        clock = 1000.0 * run.clock.at(trace.time[moving]) - operation.clock_ms
        np.testing.assert_allclose(clock, ms[moving] - operation.start_ms, atol=1e-9)
    assert trace["planner", "plan_count"].tolist() == [sum(o.ready_ms < t for o in operations) for t in ms]
    asked = [-1, *(o.request_step * step_ms for o in operations[1:])]
    busy = [any(at < t < o.end_ms for at, o in zip(asked, operations, strict=True)) for t in ms]
    assert trace["planner", "plan_busy"].tolist() == busy
    assert evaluate(trace, run).arrival == pytest.approx(run.arrival_step * step_ms / 1000.0)

    first = ms < run.pass_ms
    columns = pass_columns(run, trace.time[first])
    for name in ("joint[2].position", "tcp.velocity.x", "path.phase", "plan.busy"):
        variable = variable_table("planner")[name]
        found = trace["planner", variable.group][first]
        assert (columns[name] == (found if variable.index is None else found[:, variable.index])).all(), name


@pytest.mark.parametrize("step_ms", [1, 5])
def test_a_feed_override_and_a_wait_for_a_plan_know_of_each_other(step_ms: int) -> None:
    """The faster the robot is, the longer it waits; its clock stands meanwhile, and the filter of the feed goes on."""
    changes = [(0, 0.9), (20, 0.3), (260, 1.0), (500, 0.0), (700, 0.8)]
    feed = "".join(f"\n[[feed]]\ntime_ms = {at}.0\noverride = {value}\n" for at, value in changes)
    scenario, nominal = short("paper_limited", step_ms, feed), schedule(short("paper_limited", step_ms))
    run = schedule(scenario, cycles=2)
    assert run.pass_ms == nominal.pass_ms
    assert run.period == nominal.period == (nominal.pass_ms / 1000.0 - nominal.waited)
    assert 0.0 < sum(o.waited_ms for o in run.one_pass) < sum(o.waited_ms for o in nominal.one_pass)
    trace = trace_of(scenario, run)
    clock = run.clock.at(trace.time)
    shown = np.searchsorted([o.begin_ms for o in run.operations], 1000.0 * trace.time - 1e-6, side="right") - 1
    for number, operation in enumerate(run.operations):
        here = shown == number
        planned = operation.plan.sample(clock[here] - operation.clock_ms / 1000.0)
        np.testing.assert_allclose(trace["planner", "tcp_position"][here], planned["tcp_position"], atol=1e-9)
    assert evaluate(trace, run).arrival == pytest.approx(run.operations[-1].end_ms / 1000.0, abs=step_ms / 1000.0)


def test_reports_say_how_long_the_robot_waits_for_plans(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_text("paper_limited", 1), encoding="utf-8")
    run = schedule(short("paper_limited", 1))
    waited = [operation.waited_ms for operation in run.operations]
    planned = deltaph("plan", "short.toml", "--json", "plan.json", cwd=tmp_path)
    done = deltaph("run", "short.toml", "--no-telemetry", "--json", "run.json", cwd=tmp_path)
    assert (planned.returncode, done.returncode) == (0, 0), done.stderr
    for operation, ms in zip(run.operations, waited, strict=True):
        said = f"{operation.move.name}: the robot waits {ms:g} ms for the plan"
        assert (said in planned.stdout) == (ms > 0.0)
    count = sum(ms > 0.0 for ms in waited)
    assert f"{sum(waited):g} ms, before {count} of {len(waited)} operations" in " ".join(done.stdout.split())
    for name in ("plan.json", "run.json"):
        operations = json.loads((tmp_path / name).read_text())["operations"]
        assert [operation["waited_for_plan_s"] for operation in operations] == [ms / 1000.0 for ms in waited]


def test_a_plan_that_is_not_ready_in_time_ends_the_run() -> None:
    scenario = parse_scenario(PAIR, Path("pair.toml"))
    run = schedule(scenario)
    late = replace(run.operations[2], request_step=int(run.operations[2].begin_ms) + 5)
    with pytest.raises(DeltaphError, match=r"operation 3 \(part 2\) should begin at step \d+, but .* has not planned it in time"):
        trace_of(scenario, replace(run, operations=(*run.operations[:2], late, *run.operations[3:])))


def test_a_request_that_the_planner_refuses_ends_the_run() -> None:
    scenario = parse_scenario(PAIR, Path("pair.toml"))
    run = schedule(scenario)
    skipped = (run.operations[0], *run.operations[2:])
    elsewhere = replace(run.operations[2], request_step=run.operations[1].request_step, begin_ms=run.operations[1].begin_ms)
    with pytest.raises(DeltaphError, match=r"operation 2 \(part 2\) .* refused it: not_at_pick"):
        trace_of(scenario, replace(run, operations=(skipped[0], elsewhere, *skipped[2:])))


def test_plan_reports_every_operation(tmp_path: Path) -> None:
    result = deltaph("plan", STACK, "--json", "plan.json", "--csv", "plan.csv", "--plot", "plan.png", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    report = json.loads((tmp_path / "plan.json").read_text())
    operations = report["operations"]
    run = schedule(load_scenario(STACK))
    assert [operation["name"] for operation in operations] == [operation.move.name for operation in run.operations]
    assert operations[0].items() >= report["plan"].items()
    for operation, following in pairwise(operations):
        assert operation["end_s"] == following["begin_s"]
        assert following["start_s"] == pytest.approx(following["begin_s"] + following["dwell_s"])
        assert operation["place_m"] == following["pick_m"]
    cycle = operations[-1]["end_s"]
    assert report["sequence"] == {"parts": 4, "cycle_time_s": cycle, "parts_per_minute": 240.0 / cycle}
    assert f"4 parts in {run.cycle_time:.3f} s: {run.parts_per_minute:.1f} parts per minute" in result.stdout
    lines = result.stdout.splitlines()
    for operation in run.operations:
        (line,) = (line for line in lines if line.startswith(f"{operation.move.name} "))
        assert f" {operation.plan.dwell_ms} " in line
        assert f" {operation.plan.duration_ms} " in line
    rows = table(tmp_path / "plan.csv")
    assert len(rows) == run.pass_ms + 1
    assert float(rows[-1]["time"]) == run.cycle_time
    assert [float(rows[-1][f"tcp.position.{axis}"]) for axis in "xyz"] == list(run.operations[-1].plan.task.place)
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")


def test_run_reports_the_worst_corner_first(tmp_path: Path) -> None:
    result = deltaph("run", STACK, "--no-telemetry", "--cycles", 2, "--json", "run.json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    facts = json.loads((tmp_path / "run.json").read_text())
    corners = facts["executed"]["corners"]
    assert len(corners) == len(facts["executed"]["corner_deviation_m"]) == 2 * 2 * 8
    by_operation = [operation["executed_corner_deviation_m"] for operation in facts["operations"]]
    for k, deviations in enumerate(by_operation):
        passes = [c["executed_m"] for c in corners if c["operation"] % 8 == k]
        assert deviations == [max(passes[0::2]), max(passes[1::2])]
    worst = max(corners, key=lambda corner: corner["executed_m"] - corner["prescribed_m"])
    lines = result.stdout.splitlines()
    first = lines[next(k for k, line in enumerate(lines) if "kept in the machine" in line) + 1]
    assert first.startswith(f"{worst['move']}, {('pick', 'place')[worst['side']]} side")
    assert f"{1e3 * worst['executed_m']:.4f}" in first
    (excess,) = (check for check in facts["expect"] if check["name"] == "corner_excess_mm")
    assert excess["value"] == pytest.approx(1e3 * (worst["executed_m"] - worst["prescribed_m"]))

    page = summary_markdown(load_scenario(STACK), facts)
    where = f"{('pick', 'place')[worst['side']]} corner of {worst['move']} in cycle {worst['operation'] // 8 + 1}"
    assert f"At the {where} the machine" in page
    rows = [line for line in page.splitlines() if line.startswith(("| part ", "| return "))]
    assert len(rows) == 6
    assert "| and 10 more | | | | | all kept |" in page
    assert "**120.3 parts per minute**" in page


def test_the_summary_says_why_less_was_planned(tmp_path: Path) -> None:
    result = deltaph("run", SCENARIOS / "short_traverse.toml", "--no-telemetry", cwd=tmp_path)
    assert "pick side: planned 5.03 mm of 6 mm: lift height 50 mm, traverse 40 mm" in result.stdout
    text = STACK.read_text(encoding="utf-8").replace("lift_place_mm = 15.0", "lift_place_mm = 3.0").replace("-745.0", "-733.0")
    (tmp_path / "low.toml").write_text(text[: text.index("[expect]")])
    for command, name in ((("plan", "low.toml"), "part 4"), (("run", "low.toml", "--no-telemetry"), "part 4, place side")):
        result = deltaph(*command, cwd=tmp_path)
        (line,) = (line for line in result.stdout.splitlines() if line.startswith(f"{name}: planned"))
        assert "mm of 3.5 mm: lift height 3 mm" in line


@pytest.mark.parametrize(
    ("old", "new", "code", "words"),
    [
        (
            "lift_place_mm = 30.0",
            "lift_place_mm = 31.0",
            3,
            ["part 3: the traverse would not be level", "change a lift height by 1 mm"],
        ),
        (
            "place_mm = [140.0, -40.0, -775.0]",
            "place_mm = [940.0, -40.0, -775.0]",
            3,
            ["part 2: joint 2 would have to turn to"],
        ),
        ("release_ms = 40.0", "relase_ms = 40.0", 2, ["part 4 of the sequence: unknown key relase_ms: did you mean release_ms?"]),
        ("{ place_mm = [140.0, -40.0, -790.0] }", "{ }", 2, ["part 1 of the sequence has no place_mm"]),
        ("[law]", "[[feed]]\ntime_ms = 1.0\noverride = 0.0\n[law]", 2, ["the last override is 0"]),
        ("joint_torque_Nm = 100.0", "joint_torque_Nm = 1.0", 3, ["part 1: joint", "N m to hold still"]),
    ],
)
def test_what_is_wrong_with_a_part_is_said_by_its_number(tmp_path: Path, old: str, new: str, code: int, words: list[str]) -> None:
    text = STACK.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "bad.toml").write_text(text.replace(old, new))
    for command in ("plan", "run"):
        assert_refused(deltaph(command, "bad.toml", cwd=tmp_path), code, *words)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    folder = tmp_path_factory.mktemp("recorded")
    run, followed, report = folder / "run.rrd", folder / "followed.rrd", folder / "run.json"
    endpoint = free_endpoint()
    with process(DELTAPH, "record", "--connect", endpoint, "-o", followed) as recorder:
        options = ("--cycles", 2, "--realtime", "--listen", endpoint, "--wait-subscribers", 1, "--record", run, "--json", report)
        done = deltaph("run", STACK, *options, cwd=folder)
        assert done.returncode == 0, done.stderr
        _, said = recorder.communicate(timeout=60.0)
    assert "no messages lost" in said
    return run, followed, json.loads(report.read_text())


def test_recording_of_a_sequence_over_zenoh_equals_that_of_the_run(recorded: Recorded, tmp_path: Path) -> None:
    run, followed, _ = recorded
    compare = [str(rerun_binary()), "rrd", "compare", str(run), str(followed)]
    done = subprocess.run(compare, capture_output=True, text=True, timeout=60.0, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr[:2000]


def test_the_recording_shows_every_operation(recorded: Recorded) -> None:
    path, _, facts = recorded
    recording, run = Recording(path), schedule(load_scenario(STACK), cycles=2)
    lane = recording.rows["/operation"]
    assert [state for (state,) in lane["StateChange:state"]] == [*(operation.move.name for operation in run.operations), "none"]
    assert lane["step"].tolist() == [*(operation.begin_ms for operation in run.operations), run.operations[-1].end_ms]
    corners = facts["executed"]["corners"]
    for name in ("prescribed", "planned", "executed"):
        rows = recording.rows[f"/plot/corner/deviation/{name}"]
        assert rows["sim_time"].tolist() == [round(1e9 * corner["time_s"]) for corner in corners]
        np.testing.assert_allclose(rows["Scalars:scalars"][:, 0], [1e3 * corner[f"{name}_m"] for corner in corners])
    excess = [1e3 * (corner["executed_m"] - corner["prescribed_m"]) for corner in corners]
    np.testing.assert_allclose(recording.scalars("/plot/corner/excess/executed")[:, 0], excess, atol=1e-9)
    np.testing.assert_allclose(recording.scalars("/plot/corner/excess/limit"), [[0.0, 0.1]] * 2)
    # corners lie on top of each other: those above the pick points on one side, whichever way they are passed
    for name, inwards in (("pick", 1.0), ("place", -1.0)):
        strips = [np.array(strip) for strip in recording.static[f"/corner/{name}/planned_corner"]["LineStrips2D:strips"]]
        assert len(strips) == 8
        for strip in strips:
            assert (inwards * strip[:, 0]).min() > -1e-3
            assert strip[:, 1].min() > -1e-3
    distance = recording.scalars("/path/deviation/actual")[:, 0]
    for corner in corners:
        assert distance[round(1e3 * corner["time_s"])] == pytest.approx(corner["executed_m"], abs=2e-4)
    payload = recording.rows["/world/robot/payload"]
    carried = payload["Boxes3D:half_sizes"][:, 0, 0] > 0.0
    changes = run.payload_changes
    for step, is_carried in zip(payload["step"], carried, strict=True):
        mass = [mass for time, mass in changes if time <= step / 1000.0 + 5e-7][-1]
        assert is_carried == (mass > 0.0), step


def test_plots_begin_at_the_worst_pass(recorded: Recorded) -> None:
    path, _, facts = recorded
    corners = facts["executed"]["corners"]
    worst = [
        max((c for c in corners if c["side"] == side), key=lambda corner: corner["executed_m"] - corner["prescribed_m"])
        for side in (0, 1)
    ]
    titles = last_blueprint(path, "ViewBlueprint:display_name")
    ranges = {entity.removesuffix("/TimeAxis"): found for entity, found in last_blueprint(path, "TimeAxis:view_range").items()}
    for name, corner in zip(("Pick", "Place"), worst, strict=True):
        (view,) = (v for v, title in titles.items() if title.startswith(f"{name}, worst at {corner['time_s']:.3f} s"))
        start, end = (ranges[view][key] for key in ("start", "end"))
        assert start < 1e9 * corner["time_s"] < end
        assert end - start == pytest.approx(48e6, abs=1e3)


def test_a_recorded_sequence_is_exported_with_the_number_of_the_operation(recorded: Recorded) -> None:
    columns = export(recorded[0], None)
    run = schedule(load_scenario(STACK), cycles=2)
    begins = [operation.begin_ms for operation in run.operations]
    number = np.searchsorted(begins, columns["step"], side="right").astype(float)
    expected = np.where(columns["step"] < run.operations[-1].end_ms, (number - 1) % 8 + 1, 0.0)
    assert columns["operation"].tolist() == expected.tolist()
