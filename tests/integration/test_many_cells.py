"""Several cells in one network, each a `deltaph run` of its own, and one subscriber of them all."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import pytest
import zenoh
from integration.test_cli import DELTAPH, PAPER
from integration.waiting import DEADLINE, wait_until

from deltaph.telemetry import layout, open_router_session
from deltaph.telemetry.session import collected, free_endpoint

NAMES = ("north", "south", "west")


@contextmanager
def run(name: str, *options: str, report: Path) -> Iterator[subprocess.Popen[str]]:
    command = [str(DELTAPH), "run", str(PAPER), "--realtime", "--cell", name, "--json", str(report), *options]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def subscriber(mode: str, endpoints: list[str]) -> zenoh.Session:
    """A session that connects when there is something to connect to, and stays where a part of it comes later."""
    quiet = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    connect = {"endpoints": endpoints, "timeout_ms": int(1000 * DEADLINE), "exit_on_failure": True}
    facts = {"mode": mode, "connect": connect, "listen": {"endpoints": []}, "scouting": quiet}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(facts)))


@pytest.mark.parametrize("topology", ["router", "peers", "chain"])
def test_one_subscriber_sees_every_cell(tmp_path: Path, topology: str) -> None:
    own = {name: free_endpoint() for name in NAMES}
    samples: list[zenoh.Sample] = []
    with ExitStack() as stack:
        if topology == "router":  # cells and subscribers connect to it
            meeting = [free_endpoint()]
            stack.enter_context(open_router_session(meeting))
            mode, where, connect = "client", meeting, dict.fromkeys(NAMES, meeting)
        elif topology == "peers":  # the subscriber connects to each cell
            mode, where, connect = "peer", list(own.values()), {}
        else:  # the others connect to the first cell, and a client to that one
            mode, where = "client", [own[NAMES[0]]]
            connect = {name: [own[NAMES[0]]] for name in NAMES[1:]}
        processes = {}
        for name in NAMES:
            options = ["--listen", own[name], "--wait-subscribers", "1"]
            options += [option for endpoint in connect.get(name, []) for option in ("--connect", endpoint)]
            if topology == "chain" and name == NAMES[0]:
                options += ["--cycles", "6"]  # the others' way to the subscriber: it ends last
            processes[name] = stack.enter_context(run(name, *options, report=tmp_path / f"{name}.json"))
        session = stack.enter_context(subscriber(mode, where))
        tokens = partial(session.liveliness().get, "deltaph/*", timeout=1.0)
        wait_until(lambda: len({str(reply.ok.key_expr) for reply in collected(tokens, 1.0) if reply.ok}) == len(NAMES))
        session.declare_subscriber("deltaph/*/timing", samples.append)
        for process in processes.values():
            assert process.wait(DEADLINE) == 0, process.stderr and process.stderr.read()
        steps = {name: json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))["steps"] for name in NAMES}
        wait_until(lambda: len(samples) >= sum(steps.values()) + len(NAMES))
    for name in NAMES:
        payloads = [sample.payload.to_bytes() for sample in samples if str(sample.key_expr) == f"deltaph/{name}/timing"]
        assert [int(layout("timing").decode(payload)["sequence"]) for payload in payloads] == list(range(steps[name] + 1))


def test_second_cell_of_a_name_is_refused(tmp_path: Path) -> None:
    meeting = free_endpoint()
    with open_router_session([meeting]) as router:
        options = ["--connect", meeting, "--listen", free_endpoint()]
        with run("north", *options, "--wait-subscribers", "1", report=tmp_path / "first.json"):
            wait_until(lambda: any(reply.ok is not None for reply in router.liveliness().get("deltaph/north")))
            options[-1] = free_endpoint()
            with run("north", *options, report=tmp_path / "second.json") as second:
                assert second.wait(DEADLINE) == 2
                assert second.stderr is not None
                reason = "a cell north is there already: give this one another name with --cell, or as `cell` under [run]"
                assert second.stderr.read().splitlines()[-1] == f"deltaph: error: {reason}"
    assert not (tmp_path / "second.json").exists()
