"""Real recordings, read back."""

import re
import resource
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pytest
import rerun_cli
from integration.read_back import Recording, assert_same_rows, last_blueprint
from integration.sinks import recorder_of_the_scene
from integration.synthetic_cell import DEVIATION, FOREARM, RIGHT_ANGLE_PATH, elbows, frames, replaced, scene, values_of
from numpy.typing import NDArray
from rerun.blueprint import Container
from rerun.chunk import RrdReader

from deltaph.errors import EnvironmentProblem
from deltaph.frame import TIMING, Frame
from deltaph.telemetry import Recorder, SinkProcess, layout
from deltaph.telemetry.blueprint import blueprint
from deltaph.telemetry.events import EventWatch
from deltaph.telemetry.keys import FRAME_MESSAGES
from deltaph.telemetry.scene import CornerMark
from deltaph.telemetry.signals import is_held

FRAMES = frames(1050, noise=1e-5)  # from the 1025th on, some times are below a whole nanosecond
RERUN = Path(rerun_cli.__file__).with_name("rerun")


def record(path: Path, chunk: int = 1000, *, summary: bool = True, recorded: list[Frame] = FRAMES) -> Path:
    recorder = Recorder(path, scene(), chunk=chunk)
    for frame in recorded:
        recorder.take(frame)
    if summary:
        recorder.summary("# Deviation kept", '{"verdict": "kept"}')
    recorder.close()
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("recording") / "run.rrd", chunk=100)


@pytest.fixture(scope="module")
def recording(file: Path) -> Recording:
    return Recording(file)


def column(message: str, *names: str) -> NDArray[np.float64]:
    """Fields of the frames (frames, names)."""
    return np.array([[values_of(frame)[message][name] for name in names] for frame in FRAMES])


def joints(quantity: str) -> Iterator[str]:
    return (f"joint[{i}].{quantity}" for i in (1, 2, 3))


def axes(quantity: str) -> Iterator[str]:
    return (f"tcp.{quantity}.{axis}" for axis in "xyz")


