"""Comparisons of real recordings, read back."""

import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from integration.read_back import last_blueprint, static_components
from integration.synthetic_cell import frames, scene
from rerun.chunk import RrdReader

from deltaph.compare import compare
from deltaph.telemetry import Recorder
from deltaph.telemetry.comparison import PATH_TIMELINE
from deltaph.telemetry.reading import Reading

SCENARIOS = Path(__file__).parents[2] / "scenarios"
DELTAPH = Path(sys.executable).with_name("deltaph")


def deltaph(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(DELTAPH), *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With recordings and CSV tables of three runs, and the comparison of the first two."""
    folder = tmp_path_factory.mktemp("comparison")
    for name in ("paper", "time_optimal", "factory_gains"):
        done = deltaph(
            "run", SCENARIOS / f"{name}.toml", "--no-telemetry", "--record", folder / f"{name}.rrd", "--csv", folder / f"{name}.csv"
        )
        assert done.returncode == 0, done.stderr
    compare(folder / "paper.rrd", folder / "time_optimal.rrd", folder / "both.rrd")
    return folder


def rows(path: Path, entity: str, timeline: str) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Times and values of an entity on one timeline."""
    found = []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == f"/{entity}" and not chunk.is_static:
            batch = chunk.to_record_batch()
            if timeline in batch.schema.names:
                times = batch.column(timeline).to_numpy(zero_copy_only=False).astype(np.int64)
                found.append((times, np.asarray(batch.column("Scalars:scalars").flatten()).reshape(len(batch), -1)))
    times = np.concatenate([t for t, _ in found])
    order = np.argsort(times)
    return times[order], np.concatenate([v for _, v in found])[order]


def test_difference_in_time_is_that_of_the_recorded_values(directory: Path) -> None:
    a, b = (Reading(directory / f"{name}.rrd") for name in ("paper", "time_optimal"))
    times, difference = rows(directory / "both.rrd", "difference/joint/torque", "sim_time")
    of_a, of_b = (reading.rows["joint/torque/actual"] for reading in (a, b))
    assert times.tolist() == of_b.nanoseconds.tolist()  # the shorter one
    assert np.array_equal(difference, of_b.values - of_a.values[: len(times)])


def test_on_the_same_path_the_deviation_differs_in_time_but_hardly_along_the_path(directory: Path) -> None:
    """The planned paths of `paper` and `time_optimal` are one curve; only the tracking of it differs."""
    _, in_time = rows(directory / "both.rrd", "difference/path/deviation", "sim_time")
    where, along = rows(directory / "both.rrd", "difference/path/deviation", PATH_TIMELINE)
    assert np.abs(in_time).max() > 50.0
    assert np.abs(along).max() < 0.5
    assert where.tolist() == list(range(0, where[-1] + 1, 500))
    assert where[-1] == pytest.approx(391_586, abs=100)  # the path's length in micrometres


def test_time_at_the_end_of_the_path_is_the_difference_of_the_durations(directory: Path) -> None:
    _, gained = rows(directory / "both.rrd", "difference/time_at_point", PATH_TIMELINE)
    assert gained[0, 0] == 0.0
    assert gained[-1, 0] == pytest.approx(224.0 - 303.0, abs=3.0)  # the last tenth of a millimetre takes some milliseconds


def test_blueprint_and_verdict_are_inside(directory: Path) -> None:
    reader = RrdReader(directory / "both.rrd")
    assert [entry.application_id for entry in reader.blueprints()] == ["deltaph-comparison"]
    text = (
        next(c for c in reader.stream() if c.entity_path == "/verdict").to_record_batch().column("TextDocument:text")[0].as_py()[0]
    )
    assert "The paper's section 4" in text
    assert "Time-optimal" in text
    assert "**Deviation kept within the tolerance of 0.05 mm, by 0.03" in text
    assert "Joints 2 and 3 move alike" in text
    assert "| duration [ms] | 303 | 224 | -79 (-26.1 %) |" in text


@pytest.mark.parametrize("name", ["pick", "place"])
def test_corners_show_both_motions_from_their_vertices_with_their_distances(directory: Path, name: str) -> None:
    static = static_components(directory / "both.rrd")
    circle = np.array(static[f"/corner/{name}/prescribed"]["LineStrips2D:strips"][0])
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 6.0, atol=1e-4)
    for letter, run in (("a", "paper"), ("b", "time_optimal")):
        summary = Reading(directory / f"{run}.rrd").summary
        assert summary is not None
        distance = 1e3 * summary["executed"]["corners"][("pick", "place").index(name)]["executed_m"]
        assert static[f"/corner/{name}/label/{letter}"]["Points2D:labels"] == [f"{letter.upper()} {distance:.3f} mm"]
        spoke = np.array(static[f"/corner/{name}/nearest/{letter}"]["LineStrips2D:strips"][0])
        assert np.linalg.norm(spoke[1] - spoke[0]) == pytest.approx(distance, abs=1e-3)
        path = np.array(static[f"/corner/{name}/{letter}"]["LineStrips2D:strips"][0])
        assert np.linalg.norm(path, axis=1).min() == pytest.approx(distance, abs=0.1)  # samples


