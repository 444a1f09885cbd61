import pytest
import zenoh

from deltaph.telemetry import CellKeys


def test_keys_are_those_of_the_contract() -> None:
    keys = CellKeys("cell1")
    assert keys.token == "deltaph/cell1"
    assert keys.everything == "deltaph/cell1/*"
    assert [keys.of(name) for name in ("setpoint", "actual", "timing", "plan", "event")] == [
        "deltaph/cell1/setpoint",
        "deltaph/cell1/actual",
        "deltaph/cell1/timing",
        "deltaph/cell1/plan",
        "deltaph/cell1/event",
    ]
    assert [keys.of(name) for name in ("schema", "scenario", "summary")] == [
        "deltaph/cell1/schema",
        "deltaph/cell1/scenario",
        "deltaph/cell1/summary",
    ]


def test_tokens_of_publishers_are_told_from_those_of_other_subscribers() -> None:
    publishers = zenoh.KeyExpr(CellKeys("cell1").publishers)
    assert publishers.includes(zenoh.KeyExpr("deltaph/cell1/setpoint/@adv/pub/1f/3/_"))
    assert not publishers.intersects(zenoh.KeyExpr("deltaph/cell1/setpoint/@adv/sub/1f/3/_"))


@pytest.mark.parametrize("cell", ["cell1", "Line-2.station_7", "7"])
def test_names_that_are_one_chunk(cell: str) -> None:
    assert CellKeys(cell).cell == cell


@pytest.mark.parametrize("cell", ["", "a/b", "*", "a*", "**", "$*", "a$", "@cell", "a?b", "a#b", "a b", "cell\n", "Zelle-ä"])
def test_names_that_are_not_one_plain_chunk_are_refused(cell: str) -> None:
    with pytest.raises(ValueError, match="does not fit into a Zenoh key: use letters"):
        CellKeys(cell)
