"""How a configuration file, the command line and the defaults make a Zenoh configuration."""

import json
from pathlib import Path

import pytest

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.session import CONFIGURATIONS, _Settings


def settings(tmp_path: Path, text: str) -> _Settings:
    file = tmp_path / "zenoh.json5"
    file.write_text(text, encoding="utf-8")
    return _Settings("peer", file)


def test_without_a_file_a_session_keeps_to_this_machine() -> None:
    config = _Settings("peer", None).config(["tcp/127.0.0.1:7447"], [])
    assert [config.get_json(f"scouting/{how}/enabled") for how in ("multicast", "gossip")] == ["false", "false"]
    assert json.loads(config.get_json("listen/endpoints")) == ["tcp/127.0.0.1:7447"]
    assert json.loads(config.get_json("mode")) == "peer"
    assert json.loads(config.get_json("transport/link/tx/queue/size/data")) == 16


def test_file_goes_before_defaults_and_the_command_line_before_the_file(tmp_path: Path) -> None:
    found = settings(
        tmp_path,
        """{ // a comment
          mode: "client", listen: { endpoints: ["tcp/127.0.0.1:1"] }, connect: { endpoints: ["tcp/127.0.0.1:2"] },
          scouting: { gossip: { enabled: true } }, transport: { link: { tx: { queue: { size: { data: 2 } } } } } }""",
    )
    assert found.endpoints("listen") == ("tcp/127.0.0.1:1",)
    assert found.endpoints("connect") == ("tcp/127.0.0.1:2",)
    config = found.config(["tcp/127.0.0.1:3"], [])
    assert json.loads(config.get_json("listen/endpoints")) == ["tcp/127.0.0.1:3"]
    assert [config.get_json(f"scouting/{how}/enabled") for how in ("multicast", "gossip")] == ["false", "true"]
    assert json.loads(config.get_json("mode")) == "client"
    assert json.loads(config.get_json("transport/link/tx/queue/size/data")) == 2  # although it is Zenoh's own default


def test_endpoints_by_mode(tmp_path: Path) -> None:
    found = settings(tmp_path, '{ listen: { endpoints: { peer: ["tcp/127.0.0.1:1"], router: ["tcp/127.0.0.1:2"] } } }')
    assert found.endpoints("listen") == ("tcp/127.0.0.1:1",)
    assert found.endpoints("connect") == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{ mode: ", "cannot read the Zenoh configuration .*zenoh.json5: line 1 Unexpected end of input at column 9$"),
        ("[1, 2]", "is no Zenoh configuration: it must be an object"),
        ("{ acces_control: {} }", "is no Zenoh configuration: .*unknown field .acces_control."),
        ('{ listen: { endpoints: ["tpc/127.0.0.1:1"] } }', "'tpc/127.0.0.1:1' is not a Zenoh endpoint"),
    ],
)
def test_what_is_no_configuration_is_said(tmp_path: Path, text: str, words: str) -> None:
    def read() -> None:
        found = settings(tmp_path, text)
        found.config(found.endpoints("listen"), found.endpoints("connect"))

    with pytest.raises(EnvironmentProblem, match=words):
        read()


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_examples_are_configurations(name: str) -> None:
    found = _Settings("peer", CONFIGURATIONS[name])
    config = found.config(found.endpoints("listen"), found.endpoints("connect"))
    assert json.loads(config.get_json("transport/link/tls/enable_mtls")) is True
