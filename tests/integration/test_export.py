"""Tables of recordings against the tables that the runs themselves wrote."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from integration.synthetic_cell import frames, scene

from deltaph.errors import DeltaphError
from deltaph.export import export
from deltaph.telemetry import Recorder, layout

PAPER = Path(__file__).parents[2] / "scenarios" / "paper.toml"
DELTAPH = Path(sys.executable).with_name("deltaph")


def deltaph(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(DELTAPH), *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a recording of five cycles (3.4 s: late times are below a whole nanosecond) and the run's own table of them."""
    folder = tmp_path_factory.mktemp("export")
    arguments = ("--no-telemetry", "--cycles", 5, "--record", folder / "run.rrd", "--csv", folder / "run.csv")
    done = deltaph("run", PAPER, *arguments)
    assert done.returncode == 0, done.stderr
    return folder


def table(path: Path) -> dict[str, list[float]]:
    with path.open(encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    return {name: [float(row[i]) for row in rows] for i, name in enumerate(head)}


def test_joined_table_is_that_of_the_run_to_the_last_bit(directory: Path) -> None:
    done = deltaph("export", directory / "run.rrd", "--csv", directory / "back.csv", "--parquet", directory / "back.parquet")
    assert done.returncode == 0, done.stderr
    written, read = table(directory / "run.csv"), table(directory / "back.csv")
    not_recorded = {name for name in written if name not in read}
    assert all(name.startswith("plan.") or "tracking_error" in name or name == "plant.trip_axis" for name in not_recorded)
    common = [name for name in written if name in read and name != "time"]
    for name in common:
        assert read[name] == written[name], name
    assert np.rint(1e9 * np.array(read["time"])).tolist() == np.rint(1e9 * np.array(written["time"])).tolist()
    assert read["step"] == list(range(len(written["time"])))

    columns = pyarrow.parquet.read_table(directory / "back.parquet").to_pydict()
    assert columns.keys() == read.keys()
    for name in common:
        assert columns[name] == written[name], name


def test_one_entity_has_its_own_rows(directory: Path) -> None:
    done = deltaph("export", directory / "run.rrd", "--entity", "/phase", "--csv", "-")
    assert done.returncode == 0, done.stderr
    head, first, *_ = done.stdout.splitlines()
    assert (head, first) == ("time,step,path.phase", "0,0,1")
    columns = export(directory / "run.rrd", "joint/position/actual")
    assert list(columns) == ["time", "step", *(f"plant.joint[{i}].position" for i in (1, 2, 3))]


def test_lost_messages_are_missing_numbers(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.rrd", scene())
    for frame in frames(30):
        for name in ("setpoint", "actual", "timing"):
            if (name, frame.step) != ("actual", 7):
                recorder.take_message(name, layout(name).decode(layout(name).encode(frame, frame.step)))
    recorder.close()
    columns = export(tmp_path / "run.rrd", None)
    assert len(columns["time"]) == 30
    assert np.flatnonzero(np.isnan(columns["plant.joint[1].position"])).tolist() == [7]
    assert not np.isnan(columns["joint[1].position"]).any()


def test_unknown_entity_names_the_nearest(directory: Path) -> None:
    with pytest.raises(DeltaphError, match=r"no signal joint/positions/actual: did you mean joint/position/actual\?"):
        export(directory / "run.rrd", "joint/positions/actual")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run.rrd"], "give --csv FILE, --parquet FILE or both"),
        (["run.csv", "--csv", "-"], "is no recording of deltaph"),
        (["none.rrd", "--csv", "-"], "there is no recording"),
        (["run.rrd", "--csv", "nowhere/x.csv"], "there is no directory"),
    ],
)
def test_wrong_input_is_one_line(directory: Path, arguments: list[str], words: str) -> None:
    done = deltaph("export", directory / arguments[0], *arguments[1:])
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert words in done.stderr
