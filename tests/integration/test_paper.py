"""`deltaph paper`, against figures that were found another way (the high-precision reference, the scenarios' own expectations)."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from integration.read_back import static_components
from rerun.chunk import RrdReader

DELTAPH = Path(sys.executable).with_name("deltaph")


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """The recording, the JSON and what is printed."""
    folder = tmp_path_factory.mktemp("paper")
    command = [DELTAPH, "paper", "-o", folder / "paper.rrd", "--json", folder / "paper.json"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == 0, result.stderr
    return folder / "paper.rrd", json.loads((folder / "paper.json").read_text()), result.stdout


def numbers(text: str) -> list[float]:
    return [float(found) for found in re.findall(r"-?\d+\.?\d*", text)]


def test_claims_are_measured(done: tuple[Path, dict[str, Any], str]) -> None:
    _, facts, printed = done
    claims = {claim["claim"]: claim for claim in facts["claims"]}
    assert numbers(claims["deviation, proposed method"]["measured"])[:3] == [6.0, 37.0, 6.0]
    assert numbers(claims["deviation, comparison method, eq. (31)"]["measured"])[:3] == [3.70179, 37.0, 3.70179]
    assert facts["overlap_at_equal_deviation"] == pytest.approx(0.5959013124694679, abs=1e-9)
    assert "(+70 %)" in claims["motion performance"]["measured"]
    assert numbers(claims["duration"]["measured"])[:3] == [302.70, 316.41, 301.42]
    assert 0.0 < numbers(claims["time to plan one PPO"]["measured"])[0] < 1000.0
    assert "3.7 mm" in printed


def test_figures_4_to_8_are_there_with_their_units(done: tuple[Path, dict[str, Any], str]) -> None:
    reader = RrdReader(done[0])
    assert len(reader.blueprints()) == 1
    names: dict[str, list[str]] = {}
    values: dict[str, Any] = {}
    for chunk in reader.stream():
        batch = chunk.to_record_batch()
        if "SeriesLines:names" in batch.schema.names:
            names[chunk.entity_path] = batch.column("SeriesLines:names")[0].as_py()
        if "Scalars:scalars" in batch.schema.names:
            values[chunk.entity_path] = np.asarray(batch.column("Scalars:scalars").flatten()).reshape(len(batch), -1)
    assert sorted(names) == [f"/figure_{n}/{part}" for n in (5, 6) for part in "abc"] + [
        f"/figure_{n}/{part}" for n in (7, 8) for part in "ab"
    ]
    static = static_components(done[0])
    for method, deviation in (("proposed", 6.0), ("comparison", 3.7)):
        (spoke,) = np.array(static[f"/figure_4/deviation/{method}"]["LineStrips3D:strips"])
        assert 1e3 * np.linalg.norm(spoke[1] - spoke[0]) == pytest.approx(deviation, abs=0.01)
        assert static[f"/figure_4/deviation/{method}/label"]["Points3D:labels"] == [f"{method} {deviation:.1f} mm"]
    text = static["/claims"]["TextDocument:text"][0]
    assert "| deviation of the comparison method | fixed, cannot be changed | 0.52 to 11.12 mm | wrong |" in text
    assert names["/figure_5/b"] == [f"joint {i} [deg]" for i in (1, 2, 3)]
    assert names["/figure_8/b"][0] == "joint 1 [N.m]"
    assert np.abs(values["/figure_5/a"][:, 0]).max() == pytest.approx(2.4, rel=2e-3)  # V_max, on the aligned clock
    assert np.abs(values["/figure_6/a"][:, 2]).max() == pytest.approx(1.2, rel=4e-3)
    assert np.abs(values["/figure_7/b"]).max() > 1.3 * np.abs(values["/figure_8/b"]).max()