def verify(path: Path) -> None:
    done = subprocess.run([RERUN, "rrd", "verify", path], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def test_verify_passes_and_the_blueprint_is_inside(file: Path, recording: Recording) -> None:
    verify(file)
    assert recording.recording.application_id == "deltaph"
    assert {entry.application_id for entry in recording.blueprints} == {"deltaph"}


def test_while_a_cell_runs_the_distance_to_the_vertices_is_shown_as_it_comes() -> None:
    def titles(part: Any) -> list[str]:
        inside = part.contents if isinstance(part, Container) else []
        return [str(part.name), *(title for inner in inside for title in titles(inner))]

    def shown(live: bool) -> list[str]:
        return titles(blueprint(scene(), live=live).root_container)

    passing = "Distance to the nearer vertex [mm]: planned violet, executed orange, limit red"
    assert passing in shown(live=True)
    assert not [title for title in shown(live=True) if title.startswith("Pick vertex")]
    assert passing not in shown(live=False)
    assert "Pick vertex [mm], limit 6" in shown(live=False)


def test_while_a_cell_runs_plots_show_the_time_before_the_cursor(tmp_path: Path) -> None:
    """The whole of a long run would be a band of colour."""
    blueprint(scene(), live=True).save("deltaph", tmp_path / "live.rbl")
    blueprint(scene()).save("deltaph", tmp_path / "file.rbl")
    ranges = last_blueprint(tmp_path / "live.rbl", "TimeAxis:view_range")
    assert len(ranges) > 15
    assert {(shown["start"], shown["end"]) for shown in ranges.values()} == {(-2_000_000_000, 0)}
    assert len(last_blueprint(tmp_path / "file.rbl", "TimeAxis:view_range")) == 2  # the vertices


def test_titles_say_whether_there_is_a_limit(file: Path) -> None:
    titles = last_blueprint(file, "ViewBlueprint:display_name").values()
    for words in ("Joint velocity [rad/s]: broad actual, thin setpoint, limit red", "Joint acceleration [rad/s²], no limit"):
        assert words in titles


def test_last_blueprint_has_ranges_that_show_what_was_recorded(file: Path, recording: Recording) -> None:
    titles = last_blueprint(file, "ViewBlueprint:display_name")
    ranges = {path.removesuffix("/ScalarAxis"): found for path, found in last_blueprint(file, "ScalarAxis:range").items()}
    for words, entity in (("Tool tracking error", "/plot/tcp/tracking_error"), ("Joint velocity", "/joint/velocity/actual")):
        ((low, high),) = (ranges[view] for view, title in titles.items() if title.startswith(words))
        values = recording.scalars(entity)
        assert low < values.min()
        assert high > values.max()
        assert high - low < 4.0 * np.ptp(values)


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration", "torque"])
@pytest.mark.parametrize("role", ["setpoint", "actual"])
def test_joint_values_are_those_of_the_frames(recording: Recording, quantity: str, role: str) -> None:
    assert np.array_equal(recording.scalars(f"/joint/{quantity}/{role}"), column(role, *joints(quantity)))


@pytest.mark.parametrize("role", ["setpoint", "actual"])
def test_tool_values_are_those_of_the_frames(recording: Recording, role: str) -> None:
    for quantity in ("position", "velocity"):
        assert np.array_equal(recording.scalars(f"/tcp/{quantity}/{role}"), column(role, *axes(quantity)))
    speed = np.linalg.norm(column(role, *axes("velocity")), axis=1)
    np.testing.assert_allclose(recording.scalars(f"/tcp/speed/{role}")[:, 0], speed, rtol=1e-15)


def test_tracking_error_is_setpoint_minus_actual(recording: Recording) -> None:
    for entity, names in (("joint", list(joints("position"))), ("tcp", list(axes("position")))):
        assert np.array_equal(recording.scalars(f"/{entity}/tracking_error"), column("setpoint", *names) - column("actual", *names))


def test_deviation_is_the_distance_to_the_nearer_vertex(recording: Recording) -> None:
    assert np.array_equal(recording.scalars("/path/deviation/setpoint"), column("setpoint", "path.vertex_distance"))
    distance = [np.linalg.norm(column("actual", *axes("position")) - vertex, axis=1) for vertex in RIGHT_ANGLE_PATH[1:3]]
    np.testing.assert_allclose(recording.scalars("/path/deviation/actual")[:, 0], np.min(distance, axis=0), rtol=1e-15)
    assert np.unique(recording.scalars("/path/deviation/limit")) == [DEVIATION]


def test_every_signal_has_one_row_per_frame_at_its_time_and_step(recording: Recording) -> None:
    times = [round(frame.time * 1e9) for frame in FRAMES]
    signals = {e: rows for e, rows in recording.rows.items() if e not in ("/phase", "/trip", "/event") and "limit" not in e}
    signals = {e: rows for e, rows in signals.items() if not e.startswith(("/world", "/corner", "/plot")) and not is_held(e[1:])}
    assert {entity.split("/")[1] for entity in signals} == {*("joint", "tcp", "path", "motor", "rod", "constraint", "timing")}
    for entity, rows in signals.items():
        assert rows["sim_time"].tolist() == times, entity
        assert rows["step"].tolist() == list(range(len(FRAMES))), entity


def test_timelines_are_a_duration_and_a_sequence(file: Path) -> None:
    for chunk in RrdReader(file).stream():
        if not chunk.is_static:
            schema = chunk.to_record_batch().schema
            assert set(schema.names) & {"sim_time", "step", "log_time", "log_tick"} == {"sim_time", "step"}, chunk.entity_path
            assert schema.field("sim_time").type == pyarrow.duration("ns")
            assert schema.field("step").type == pyarrow.int64()


def test_timing_is_recorded(recording: Recording) -> None:
    for name in ("planner_step", "plant_step", "publish", "real_time_factor"):
        assert np.array_equal(recording.scalars(f"/timing/{name}"), column("timing", name))


def test_phases_are_rows_where_they_change(recording: Recording) -> None:
    phase = column("setpoint", "path.phase")[:, 0].astype(int)
    items = next(field.items for field in layout("setpoint").fields if field.name == "path.phase")
    changes = [k for k in range(len(phase)) if k == 0 or phase[k] != phase[k - 1]]
    assert recording.rows["/phase"]["step"].tolist() == changes
    assert recording.rows["/phase"]["StateChange:state"][:, 0].tolist() == [items[phase[k]] for k in changes]
    assert recording.rows["/trip"]["StateChange:state"][:, 0].tolist() == ["none"]


def test_finite_limits_span_the_recording(recording: Recording) -> None:
    assert np.unique(recording.scalars("/joint/velocity/limit"), axis=0).tolist() == [[6.0]]
    assert np.unique(recording.scalars("/joint/velocity/limit_below"), axis=0).tolist() == [[-6.0]]
    assert np.unique(recording.scalars("/joint/torque/limit"), axis=0).tolist() == [[60.0, 80.0]]
    steps = recording.rows["/joint/velocity/limit"]["step"]
    assert (steps[0], steps[-1]) == (0, len(FRAMES) - 1)
    assert not [entity for entity in recording.rows if entity.startswith(("/joint/jerk", "/tcp/speed/limit"))]


def test_joint_range_is_a_limit(recording: Recording) -> None:
    for entity, factor in (("/joint/position", 1.0), ("/plot/joint/position", 180.0 / np.pi)):
        assert np.unique(recording.scalars(f"{entity}/limit_below")) == pytest.approx([-0.7 * factor])
        assert np.unique(recording.scalars(f"{entity}/limit")) == pytest.approx([1.7 * factor])


@pytest.mark.parametrize(
    ("entity", "unit", "factor"),
    [
        ("path/deviation/setpoint", "mm", 1e3),
        ("path/deviation/actual", "mm", 1e3),
        ("joint/position/setpoint", "deg", 180.0 / np.pi),
        ("joint/position/actual", "deg", 180.0 / np.pi),
        ("joint/tracking_error", "deg", 180.0 / np.pi),
        ("tcp/tracking_error", "mm", 1e3),
    ],
)
def test_plots_show_the_same_in_units_for_people(recording: Recording, entity: str, unit: str, factor: float) -> None:
    steps, whole = recording.rows[f"/plot/{entity}"]["step"], recording.scalars(f"/{entity}")
    assert recording.rows[f"/plot/{entity}"]["sim_time"].tolist() == [round(FRAMES[k].time * 1e9) for k in steps]
    np.testing.assert_allclose(recording.scalars(f"/plot/{entity}"), factor * whole[steps], rtol=1e-15)
    assert all(name.endswith(f" [{unit}]") for name in recording.static[f"/plot/{entity}"]["SeriesLines:names"])
    if entity.startswith("path"):  # each step near the vertices
        assert steps.tolist() == np.flatnonzero(whole[:, 0] < 6.0 * DEVIATION).tolist()
    else:
        assert steps.tolist() == list(range(0, len(FRAMES), 3 if "error" in entity else 5))


def test_prescribed_deviation_is_plotted_in_millimetres(recording: Recording) -> None:
    assert np.unique(recording.scalars("/plot/path/deviation/limit")) == pytest.approx([1e3 * DEVIATION])


def test_what_is_held_has_rows_where_it_changes_and_at_the_end(recording: Recording, tmp_path: Path) -> None:
    for entity in ("/path/length/setpoint", "/trip_time/actual", "/timing/missed_deadlines", "/timing/lateness"):
        assert recording.rows[entity]["step"].tolist() == [0, len(FRAMES) - 1], entity
    name = [name for name, _, _ in TIMING].index("missed_deadlines")
    recorder = Recorder(tmp_path / "run.rrd", scene(), chunk=16)
    for frame in FRAMES[:60]:
        timing = frame.timing.copy()
        timing[name] = frame.step // 25
        recorder.take(replaced(frame, timing=timing))
    recorder.close()
    rows = Recording(tmp_path / "run.rrd")
    assert rows.rows["/timing/missed_deadlines"]["step"].tolist() == [0, 25, 50, 59]
    assert rows.scalars("/timing/missed_deadlines")[:, 0].tolist() == [0.0, 1.0, 2.0, 2.0]


def test_step_times_are_plotted_in_milliseconds(recording: Recording) -> None:
    names = ("planner_step", "plant_step", "publish", "lateness")
    assert recording.static["/plot/timing"]["SeriesLines:names"] == [f"{name} [ms]" for name in names]
    assert np.array_equal(recording.scalars("/plot/timing"), 1e3 * column("timing", *names))


def test_joints_differ_by_colour_setpoint_and_actual_by_width(recording: Recording) -> None:
    setpoint, actual = (recording.static[f"/joint/torque/{role}"] for role in ("setpoint", "actual"))
    assert len(set(setpoint["SeriesLines:colors"])) == 3
    widths = zip(setpoint["SeriesLines:widths"], actual["SeriesLines:widths"], strict=True)
    assert all(thin < broad for thin, broad in widths)
    assert setpoint["SeriesLines:widths"][1] > setpoint["SeriesLines:widths"][2]  # where joints 2 and 3 coincide, both are seen


def test_series_are_named_with_their_unit(recording: Recording) -> None:
    assert recording.static["/joint/velocity/actual"]["SeriesLines:names"][0] == "joint[1].velocity actual [rad/s]"
    assert recording.static["/tcp/tracking_error"]["SeriesLines:names"] == [f"tcp.tracking_error.{axis} [m]" for axis in "xyz"]
    assert recording.static["/joint/torque/limit"]["SeriesLines:names"][0] == "joint.torque limit [N.m]"


def test_every_series_has_a_unit(recording: Recording) -> None:
    named = {entity: static["SeriesLines:names"] for entity, static in recording.static.items() if "SeriesLines:names" in static}
    assert {entity for entity in recording.rows if "Scalars:scalars" in recording.rows[entity]} == named.keys()
    for entity, names in named.items():
        assert len(names) == recording.scalars(entity).shape[1], entity
        assert all(re.fullmatch(r".+ \[[^\[\]]+\]", name) for name in names), (entity, names)


POSES = [*range(0, len(FRAMES), 10), len(FRAMES) - 1]


def ends(recording: Recording, part: str) -> NDArray[np.float64]:
    """Both ends of the capsules of a part (poses, capsules, 2, 3)."""
    rows = recording.rows[f"/world/robot/{part}"]
    x, y, z, w = np.moveaxis(rows["Capsules3D:quaternions"], -1, 0)
    along = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)
    start = rows["Capsules3D:translations"]
    return np.stack([start, start + rows["Capsules3D:lengths"][..., None] * along], axis=2)