def test_corners_show_all_passes(directory: Path, tmp_path: Path) -> None:
    done = deltaph("run", SCENARIOS / "paper.toml", "--no-telemetry", "--cycles", "2", "--record", tmp_path / "cycles.rrd")
    assert done.returncode == 0, done.stderr
    compare(directory / "paper.rrd", tmp_path / "cycles.rrd", tmp_path / "c.rrd")
    static = static_components(tmp_path / "c.rrd")
    assert len(static["/corner/pick/a"]["LineStrips2D:strips"]) == 1
    assert len(static["/corner/pick/b"]["LineStrips2D:strips"]) == 3  # two of the four passes are one: the robot stays there


def test_differences_along_the_path_are_seen_without_choosing_a_timeline(directory: Path) -> None:
    static = static_components(directory / "both.rrd")
    for quantity, factor in (("time_at_point", 1.0), ("tcp/speed", 1e3)):
        _, along = rows(directory / "both.rrd", f"difference/{quantity}", PATH_TIMELINE)
        chart = static[f"/along_path/{quantity}"]
        values, points = (np.array(chart[f"BarChart:{name}"][0]["buffer"], dtype=float) for name in ("values", "abscissa"))
        np.testing.assert_allclose(values, factor * along[::2, 0])
        np.testing.assert_allclose(points, 1.0 * np.arange(len(points)), atol=1e-9)  # a bar for each millimetre


def test_one_recording_is_its_plan_against_its_plant(directory: Path) -> None:
    facts = compare(directory / "factory_gains.rrd", None, directory / "plan.rrd")
    assert [facts[letter]["name"] for letter in "ab"] == ["planned", "executed"]
    assert facts["b"]["figures"]["executed deviation, place side [mm]"] > 8.0
    recorded = Reading(directory / "factory_gains.rrd").rows
    _, difference = rows(directory / "plan.rrd", "difference/joint/velocity", "sim_time")
    expected = np.degrees(recorded["joint/velocity/actual"].values - recorded["joint/velocity/setpoint"].values)
    np.testing.assert_allclose(difference, expected, atol=1e-9)
    assert "/along_path/tcp/speed" in (static := static_components(directory / "plan.rrd"))
    assert "/along_path/time_at_point" not in static  # both are where the plan is
    compare(directory / "paper.rrd", directory / "factory_gains.rrd", directory / "gains.rrd")
    assert "/along_path/time_at_point" not in static_components(directory / "gains.rrd")
    assert "/along_path/time_at_point" in static_components(directory / "both.rrd")


def test_an_operation_and_a_sequence_are_compared(directory: Path, tmp_path: Path) -> None:
    done = deltaph("run", SCENARIOS / "stack.toml", "--no-telemetry", "--record", tmp_path / "stack.rrd")
    assert done.returncode == 0, done.stderr
    facts = compare(directory / "paper.rrd", tmp_path / "stack.rrd", tmp_path / "c.rrd")
    assert "parts a minute" not in facts["a"]["figures"] and facts["b"]["figures"]["parts a minute"] > 100.0
    label = static_components(tmp_path / "c.rrd")["/corner/pick/label/prescribed"]["Points2D:labels"]
    assert label == ["prescribed 6 mm"]
    end = 1e-9 * Reading(directory / "paper.rrd").rows["tcp/position/actual"].nanoseconds[-1]
    for shown in last_blueprint(tmp_path / "c.rrd", "TimeAxis:view_range").values():
        assert (1e-9 * shown["start"], 1e-9 * shown["end"]) == pytest.approx((0.0, end))


