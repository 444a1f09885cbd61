"""DeltaPlanner: what it emits is what `deltaph plan` samples; requests are taken, made to wait, or refused as the contract says."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from integration.fmi_slave import OK, FmiSlave

from deltaph.fmu.model_description import FmiVersion
from deltaph.importer import planner_values, task_inputs
from deltaph.outputs import planner_columns
from deltaph.plan import Plan
from deltaph.scenario import Scenario, Task, load_scenario
from deltaph.variables import variable_table

SCENARIOS = Path(__file__).parents[2] / "scenarios"
TABLE = variable_table("planner")
STATUS = TABLE.items("PlanStatus")
OUTPUTS = [v.name for v in TABLE.of("output")]


@pytest.fixture
def planner(dist: Path, version: FmiVersion, tmp_path: Path) -> Iterator[FmiSlave]:
    slave = FmiSlave(dist, "planner", version, tmp_path)
    yield slave
    slave.free()


def set_all(slave: FmiSlave, values: dict[str, float]) -> None:
    for name, value in values.items():
        number = int(value) if not TABLE[name].is_float else value
        assert slave.put({name: number}) == OK, slave.messages


def play(slave: FmiSlave, first: int, steps: int) -> np.ndarray:
    """Outputs after each of the steps that begin at step `first`."""
    rows = []
    for n in range(first, first + steps):
        assert slave.step(n * 1e-3) == OK, slave.messages
        rows.append(slave.outputs())
    return np.array(rows, dtype=np.float64)


def expected(plan: Plan, steps: int) -> np.ndarray:
    return np.column_stack(list(planner_columns(plan, np.arange(steps + 1) / 1000.0).values()))


@pytest.mark.parametrize("name", ["paper", "comparison", "oblique", "tight_corner", "paper_limited", "time_optimal"])
def test_emits_what_plan_samples_bit_for_bit(planner: FmiSlave, name: str) -> None:
    scenario = load_scenario(SCENARIOS / f"{name}.toml")
    plan = Plan.of(scenario)
    set_all(planner, planner_values(scenario))
    planner.initialize()
    steps = plan.duration_ms + 20
    rows = np.vstack([planner.outputs(), play(planner, 0, steps)])
    assert (rows == expected(plan, steps)).all()


def test_unedited_planner_runs_the_papers_case(planner: FmiSlave) -> None:
    plan = Plan.of(load_scenario(SCENARIOS / "paper.toml"))
    planner.initialize()
    rows = np.vstack([planner.outputs(), play(planner, 0, 310)])
    assert (rows == expected(plan, 310)).all()


def test_start_time_and_long_steps_change_nothing(planner: FmiSlave) -> None:
    planner.initialize(start=10.0)
    plan = Plan.of(load_scenario(SCENARIOS / "paper.toml"))
    for n in range(0, 300, 25):
        assert planner.step(10.0 + n * 1e-3, 25e-3) == OK, planner.messages
        assert planner.outputs() == expected(plan, n + 25)[-1].tolist()


def back(scenario: Scenario) -> Task:
    return scenario.task.reversed()


def test_a_waiting_request_starts_in_the_step_in_which_the_first_arrives(planner: FmiSlave) -> None:
    scenario = load_scenario(SCENARIOS / "paper.toml")
    there, again = Plan.of(scenario), Plan(scenario.robot, back(scenario), scenario.law)
    planner.initialize()
    play(planner, 0, 100)
    set_all(planner, {**task_inputs(back(scenario)), "task.trigger": 2})
    rows = play(planner, 100, 2 * 303 - 100)
    position = rows[:, [OUTPUTS.index(f"tcp.position.{axis}") for axis in "xyz"]]
    both = np.vstack([there.sample(np.arange(303) / 1000)["tcp_position"], again.sample(np.arange(304) / 1000)["tcp_position"]])
    assert (position == both[101:]).all()
    assert rows[0][OUTPUTS.index("plan.count")] == 2
    assert rows[-1][OUTPUTS.index("plan.busy")] == 0
    assert rows[-2][OUTPUTS.index("plan.busy")] == 1


def test_a_third_request_is_refused_as_busy_and_zero_never_asks(planner: FmiSlave) -> None:
    scenario = load_scenario(SCENARIOS / "paper.toml")
    planner.initialize()
    set_all(planner, {**task_inputs(back(scenario)), "task.trigger": 2})
    play(planner, 0, 1)
    assert planner.get("plan.count") == [2]
    set_all(planner, {"task.trigger": 0})
    play(planner, 1, 1)
    assert planner.get("plan.count", "plan.refused") == [2, 0]
    set_all(planner, {"task.trigger": 3})
    play(planner, 2, 1)
    assert STATUS[int(planner.get("plan.status")[0])] == "busy"
    assert planner.get("plan.count", "plan.refused") == [2, 1]


def ask_back(planner: FmiSlave, scenario: Scenario, trigger: int = 2) -> None:
    set_all(planner, {**task_inputs(back(scenario)), "task.trigger": trigger})


@pytest.mark.parametrize("name", ["time_optimal", "paper_limited"])
def test_a_slow_plan_is_made_over_steps_and_starts_as_soon_as_it_is_ready(planner: FmiSlave, name: str) -> None:
    scenario = load_scenario(SCENARIOS / f"{name}.toml")
    set_all(planner, planner_values(scenario))
    planner.initialize()
    play(planner, 0, 400)
    ask_back(planner, scenario)
    rows = play(planner, 400, 400)
    status, phase = (rows[:, OUTPUTS.index(what)] for what in ("plan.status", "path.phase"))
    planning = int((status == STATUS.index("planning")).sum())
    assert 4 <= planning <= 60
    assert (status[:planning] == STATUS.index("planning")).all()
    assert (status[planning:] == STATUS.index("ok")).all()
    assert (phase[:planning] == 0).all()
    assert phase[planning] == TABLE.items("Phase").index("lift")
    assert (rows[: planning + 1, OUTPUTS.index("plan.busy")] == 1).all()
    plan = Plan(scenario.robot, back(scenario), scenario.law, scenario.declared_payload, scenario.limits)
    moving = plan.sample(np.arange(1, 200) / 1000.0)["joint_position"]
    assert (rows[planning : planning + 199, :3] == moving).all()


def test_while_one_is_planned_a_further_request_is_refused_and_changes_nothing(planner: FmiSlave) -> None:
    scenario = load_scenario(SCENARIOS / "time_optimal.toml")
    set_all(planner, planner_values(scenario))
    planner.initialize()
    play(planner, 0, 10)
    ask_back(planner, scenario)
    play(planner, 10, 2)
    set_all(planner, {"task.trigger": 3, "task.place.x": 0.1})
    play(planner, 12, 1)
    assert STATUS[int(planner.get("plan.status")[0])] == "busy"
    assert planner.get("plan.count", "plan.refused") == [1, 1]
    rows = play(planner, 13, 600)
    assert planner.get("plan.count", "plan.refused") == [2, 1]
    assert rows[-1][OUTPUTS.index("tcp.position.x")] == -0.1525
    assert STATUS[int(planner.get("plan.status")[0])] == "ok"


def test_a_refusal_by_the_law_comes_when_it_is_known(planner: FmiSlave) -> None:
    scenario = load_scenario(SCENARIOS / "time_optimal.toml")
    set_all(planner, planner_values(scenario))
    planner.initialize()
    play(planner, 0, 300)
    rest = planner.outputs()[:12]
    set_all(planner, {**task_inputs(back(scenario)), "task.place.x": 0.9, "task.trigger": 2})
    play(planner, 300, 30)
    assert STATUS[int(planner.get("plan.status")[0])] in {"joint_range", "unreachable", "singular"}
    assert planner.get("plan.count", "plan.refused", "plan.busy") == [1, 1, 0]
    assert planner.outputs()[:12] == rest


@pytest.mark.parametrize("offset", [(3e-7, 0.0, 0.0), (0.0, -2e-7, 5e-7), (0.0, 0.0, -9e-7)])
def test_a_pick_point_nearly_where_the_robot_rests_is_taken_as_there(planner: FmiSlave, offset: tuple[float, ...]) -> None:
    scenario = load_scenario(SCENARIOS / "paper.toml")
    planner.initialize()
    play(planner, 0, 310)
    inputs = task_inputs(back(scenario))
    inputs |= {f"task.pick.{axis}": inputs[f"task.pick.{axis}"] + off for axis, off in zip("xyz", offset, strict=True)}
    inputs["task.lift_pick"] -= offset[2]
    set_all(planner, {**inputs, "task.trigger": 2})
    rows = play(planner, 310, 310)
    assert planner.get("plan.count") == [2]
    plan = Plan(scenario.robot, back(scenario), scenario.law)
    times = np.arange(1, 311) / 1000.0
    assert rows[:, :3] == pytest.approx(plan.sample(times)["joint_position"], abs=1e-6)
    first = rows[0, OUTPUTS.index("tcp.position.x") :][:3]
    assert first == pytest.approx(plan.sample(times[:1])["tcp_position"][0], abs=1e-9)  # from where it rests
    assert any("plan 2 accepted" in text for _, _, text in planner.messages)


def test_a_pick_point_elsewhere_is_refused_and_the_robot_stays(planner: FmiSlave) -> None:
    planner.initialize()
    play(planner, 0, 310)
    rest = planner.outputs()[:12]
    set_all(planner, {"task.trigger": 2})  # the pick point is still where the first PPO began
    play(planner, 310, 3)
    assert STATUS[int(planner.get("plan.status")[0])] == "not_at_pick"
    assert planner.get("plan.required")[0] == pytest.approx(0.305)
    assert planner.outputs()[:12] == rest
    assert any("rests 305 mm away from the pick point" in text for _, _, text in planner.messages)


@pytest.mark.parametrize(
    ("values", "status"),
    [
        ({"task.corner_deviation_pick": 0.012}, "lift_too_low"),
        ({"task.place.x": -0.1525}, "traverse_too_short"),
        ({"task.place.x": 0.9}, "joint_range"),
        ({"task.lift_place": 0.06}, "not_level"),
        ({"task.corner_deviation_place": -0.001}, "invalid_value"),
        ({"task.pick.z": -1.5, "task.place.z": -1.5}, "unreachable"),
    ],
)
def test_an_infeasible_task_is_a_result_and_the_robot_rests(planner: FmiSlave, values: dict[str, float], status: str) -> None:
    set_all(planner, values)
    planner.initialize()
    rows = np.vstack([planner.outputs(), play(planner, 0, 5)])
    assert np.isfinite(rows).all()
    assert (rows == rows[0]).all()
    assert STATUS[int(planner.get("plan.status")[0])] == status
    assert planner.get("plan.count", "plan.refused") == [0, 1]
    required, available = planner.get("plan.required", "plan.available")
    assert required != available
    assert planner.messages


@pytest.mark.parametrize(("payload", "held"), [(-5.0, 0.0), (1e308, 1e6)])
def test_a_payload_that_is_refused_is_held_within_bounds(planner: FmiSlave, payload: float, held: float) -> None:
    set_all(planner, {"payload.mass": payload})
    planner.initialize()
    assert STATUS[int(planner.get("plan.status")[0])] == "invalid_value"
    torques = planner.get(*(f"joint[{i}].torque" for i in (1, 2, 3)))
    planner.call("Reset")
    set_all(planner, {"payload.mass": held, "task.trigger": 0})
    planner.initialize()
    assert planner.get(*(f"joint[{i}].torque" for i in (1, 2, 3))) == torques


def test_the_task_is_that_of_the_moment_of_the_request(planner: FmiSlave) -> None:
    planner.initialize()
    play(planner, 0, 10)
    set_all(planner, {"task.place.x": 0.1, "task.corner_deviation_pick": 0.012})
    rows = play(planner, 10, 300)
    assert rows[-1][12] == 0.1525


def fed(slave: FmiSlave, feeds: list[float]) -> dict[str, np.ndarray]:
    """Outputs by name, one row per step, with the feed of each step."""
    slave.initialize()
    rows = []
    for n, feed in enumerate(feeds):
        assert slave.put({"feed": feed}) == OK, slave.messages
        assert slave.step(n * 1e-3) == OK, slave.messages
        rows.append(slave.outputs())
    return dict(zip(OUTPUTS, np.array(rows, dtype=np.float64).T, strict=True))


def test_feed_stops_on_the_path_and_resumes(planner: FmiSlave) -> None:
    plan = Plan.of(load_scenario(SCENARIOS / "paper.toml"))
    out = fed(planner, [1.0] * 60 + [0.0] * 500 + [1.0] * 700)
    position = np.column_stack([out[f"tcp.position.{axis}"] for axis in "xyz"])
    speed = np.linalg.norm([out[f"tcp.velocity.{axis}"] for axis in "xyz"], axis=0)
    assert speed[540] < 1e-7
    assert 0.0 < out["path.arc_length"][540] < plan.length
    assert (np.diff(out["path.arc_length"]) >= 0.0).all()  # never backwards
    assert position[-1].tolist() == list(plan.task.place)
    assert out["plan.busy"][-1] == 0

    # On the path: each point is one of the plan's, and the corner keeps its deviation.
    dense = plan.sample(np.linspace(0.0, plan.duration, 30_001))["tcp_position"]
    gaps = [np.linalg.norm(dense - point, axis=1).min() for point in position[::20]]
    assert max(gaps) < 2.0 * 2.4 * plan.duration / 30_000
    assert out["path.vertex_distance"].min() > 0.006 - 1e-12


def test_feed_keeps_derivatives_together_and_jerk_bounded(planner: FmiSlave) -> None:
    out = fed(planner, [1.0] * 100 + [0.3] * 300 + [1.0] * 300)
    h = 1e-3
    for kind, axes in (("tcp", ["x", "y", "z"]), ("joint", ["1", "2", "3"])):
        for axis in axes:
            names = [
                f"tcp.{what}.{axis}" if kind == "tcp" else f"joint[{axis}].{what}"
                for what in ("position", "velocity", "acceleration")
            ]
            for value, derivative in itertools.pairwise(names):
                slope = (out[value][2:] - out[value][:-2]) / (2 * h)
                scale = np.abs(out[derivative]).max()
                assert slope == pytest.approx(out[derivative][1:-1], abs=0.02 * scale + 1e-9), (value, derivative)
    acceleration = np.column_stack([out[f"tcp.acceleration.{axis}"] for axis in "xyz"])
    jerk = np.linalg.norm(np.diff(acceleration, axis=0), axis=1) / h
    assert jerk.max() < 11_328 + 2.4 * 50.0**2 * 1.5


def test_feed_of_one_half_takes_twice_as_long(planner: FmiSlave) -> None:
    assert planner.put({"feed": 0.5}) == OK
    out = fed(planner, [0.5] * 606)
    assert out["plan.busy"].tolist() == [1.0] * 605 + [0.0]


@pytest.mark.parametrize(("dwell", "dwell_ms"), [(0.05, 50), (0.0501, 51), (0.0, 0), (1e-6, 1)])
def test_a_ppo_begins_with_its_dwell_at_the_pick_point(planner: FmiSlave, dwell: float, dwell_ms: int) -> None:
    plan = Plan.of(load_scenario(SCENARIOS / "paper.toml"))
    set_all(planner, {"task.dwell": dwell})
    planner.initialize()
    rows = np.vstack([planner.outputs(), play(planner, 0, dwell_ms + 310)])
    moving = expected(plan, 310)
    assert (rows[dwell_ms:] == moving).all()
    resting = moving[0].copy()
    resting[OUTPUTS.index("path.phase")] = TABLE.items("Phase").index("dwell")
    assert (rows[:dwell_ms] == resting).all()


def test_the_dwell_is_that_of_the_request_and_begins_when_the_first_arrives(planner: FmiSlave) -> None:
    scenario = load_scenario(SCENARIOS / "paper.toml")
    planner.initialize()
    play(planner, 0, 100)
    set_all(planner, {**task_inputs(back(scenario)), "task.dwell": 0.03, "task.trigger": 2})
    play(planner, 100, 1)
    set_all(planner, {"task.dwell": 0.5})
    rows = play(planner, 101, 303 + 30 + 303 - 101)
    phase = rows[:, OUTPUTS.index("path.phase")]
    dwell = TABLE.items("Phase").index("dwell")
    assert np.flatnonzero(phase == dwell).tolist() == list(range(303 - 102, 333 - 102))
    assert (rows[:-1, OUTPUTS.index("plan.busy")] == 1).all()
    assert rows[-1, OUTPUTS.index("plan.busy")] == 0
    assert rows[-1, OUTPUTS.index("plan.duration")] == 0.303


def test_feed_stops_a_dwell_too(planner: FmiSlave) -> None:
    set_all(planner, {"task.dwell": 0.02, "feed": 0.0})
    planner.initialize()
    rows = play(planner, 0, 100)
    assert (rows == rows[0]).all()
    assert rows[0, OUTPUTS.index("path.phase")] == TABLE.items("Phase").index("dwell")


def test_a_dwell_of_more_than_an_hour_is_refused(planner: FmiSlave) -> None:
    set_all(planner, {"task.dwell": 3601.0})
    planner.initialize()
    assert STATUS[int(planner.get("plan.status")[0])] == "invalid_value"
    assert planner.get("plan.required", "plan.available") == [3600.0, 3601.0]