def test_robot_closes_in_space(recording: Recording) -> None:
    """Rods end where arms and platform are (the viewer's numbers are 32-bit)."""
    tcp = column("actual", *axes("position"))[POSES]
    arms, rods = ends(recording, "arms"), ends(recording, "rods").reshape(len(POSES), 3, 2, 2, 3)
    np.testing.assert_allclose(arms[:, :, 0], elbows(column("actual", *joints("position"))[POSES]), atol=1e-6)
    np.testing.assert_allclose(arms[:, :, 1], np.broadcast_to(scene().base_points, (len(POSES), 3, 3)), atol=1e-6)
    np.testing.assert_allclose(rods[:, :, :, 1].mean(axis=2), arms[:, :, 0], atol=1e-6)
    np.testing.assert_allclose(rods[:, :, :, 0].mean(axis=2), tcp[:, None] + scene().platform_offsets, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(rods[:, :, :, 1] - rods[:, :, :, 0], axis=-1), FOREARM, atol=1e-6)
    np.testing.assert_allclose(recording.rows["/world/robot/platform"]["Cylinders3D:centers"][:, 0], tcp, atol=1e-6)


def test_robot_is_posed_as_often_as_the_eye_sees(recording: Recording) -> None:
    for part in ("robot/arms", "robot/rods", "robot/platform", "arrows/velocity", "arrows/rod_force"):
        rows = recording.rows[f"/world/{part}"]
        assert rows["step"].tolist() == POSES, part
        assert rows["sim_time"].tolist() == [round(FRAMES[k].time * 1e9) for k in POSES], part