def test_sequence_is_compared_by_its_pace_and_its_worst_corner_around_which_it_is_shown(tmp_path: Path) -> None:
    done = deltaph("run", SCENARIOS / "stack.toml", "--no-telemetry", "--record", tmp_path / "stack.rrd")
    assert done.returncode == 0, done.stderr
    facts = compare(tmp_path / "stack.rrd", None, tmp_path / "plan.rrd")
    summary = Reading(tmp_path / "stack.rrd").summary
    assert summary is not None
    planned, executed = (facts[letter]["figures"] for letter in "ab")
    assert planned["parts a minute"] == executed["parts a minute"] == summary["sequence"]["parts_per_minute"]
    corners = summary["executed"]["corners"]
    worst = max(corners, key=lambda corner: corner["executed_m"] - corner["prescribed_m"])
    key = "beyond the prescribed deviation, worst corner [mm]"
    assert executed[key] == pytest.approx(1e3 * (worst["executed_m"] - worst["prescribed_m"]))
    assert planned[key] == pytest.approx(1e3 * max(corner["planned_m"] - corner["prescribed_m"] for corner in corners), abs=1e-9)
    starts = last_blueprint(tmp_path / "plan.rrd", "TimeAxis:view_range").values()
    assert len(starts) > 10
    for shown in starts:
        assert shown["start"] < 1e9 * worst["time_s"] < shown["end"] < shown["start"] + 1e9
    chart = static_components(tmp_path / "plan.rrd")["/along_path/tcp/speed"]
    points = chart["BarChart:abscissa"][0]["buffer"]
    travelled, _ = rows(tmp_path / "plan.rrd", "tcp/speed/a", PATH_TIMELINE)
    assert 100 < len(points) < 0.6 * 1e-3 * travelled[-1]  # bars of a millimetre, of the half that is shown


def test_command_prints_both_and_writes_json(directory: Path, tmp_path: Path) -> None:
    done = deltaph("compare", directory / "paper.rrd", directory / "time_optimal.rrd", "-o", tmp_path / "c.rrd", "--json", "-")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["a"]["title"].startswith("The paper's section 4")
    assert facts["b"]["figures"]["law"] == "time_optimal"
    assert "B - A" in done.stderr


def test_what_is_no_recording_of_deltaph_is_refused_in_one_line(directory: Path, tmp_path: Path) -> None:
    (tmp_path / "text.rrd").write_text("not a recording")
    for wrong, word in ((tmp_path / "text.rrd", "no recording of deltaph"), (directory / "both.rrd", "no recording of deltaph")):
        done = deltaph("compare", directory / "paper.rrd", wrong, "-o", tmp_path / "c.rrd")
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert str(wrong) in done.stderr
        assert word in done.stderr
    assert not (tmp_path / "c.rrd").exists()


@pytest.mark.parametrize("room", [0, 200_000])
def test_full_disk_is_one_line_and_leaves_nothing(directory: Path, tmp_path: Path, room: int) -> None:
    both = tmp_path / "both.rrd"
    command = [str(DELTAPH), "compare", str(directory / "paper.rrd"), "-o", str(both)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (room, room))
        _, words = process.communicate(timeout=60)
    assert words == f"deltaph: error: cannot write {both}: File too large\n"
    assert process.returncode == 2
    assert not list(tmp_path.iterdir())


def test_output_must_not_be_one_of_the_recordings(directory: Path) -> None:
    before = (directory / "paper.rrd").read_bytes()
    done = deltaph("compare", directory / "paper.rrd", directory / "time_optimal.rrd", "-o", directory / "paper.rrd")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "it is what is read" in done.stderr
    assert (directory / "paper.rrd").read_bytes() == before


def test_run_that_ended_before_its_summary_can_be_compared(directory: Path, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "cut.rrd", scene_of_paper(directory))
    for frame in frames(100):
        recorder.take(frame)
    recorder.close()
    facts = compare(directory / "paper.rrd", tmp_path / "cut.rrd", tmp_path / "c.rrd")
    assert facts["b"]["figures"]["executed deviation, pick side [mm]"] is None


def scene_of_paper(directory: Path) -> Any:
    """The made-up scene, with a scenario that can be read."""
    from dataclasses import replace

    return replace(scene(), scenario_json=Reading(directory / "paper.rrd").scenario_json)
