"""The picture of a plan, also of one whose path has no corner to show."""

from pathlib import Path

import pytest

from deltaph.plot import draw_plan
from deltaph.scenario import parse_scenario, template
from deltaph.schedule import schedule


@pytest.mark.parametrize(
    ("pick", "place", "lifts"),
    [
        ("[-152.5, 0.0, -800.0]", "[-152.5, 0.0, -760.0]", (40.0, 0.0)),  # straight up
        ("[-152.5, 0.0, -760.0]", "[-152.5, 0.0, -800.0]", (0.0, 40.0)),  # straight down
        ("[-152.5, 0.0, -800.0]", "[152.5, 0.0, -800.0]", (0.0, 0.0)),  # straight across
    ],
)
def test_a_path_without_corners_is_drawn(tmp_path: Path, pick: str, place: str, lifts: tuple[float, float]) -> None:
    text = template().replace('name = "paper"', 'name = "time_optimal"')
    text = text.replace("pick_mm = [-152.5, 0.0, -800.0]", f"pick_mm = {pick}")
    text = text.replace("place_mm = [152.5, 0.0, -800.0]", f"place_mm = {place}")
    text = text.replace("lift_mm = 50.0", f"lift_pick_mm = {lifts[0]}\nlift_place_mm = {lifts[1]}")
    scenario = parse_scenario(text, Path("test.toml"))
    draw_plan(schedule(scenario), scenario.limits, scenario.title, tmp_path / "plan.png")
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