def test_executed_path_has_every_frame(recording: Recording) -> None:
    rows = recording.rows["/world/path/executed"]
    assert rows["step"].tolist() == [*range(50, len(FRAMES), 50), len(FRAMES) - 1]
    points = np.concatenate([np.array(strips[0])[1:] for strips in rows["LineStrips3D:strips"]])
    np.testing.assert_allclose(points, column("actual", *axes("position"))[1:], atol=1e-6)


@pytest.mark.parametrize("corner", [0, 1])
def test_corner_shows_millimetres_from_the_vertex(recording: Recording, corner: int) -> None:
    entity = f"/corner/{('pick', 'place')[corner]}"
    vertex = RIGHT_ANGLE_PATH[1 + corner]
    circle = np.array(recording.static[f"{entity}/prescribed"]["LineStrips2D:strips"][0])
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 1e3 * DEVIATION, atol=1e-4)
    planned = np.array(recording.static[f"{entity}/planned"]["LineStrips2D:strips"][0])
    np.testing.assert_allclose(planned, 1e3 * (scene().moves[0].planned_path - vertex)[:, [0, 2]] * [1, -1], atol=1e-4)
    executed = np.concatenate([np.array(strips[0]) for strips in recording.rows[f"{entity}/executed"]["LineStrips2D:strips"]])
    seen = 1e3 * (column("actual", *axes("position")) - vertex)[:, [0, 2]] * [1, -1]
    near = seen[np.linalg.norm(seen, axis=1) < 4.0 * 1e3 * DEVIATION]
    assert len(near) > 10
    assert np.abs(near[:, None] - executed).max(axis=2).min(axis=1).max() < 1e-4
    assert len(executed) < len(FRAMES) / 2  # what is far away is left out


