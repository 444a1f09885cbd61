"""The command line as a user meets it: a process, its output, its exit code; a failure is one line and leaves nothing behind."""

import csv
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from integration.waiting import size, wait_until

from deltaph.scenario import template

SCENARIOS = Path(__file__).parents[2] / "scenarios"
PAPER = SCENARIOS / "paper.toml"
DELTAPH = Path(sys.executable).with_name("deltaph")


def deltaph(*arguments: object, cwd: Path, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    command = [str(DELTAPH), *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, env={**os.environ, **(env or {})}, capture_output=True, text=True, timeout=120, check=False
    )


def assert_refused(result: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    assert result.returncode == code, result.stderr
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in lines[0], lines[0]


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_version_and_help(tmp_path: Path) -> None:
    assert deltaph("--version", cwd=tmp_path).stdout.startswith("deltaph ")
    for command in (
        "init",
        "schema",
        "plan",
        "build",
        "run",
        "record",
        "command",
        "view",
        "compare",
        "export",
        "paper",
        "header",
        "zenoh-config",
        "bench",
    ):
        result = deltaph(command, "--help", cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert "Usage" in result.stdout


def test_init_writes_a_scenario_that_plans_and_never_overwrites(tmp_path: Path) -> None:
    assert deltaph("init", cwd=tmp_path).returncode == 0
    assert deltaph("plan", "scenario.toml", cwd=tmp_path).returncode == 0
    assert_refused(deltaph("init", cwd=tmp_path), 2, "scenario.toml exists")


def test_zenoh_configurations_are_printed_and_read(tmp_path: Path) -> None:
    for name in ("cell", "client"):
        printed = deltaph("zenoh-config", name, cwd=tmp_path)
        assert printed.returncode == 0, printed.stderr
        (tmp_path / f"{name}.json5").write_text(printed.stdout, encoding="utf-8")
        assert f"deltaph zenoh-config {name} > {name}.json5" in printed.stdout
    assert_refused(deltaph("zenoh-config", "router", cwd=tmp_path), 2, "'router'", "choose cell or client")
    # the example as it is: there are no certificates yet
    assert_refused(deltaph("run", PAPER, "--zenoh-config", "cell.json5", cwd=tmp_path), 2, "cannot listen on tls/[::]:7447")
    missing = deltaph("record", "-o", "a.rrd", "--zenoh-config", "missing.json5", cwd=tmp_path)
    assert_refused(missing, 2, "cannot read the Zenoh configuration missing.json5: No such file")


def test_name_of_the_cell_is_checked(tmp_path: Path) -> None:
    assert_refused(deltaph("run", PAPER, "--cell", "a/b", cwd=tmp_path), 2, "'a/b' does not fit into a Zenoh key")
    assert_refused(deltaph("run", PAPER, "--cell", "a", "--no-telemetry", cwd=tmp_path), 2, "--cell", "need telemetry")


def test_no_command_is_answered_with_the_help_alone(tmp_path: Path) -> None:
    result = deltaph(cwd=tmp_path)
    assert result.returncode == 2
    assert "Usage" in result.stdout
    assert result.stderr == ""


def test_init_to_standard_output_writes_the_scenario_and_nothing_else(tmp_path: Path) -> None:
    assert deltaph("init", "-", cwd=tmp_path).stdout == template()


def test_two_outputs_to_one_file_are_refused(tmp_path: Path) -> None:
    assert_refused(deltaph("plan", PAPER, "--csv", "both", "--json", "both", cwd=tmp_path), 2, "two outputs", "both")
    assert not (tmp_path / "both").exists()


def test_schema_is_json_schema(tmp_path: Path) -> None:
    schema = json.loads(deltaph("schema", cwd=tmp_path).stdout)
    assert set(schema["properties"]) >= {"schema", "title", "robot", "task", "law", "limits", "payload", "drive", "run", "expect"}
    assert schema["additionalProperties"] is False
    assert schema["then"]["properties"]["task"]["required"] == ["pick_mm", "place_mm"]  # they are the parts' in a sequence


def test_plan_reports_and_writes_everything(tmp_path: Path) -> None:
    result = deltaph(
        "plan", PAPER, "--json", "plan.json", "--csv", "plan.csv", "--plot", "plan.png", "--sample-ms", 0.5, cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert "303 ms" in result.stdout
    report = json.loads((tmp_path / "plan.json").read_text())
    assert set(report) == {"scenario", "law", "plan", "phases", "sequence", "operations"}
    assert report["plan"]["duration_s"] == 0.303
    assert report["plan"]["corner_deviation_m"] == [0.006, 0.006]
    assert [p["name"] for p in report["phases"]] == ["lift", "pick_corner", "accelerate", "decelerate", "place_corner", "lower"]
    rows = table(tmp_path / "plan.csv")
    assert len(rows) == 607
    assert float(rows[1]["time"]) == 0.0005
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.csv", "plan.json", "plan.png"]


def test_dash_is_standard_output_and_tables_go_elsewhere(tmp_path: Path) -> None:
    result = deltaph("plan", PAPER, "--json", "-", cwd=tmp_path)
    assert json.loads(result.stdout)["law"] == "paper"
    assert "corner deviation" in result.stderr


def test_a_reader_that_goes_is_exit_code_2_and_no_more(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        for arguments in (("plan", PAPER), ("plan", "--help"), ("schema",), ("init", "-"), ("build",), ("plan", "none.toml")):
            command = [DELTAPH, *arguments]
            alone = subprocess.run(command, cwd=tmp_path, stdout=writer, stderr=subprocess.PIPE, timeout=120, check=False)
            assert alone.returncode == 2, arguments
            assert alone.stderr.count(b"\n") == (1 if "none.toml" in arguments else 0), alone.stderr
            both = subprocess.run(command, cwd=tmp_path, stdout=writer, stderr=writer, timeout=120, check=False)
            assert both.returncode == 2, arguments
        csv_and_table = [DELTAPH, "plan", PAPER, "--csv", "-"]  # more than a buffer holds, so that a write fails, and not the end
        assert subprocess.run(csv_and_table, stdout=writer, stderr=subprocess.PIPE, timeout=120, check=False).returncode == 2
    finally:
        os.close(writer)


def test_closed_streams_are_nobody_that_listens(tmp_path: Path) -> None:
    for closed in (">&-", "2>&-", ">&- 2>&-"):
        for arguments, code in ((f"plan {PAPER} --json plan.json", 0), ("plan none.toml", 2)):
            command = ["sh", "-c", f"exec {DELTAPH} {arguments} {closed}"]
            result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
            assert result.returncode == code, (closed, arguments)
            assert "Traceback" not in result.stderr
            assert code == 0 or result.stdout == "", "an error is not a result"
        assert json.loads((tmp_path / "plan.json").read_text())["law"] == "paper"


def test_interrupt_while_modules_are_imported_leaves_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "typer.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    result = deltaph("--version", cwd=tmp_path, env={"PYTHONPATH": str(tmp_path)})
    assert (result.returncode, result.stdout, result.stderr) == (-signal.SIGINT, "", "")


def test_infeasible_is_exit_code_3_with_the_numbers(tmp_path: Path) -> None:
    for command in ("plan", "run"):
        result = deltaph(command, SCENARIOS / "infeasible.toml", cwd=tmp_path)
        assert_refused(result, 3, "corner deviation 12 mm does not fit lift height 50 mm: at most 8.53 mm")


def test_a_plan_beyond_its_limits_is_infeasible(tmp_path: Path) -> None:
    (tmp_path / "slow.toml").write_text(template() + "\n[limits]\njoint_velocity_rad_s = 4.0\n")
    result = deltaph("run", "slow.toml", cwd=tmp_path)
    assert_refused(result, 3, "joint 1 velocity reaches 4.418", "limit of 4 rad/s")


@pytest.mark.parametrize(
    ("old", "new", "code", "words"),
    [
        ("lift_mm", "lift_m", 2, ["unknown key task.lift_m", "did you mean lift_mm?"]),
        ("corner_deviation_mm = 6.0 ", "corner_deviation_mm = nan ", 2, ["task.corner_deviation_mm is nan"]),
        ("place_mm = [152.5", "place_mm = [-152.5", 3, ["pick and place are only 0 mm apart"]),
        ("place_mm = [152.5", "place_mm = [900.0", 3, ["joint"]),
        (
            "[payload]",
            "[robot]\nupper_arm_inertia_kg_m2 = 0.02\n[payload]",
            2,
            ["upper_arm_inertia_kg_m2 is 0.02", "at least 0.0290"],
        ),
        ("[payload]", "[robot]\nbase_radius_mm = 1300.0\n[payload]", 2, ["the robot cannot close", "1150 mm", "1255 mm"]),
    ],
)
def test_bad_scenarios(tmp_path: Path, old: str, new: str, code: int, words: list[str]) -> None:
    text = template()
    assert old in text
    (tmp_path / "bad.toml").write_text(text.replace(old, new))
    for command in ("plan", "run"):
        assert_refused(deltaph(command, "bad.toml", cwd=tmp_path), code, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan"], ["Missing argument", "SCENARIO"]),
        (["plan", "none.toml"], ["cannot read scenario none.toml"]),
        (["plan", PAPER, "--sample-ms", "0"], ["--sample-ms is 0"]),
        (["plan", PAPER, "--plot", "plan.xyz"], ["plan.xyz", "png"]),
        (["plan", PAPER, "--csv", "nowhere/plan.csv"], ["there is no directory nowhere"]),
        (["run", PAPER, "--record", "nowhere/paper.rrd"], ["there is no directory nowhere"]),
        (["run", PAPER, "--json", "."], ["it is a directory"]),
        (["run", PAPER, "--cycles", "0"], ["--cycles"]),
        (["run", SCENARIOS / "stack.toml", "--serve"], ["stack.toml: [sequence] is not for --serve"]),
        (["run", SCENARIOS / "feed_override.toml", "--serve"], ["[[feed]] is not for --serve"]),
        (["run", PAPER, "--no-telemetry", "--wait-subscribers", "1"], ["leave out --no-telemetry"]),
        (["run", PAPER, "--listen", "nonsense"], ["'nonsense' is not a Zenoh endpoint"]),
        (["build", "--fmi", "4"], ["--fmi is '4'"]),
        (["build", "--platform", "amiga"], ["amiga"]),
        (["record", "-o", "x.rrd", "--cell", "a/b"], ["'a/b'", "letters, digits"]),
        (["view", "none.rrd"], ["there is no recording none.rrd"]),
        (["view"], ["FILE.rrd", "--live"]),
        (["view", "none.rrd", "--live"], ["FILE.rrd", "--live"]),
        (["view", "none.rrd", "--url", "rerun+http://127.0.0.1:9876/proxy"], ["--url", "add --live"]),
        (["command", "ppo", "--place", "1,2"], ["--place is '1,2'", "3 lengths in mm"]),
        (["command", "ppo", "--place", "0,0,-800", "--lift", "-5"], ["--lift is -5", "greater than or equal to 0"]),
        (["command", "ppo", "--place", "0,0,-800", "--corner-deviation=6,-1"], ["--corner-deviation is 6,-1", "or equal to 0"]),
        (["command", "ppo", "--place", "0,0,-800", "--dwell", "inf"], ["--dwell is inf", "finite"]),
        (["command", "ppo", "--place", "0,0,-800", "--payload", "inf"], ["--payload is inf", "finite"]),
        (["fly"], ["No such command"]),
    ],
)
def test_bad_arguments(tmp_path: Path, arguments: list[object], words: list[str]) -> None:
    assert_refused(deltaph(*arguments, cwd=tmp_path), 2, *words)
    assert list(tmp_path.iterdir()) == []


def test_an_output_that_is_no_regular_file_is_left_alone(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for option in ("--json", "--csv"):
        assert_refused(deltaph("plan", PAPER, option, "pipe", cwd=tmp_path), 2, "not a regular file")
    assert (tmp_path / "pipe").is_fifo()
    (tmp_path / "real.json").write_text("old")
    (tmp_path / "link.json").symlink_to("real.json")
    assert deltaph("plan", PAPER, "--json", "link.json", cwd=tmp_path).returncode == 0
    assert (tmp_path / "link.json").is_symlink()
    assert json.loads((tmp_path / "real.json").read_text())["law"] == "paper"


def test_what_is_read_is_never_written(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(template())
    (tmp_path / "link.toml").symlink_to("case.toml")
    assert deltaph("run", "case.toml", "--no-telemetry", "--record", "case.rrd", cwd=tmp_path).returncode == 0
    before = (tmp_path / "case.rrd").read_bytes()
    for arguments in (
        ("plan", "case.toml", "--csv", "case.toml"),
        ("plan", "link.toml", "--json", "case.toml"),
        ("run", "case.toml", "--record", "link.toml"),
        ("export", "case.rrd", "--csv", "case.rrd"),
        ("compare", "case.rrd", "-o", "new.rrd", "--json", "case.rrd"),
    ):
        assert_refused(deltaph(*arguments, cwd=tmp_path), 2, arguments[-1], "it is what is read")
    assert (tmp_path / "case.toml").read_text() == template()
    assert (tmp_path / "case.rrd").read_bytes() == before
    assert not (tmp_path / "new.rrd").exists()


def test_only_text_goes_to_standard_output(tmp_path: Path) -> None:
    for arguments in (
        ("plan", PAPER, "--plot", "-"),
        ("run", PAPER, "--record", "-"),
        ("record", "-o", "-"),
        ("paper", "-o", "-"),
        ("compare", "a.rrd", "-o", "-"),
        ("export", "a.rrd", "--parquet", "-"),
    ):
        assert_refused(deltaph(*arguments, cwd=tmp_path), 2, "cannot write -: only text")
    assert list(tmp_path.iterdir()) == []


def test_links_that_lead_nowhere_are_refused(tmp_path: Path) -> None:
    (tmp_path / "loop.json").symlink_to("loop.json")
    (tmp_path / "far.json").symlink_to("nowhere/plan.json")
    assert_refused(deltaph("plan", PAPER, "--json", "loop.json", cwd=tmp_path), 2, "a link that leads nowhere")
    assert_refused(deltaph("plan", PAPER, "--json", "far.json", cwd=tmp_path), 2, "there is no directory", "nowhere")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("corner_mid_speed_m_s = 0.8", "corner_mid_speed_m_s = 1e30", "is needed"),
        ("traverse_speed_m_s = 2.4", "traverse_speed_m_s = 1e17", "is needed"),
        ("corner_deviation_mm = 6.0 ", "corner_deviation_mm = 1e-15 ", "is needed"),
        ("lift_mm = 50.0 ", "lift_mm = 1e30 ", "is needed"),
        ("[payload]", "[robot]\nforearm_mm = 1e300\n[payload]", "the robot is not valid"),
    ],
)
def test_values_beyond_any_robot_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "wild.toml").write_text(template().replace(old, new))
    assert_refused(deltaph("plan", "wild.toml", cwd=tmp_path), 3, words)


def test_a_compiler_is_needed_once(tmp_path: Path) -> None:
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    without = cache | {"PATH": str(tmp_path), "CC": "no-such-compiler"}
    assert_refused(deltaph("run", PAPER, "--no-telemetry", cwd=tmp_path, env=without), 2, "C compiler")
    assert deltaph("run", PAPER, "--no-telemetry", cwd=tmp_path, env=cache).returncode == 0
    result = deltaph("run", PAPER, "--no-telemetry", cwd=tmp_path, env=without)
    assert result.returncode == 0, result.stderr


def test_a_cache_that_cannot_be_written_is_refused_with_the_way_out(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = deltaph("run", PAPER, "--no-telemetry", cwd=tmp_path, env={"XDG_CACHE_HOME": str(tmp_path / "file")})
    assert_refused(result, 2, "cannot create the directory", "set XDG_CACHE_HOME")


def test_endpoint_in_use(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = deltaph("run", PAPER, "--listen", f"tcp/127.0.0.1:{port}", "--record", "paper.rrd", cwd=tmp_path)
    assert_refused(result, 2, f"tcp/127.0.0.1:{port}", "in use")
    assert list(tmp_path.iterdir()) == []


def test_build_works_from_any_directory(tmp_path: Path) -> None:
    result = deltaph("build", "-o", "out", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "DeltaCell-fmi2.ssp",
        "DeltaCell.ssp",
        "DeltaPlanner-fmi2.fmu",
        "DeltaPlanner.fmu",
        "DeltaPlant-fmi2.fmu",
        "DeltaPlant.fmu",
    ]


def test_run_reports_planned_and_executed_side_by_side(tmp_path: Path) -> None:
    result = deltaph("run", PAPER, "--no-telemetry", "--json", "run.json", "--csv", "run.csv", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    report = json.loads((tmp_path / "run.json").read_text())
    assert set(report) == {
        "scenario", "law", "steps", "communication_step_s", "plan", "executed", "timing", "telemetry", "recording",
        "expect", "provenance", "sequence", "operations",
    }  # fmt: skip
    assert report["steps"] == 353
    assert report["executed"]["corner_deviation_m"] == pytest.approx([0.006, 0.006], abs=5e-5)
    assert report["executed"]["trip"] == "none"
    assert all(check["ok"] for check in report["expect"])
    rows = table(tmp_path / "run.csv")
    assert len(rows) == 354
    assert {"time", "joint[1].position", "plan.status", "plant.joint[1].position", "plant.trip"} <= set(rows[0])
    assert "kept in the machine" in result.stdout


def test_factory_gains_lose_the_deviation_and_the_summary_says_so(tmp_path: Path) -> None:
    result = deltaph("run", SCENARIOS / "factory_gains.toml", "--no-telemetry", cwd=tmp_path)
    assert result.returncode == 0, result.stderr  # that it is lost is what the scenario expects
    line = next(line for line in result.stdout.splitlines() if line.startswith("pick side"))
    assert "6.0000" in line
    assert "9.1" in line
    assert "no" in line


def test_a_missed_expectation_is_exit_code_1(tmp_path: Path) -> None:
    (tmp_path / "strict.toml").write_text(template().replace("{ max = 0.1 }", "{ max = 0.01 }"))
    assert deltaph("run", "strict.toml", "--no-telemetry", cwd=tmp_path).returncode == 1


def test_a_trip_is_exit_code_1_unless_it_is_expected(tmp_path: Path) -> None:
    text = (SCENARIOS / "fault_torque_loss.toml").read_text(encoding="utf-8")
    expected = 'trip = "position_deviation"'
    assert expected in text
    for name, expectation, code in (
        ("expected", expected, 0),
        ("not expected", "", 1),
        ("another one", 'trip = "overspeed"', 1),
        ("none", 'trip = "none"', 1),
    ):
        (tmp_path / "trip.toml").write_text(text.replace(expected, expectation))
        result = deltaph("run", "trip.toml", "--no-telemetry", "--json", "trip.json", cwd=tmp_path)
        assert result.returncode == code, name
        executed = json.loads((tmp_path / "trip.json").read_text())["executed"]
        assert (executed["trip"], executed["trip_axis"]) == ("position_deviation", 1)
        assert executed["trip_time_s"] == pytest.approx(0.2686, abs=2e-3)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_leaves_a_readable_recording(tmp_path: Path, number: signal.Signals) -> None:
    command = [
        DELTAPH,
        "run",
        PAPER,
        "--realtime",
        "--cycles",
        "20",
        "--no-telemetry",
        "--record",
        "paper.rrd",
        "--json",
        "paper.json",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        recording = tmp_path / "paper.rrd"
        wait_until(lambda: size(recording) > 1_000_000, process)  # some seconds of frames
        process.send_signal(number)
        _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == "deltaph: interrupted"
    rerun = DELTAPH.with_name("rerun")
    subprocess.run([rerun, "rrd", "verify", recording], check=True, capture_output=True)
    assert [path.name for path in tmp_path.iterdir()] == ["paper.rrd"]


@pytest.mark.parametrize(("environment", "widest"), [({}, 132), ({"COLUMNS": "60"}, 60)])
def test_tables_in_a_pipe_are_as_wide_as_they_need(environment: dict[str, str], widest: int, tmp_path: Path) -> None:
    code = "from deltaph.cli.options import tables; from rich.table import Table; t = Table('x' * 300); tables().print(t)"
    plain = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=plain | environment, capture_output=True, text=True, timeout=60, check=True)
    assert max(map(len, done.stdout.splitlines())) == widest