def test_closest_points_are_marked_with_their_distance(tmp_path: Path) -> None:
    nearest = RIGHT_ANGLE_PATH[1] + [0.005, 0.0, -0.004]
    recorder = Recorder(tmp_path / "run.rrd", scene())
    recorder.take(FRAMES[0])
    recorder.summary("# Deviation kept", "{}", [CornerMark(0, 0, DEVIATION, 0.0064031, tuple(nearest))])
    recorder.close()
    static = Recording(tmp_path / "run.rrd").static
    assert static["/corner/pick/label/prescribed"]["Points2D:labels"] == ["prescribed 6 mm"]
    assert static["/corner/pick/label/planned"]["Points2D:labels"] == ["planned 6.000 mm"]
    assert static["/corner/pick/label/executed"]["Points2D:labels"] == ["executed 6.403 mm"]
    np.testing.assert_allclose(static["/corner/pick/nearest/executed"]["Points2D:positions"][0], [5.0, 4.0], atol=1e-4)
    planned = static["/corner/pick/nearest/planned"]["Points2D:positions"][0]
    assert np.linalg.norm(planned) == pytest.approx(1e3 * DEVIATION, abs=1e-3)
    assert not [entity for entity in static if entity.startswith("/corner/place/nearest")]
    assert static["/corner/place/label/executed"]["Points2D:labels"] == ["not reached"]


def test_every_move_has_its_own_vertices(tmp_path: Path) -> None:
    """Also where another move's vertex is nearer, and its corners lie on top of the others."""
    (first,) = scene().moves
    aside = np.array([0.0, 0.1, 0.0])
    second = replace(first, start=0.1, right_angle_path=first.right_angle_path + aside, planned_path=first.planned_path + aside)
    recorder = Recorder(tmp_path / "run.rrd", replace(scene(), moves=[first, second]))
    for frame in FRAMES[:300]:
        recorder.take(frame)
    recorder.close()
    found = Recording(tmp_path / "run.rrd")
    tcp = column("actual", *axes("position"))[:300]
    vertices = np.where(np.arange(300)[:, None, None] < 100, first.vertices, second.vertices)
    distance = np.linalg.norm(tcp[:, None] - vertices, axis=2).min(axis=1)
    np.testing.assert_allclose(found.scalars("/path/deviation/actual")[:, 0], distance, rtol=1e-15)
    assert len(found.static["/world/corner/pick/ball"]["Ellipsoids3D:half_sizes"]) == 2
    planned = np.array(found.static["/corner/pick/planned"]["LineStrips2D:strips"])
    np.testing.assert_allclose(planned[0], planned[1], atol=1e-4)


@pytest.mark.parametrize("payload", [[(0.0, 0.0)], [(0.0, 1.0), (0.1, 0.0)]])
def test_payload_is_what_the_robot_carries(tmp_path: Path, payload: list[tuple[float, float]]) -> None:
    recorder = Recorder(tmp_path / "run.rrd", replace(scene(), payload=payload))
    for frame in FRAMES[:200]:
        recorder.take(frame)
    recorder.close()
    rows = Recording(tmp_path / "run.rrd").rows
    if len(payload) == 1:
        assert "/world/robot/payload" not in rows
    else:
        carried = rows["/world/robot/payload"]["Boxes3D:half_sizes"][:, 0, 0] > 0.0
        assert carried.tolist() == [step < 100 for step in rows["/world/robot/payload"]["step"]]


def test_paths_and_corners_are_there(recording: Recording) -> None:
    for corner, vertex in zip(("pick", "place"), RIGHT_ANGLE_PATH[1:3], strict=True):
        circle = np.array(recording.static[f"/world/corner/{corner}/circle"]["LineStrips3D:strips"])[0]
        np.testing.assert_allclose(np.linalg.norm(circle - vertex, axis=1), DEVIATION, atol=1e-6)
        np.testing.assert_allclose(recording.static[f"/world/corner/{corner}/vertex"]["Points3D:positions"][0], vertex, atol=1e-6)
        np.testing.assert_allclose(
            recording.static[f"/world/corner/{corner}/ball"]["Ellipsoids3D:half_sizes"][0], DEVIATION, atol=1e-6
        )
    assert len(recording.static["/world/path/planned"]["LineStrips3D:strips"][0]) == len(scene().moves[0].planned_path)
    assert len(recording.static["/world/path/corners"]["LineStrips3D:strips"]) == 2
    np.testing.assert_allclose(recording.static["/world/path/right_angle"]["LineStrips3D:strips"][0], RIGHT_ANGLE_PATH, atol=1e-6)


def test_scenario_and_summary_are_properties(recording: Recording) -> None:
    assert recording.static["/__properties/scenario"]["json"] == [scene().scenario_json]
    assert recording.static["/__properties/scenario"]["law"] == ["paper"]
    assert recording.static["/__properties/summary"]["json"] == ['{"verdict": "kept"}']
    assert recording.static["/summary"]["TextDocument:text"] == ["# Deviation kept"]


@pytest.mark.parametrize("way", ["one chunk", "messages", "messages out of step"])
def test_content_does_not_depend_on_the_way(recording: Recording, tmp_path: Path, way: str) -> None:
    path = tmp_path / "run.rrd"
    if way == "one chunk":
        record(path, chunk=10_000)
    else:
        recorder = Recorder(path, scene(), chunk=100)
        arrivals = [(frame.step, name) for frame in FRAMES for name in FRAME_MESSAGES]
        if way == "messages out of step":  # as over the wire: in order by key, but not from key to key
            arrivals.sort(key=lambda arrival: arrival[0] + 40 * FRAME_MESSAGES.index(arrival[1]))
        for step, name in arrivals:
            recorder.take_message(name, layout(name).decode(layout(name).encode(FRAMES[step], step)))
        watch, event = EventWatch(), layout("event")
        for number, found in enumerate(found for frame in FRAMES for found in watch.see(frame)):
            recorder.take_message("event", event.decode(event.encode(found, number)))
        recorder.summary("# Deviation kept", '{"verdict": "kept"}')
        recorder.close()
    assert_same_rows(recording, Recording(path))


def test_events_are_recorded_in_words(recording: Recording) -> None:
    rows = recording.rows["/event"]
    assert [text for (text,) in rows["TextLog:text"][:2]] == ["plan 1 accepted: 0.303 s", "phase lift"]
    assert rows["step"].tolist()[:2] == [0, 0]
    assert len(rows["step"]) > 2


def test_missed_deadlines_do_not_bury_the_other_events(tmp_path: Path) -> None:
    column = [name for name, _, _ in TIMING].index("missed_deadlines")
    late = []
    for frame in FRAMES[:50]:
        timing = frame.timing.copy()
        timing[column] = max(frame.step - 9, 0)
        late.append(replaced(frame, timing=timing))
    rows = Recording(record(tmp_path / "run.rrd", recorded=late)).rows
    assert rows["/event/missed_deadline"]["step"].tolist() == list(range(10, 50))
    assert "deadline" not in str(rows["/event"]["TextLog:text"])


def test_lost_messages_leave_the_other_rows_whole(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.rrd", scene(), chunk=10)
    for frame in FRAMES[:50]:
        for name in FRAME_MESSAGES:
            if (name, frame.step) not in {("setpoint", 7), ("actual", 20), ("actual", 21)}:
                recorder.take_message(name, layout(name).decode(layout(name).encode(frame, frame.step)))
    recorder.close()
    rows = Recording(tmp_path / "run.rrd").rows
    assert set(range(50)) - set(rows["/joint/position/setpoint"]["step"].tolist()) == {7}
    assert set(range(50)) - set(rows["/joint/position/actual"]["step"].tolist()) == {20, 21}
    assert set(range(50)) - set(rows["/joint/tracking_error"]["step"].tolist()) == {7, 20, 21}
    assert len(rows["/timing/publish"]["step"]) == 50


def test_memory_does_not_grow_with_the_chunks(tmp_path: Path) -> None:
    """An index of them would grow by some 20 MB here."""
    recorder = Recorder(tmp_path / "run.rrd", scene(), chunk=20)
    memory = []
    for chunk in range(200):
        for frame in FRAMES[:20]:
            recorder.take(replaced(frame, step=frame.step + 20 * chunk, time=frame.time + 0.02 * chunk))
        memory.append(resident())
    assert memory[-1] - memory[50] < 5.0
    recorder.close()


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return 1e-6 * pages * resource.getpagesize()


def test_interrupted_run_leaves_a_readable_recording(tmp_path: Path) -> None:
    path = record(tmp_path / "run.rrd", summary=False, recorded=FRAMES[:30])
    verify(path)
    assert Recording(path).static["/summary"]["TextDocument:text"] == [
        "# A made-up operation\n\nLaw `paper`. The verdict comes at the end of the run."
    ]


def test_run_that_never_starts_leaves_nothing_and_overwrites_nothing(tmp_path: Path) -> None:
    record(tmp_path / "new.rrd", recorded=[])
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old.rrd").write_bytes(b"precious")
    record(tmp_path / "old.rrd", recorded=[])
    assert (tmp_path / "old.rrd").read_bytes() == b"precious"


def test_file_that_cannot_be_written_is_an_error_before_the_run(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing" / "run.rrd"):
        with pytest.raises(EnvironmentProblem, match=f"cannot write {path}: "):
            Recorder(path, scene())


def test_file_that_becomes_impossible_is_an_error_at_the_end(tmp_path: Path) -> None:
    (tmp_path / "directory").mkdir()
    sink = SinkProcess("recorder", partial(recorder_of_the_scene, tmp_path / "directory" / "run.rrd"), 100)
    sink.await_open()
    (tmp_path / "directory").rmdir()
    for frame in FRAMES[:20]:
        sink.take(frame)
    with pytest.raises(EnvironmentProblem, match="cannot write"):
        sink.close()
