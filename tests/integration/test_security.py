"""The example configurations, with certificates made on the spot: who gets what of a cell that is secured."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh
from integration.test_cli import DELTAPH, PAPER
from integration.waiting import DEADLINE, wait_until

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry import Publisher, Subscriber
from deltaph.telemetry.session import CONFIGURATIONS, free_endpoint, open_client_session, replies

CELL = "safe-cell"
COMMAND = f"deltaph/{CELL}/command/trigger"

# A cell whose session also answers a command, as `deltaph serve` does; it publishes when it is told to.
SECURED_CELL = """
import sys
from pathlib import Path
from deltaph.telemetry import Publisher
from integration.synthetic_cell import frames
cell, endpoint, config, command = sys.argv[1:]
publisher = Publisher(cell, '{"title": "safe"}', listen=[endpoint], config=Path(config))
def obey(query):
    print("obeyed", flush=True)
    query.reply(command, b"done")
queryable = publisher._session.declare_queryable(command, obey)
offered = frames(30)
for frame in offered[:20]:
    publisher.take(frame)
print("ready", flush=True)
sys.stdin.readline()
for frame in offered[20:]:
    publisher.take(frame)
publisher.set_summary("{}")
publisher.close()
"""


def openssl(*arguments: str, cwd: Path) -> None:
    subprocess.run(["openssl", *arguments], cwd=cwd, check=True, capture_output=True)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two authorities, `ca` and `other`; certificates of the first, and `forged`, which calls itself a reader."""
    folder = tmp_path_factory.mktemp("certificates")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    for name in ("ca", "other"):
        files = ("-keyout", f"{name}.key", "-out", f"{name}.pem")
        openssl("req", "-x509", *key, *files, "-days", "2", "-subj", f"/CN={name}", cwd=folder)
    (folder / "names.ext").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n", encoding="utf-8")
    for authority, name in (("ca", "cell"), ("ca", "reader"), ("ca", "operator"), ("ca", "stranger"), ("other", "forged")):
        common_name = "reader" if name == "forged" else name
        openssl("req", "-new", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={common_name}", cwd=folder)
        signed = ("-CA", f"{authority}.pem", "-CAkey", f"{authority}.key", "-CAcreateserial", "-days", "2", "-extfile", "names.ext")
        openssl("x509", "-req", "-in", f"{name}.csr", *signed, "-out", f"{name}.pem", cwd=folder)
    return folder


def edited(name: str, folder: Path, **files: str) -> Path:
    """An example as a user edits it: where the files are, and which."""
    text = CONFIGURATIONS[name].read_text(encoding="utf-8")
    for old, new in files.items():
        text = text.replace(f'"{old}.', f'"{new}.')
    text = re.sub(r'"(\w+\.(?:pem|key))"', lambda found: f'"{folder}/{found[1]}"', text)
    path = folder / f"{name}-{'-'.join(files.values())}.json5"
    path.write_text(text, encoding="utf-8")
    return path


class Cell:
    """A process with a secured cell."""

    def __init__(self, certificates: Path, log: Path) -> None:
        self.endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
        arguments = [CELL, self.endpoint, str(edited("cell", certificates)), COMMAND]
        refusals = "zenoh::net::routing::interceptor::access_control=trace,zenoh_link_tls=warn"
        self.log = log
        self._stream = log.open("w", encoding="utf-8")
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", SECURED_CELL, *arguments],
            stdin=subprocess.PIPE,
            stdout=self._stream,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "RUST_LOG": refusals},
        )

    def said(self) -> str:
        return re.sub(r"\x1b\[[0-9;]*m", "", self.log.read_text(encoding="utf-8"))

    def wait_for(self, words: str) -> None:
        wait_until(lambda: words in self.said(), self.process)

    def go_on(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdin is not None
        self.process.stdin.close()
        self._stream.close()


@contextmanager
def secured_cell(certificates: Path, log: Path) -> Iterator[Cell]:
    cell = Cell(certificates, log)
    try:
        cell.wait_for("ready")
        yield cell
    finally:
        cell.close()


def command(session: zenoh.Session) -> list[bytes]:
    return [reply.ok.payload.to_bytes() for reply in replies(session, COMMAND, 1.0) if reply.ok is not None]


def commands_reached(session: zenoh.Session, selector: str) -> list[str]:
    keys = [str(reply.ok.key_expr) for reply in replies(session, selector, 1.0) if reply.ok is not None]
    return [key for key in keys if key == COMMAND]


def test_reader_reads_everything_and_commands_nothing(certificates: Path, tmp_path: Path) -> None:
    with (
        secured_cell(certificates, tmp_path / "log") as cell,
        Subscriber(CELL, [cell.endpoint], DEADLINE, config=edited("client", certificates)) as subscriber,
    ):
        subscriber.wait_for_cell(DEADLINE)
        assert subscriber.ask("scenario") == {"title": "safe"}
        assert subscriber.ask("plan")["plan.count"] == 1
        reading = subscriber.messages()
        before = [next(reading) for _ in range(3 * 20 + 1)]  # sent before it came, at least
        cell.go_on()
        messages = [*before, *reading]
        assert subscriber.summary == {}
        assert set(subscriber.missing.values()) == {0}
        for name in ("setpoint", "actual", "timing"):
            assert [int(m.record["sequence"]) for m in messages if m.name == name] == list(range(30))


@pytest.mark.parametrize("selector", [COMMAND, f"deltaph/{CELL}/*/*", "deltaph/**", f"deltaph/{CELL}/**", "**"])
def test_reader_is_refused_commands_and_it_is_logged(certificates: Path, tmp_path: Path, selector: str) -> None:
    with (
        secured_cell(certificates, tmp_path / "log") as cell,
        open_client_session([cell.endpoint], DEADLINE, edited("client", certificates)) as session,
    ):
        assert replies(session, f"deltaph/{CELL}/schema", DEADLINE)  # it is known, and may ask
        assert commands_reached(session, selector) == []
        cell.wait_for(f"is unauthorized to Query (ingress) on {selector}")
        assert "CertCommonName(reader)" in cell.said()
        assert "obeyed" not in cell.said()


def test_reader_cannot_write(certificates: Path, tmp_path: Path) -> None:
    config = edited("client", certificates)
    with (
        secured_cell(certificates, tmp_path / "log") as cell,
        Subscriber(CELL, [cell.endpoint], DEADLINE, config=config) as honest,
        open_client_session([cell.endpoint], DEADLINE, config) as forger,
    ):
        honest.wait_for_cell(DEADLINE)
        forger.put(f"deltaph/{CELL}/summary", b'{"verdict": "forged"}')
        forger.liveliness().declare_token(f"deltaph/{CELL}")
        cell.wait_for("unauthorized to Put (ingress) on deltaph/safe-cell/summary")
        cell.go_on()
        assert len(honest.collect()["setpoint"]) == 30
        assert honest.summary == {}


def test_operator_commands(certificates: Path, tmp_path: Path) -> None:
    config = edited("client", certificates, reader="operator")
    with (
        secured_cell(certificates, tmp_path / "log") as cell,
        open_client_session([cell.endpoint], DEADLINE, config) as session,
    ):
        assert command(session) == [b"done"]
        cell.wait_for("obeyed")


def test_cell_that_serves_obeys_operators_only(certificates: Path) -> None:
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    serving = [
        str(DELTAPH),
        "run",
        str(PAPER),
        "--serve",
        "--listen",
        endpoint,
        "--zenoh-config",
        str(edited("cell", certificates)),
    ]

    def hold(who: str) -> subprocess.CompletedProcess[str]:
        config = edited("client", certificates, reader=who)
        command = ["command", "hold", "--cell", CELL, "--connect", endpoint, "--zenoh-config", str(config)]
        return subprocess.run([str(DELTAPH), *command], capture_output=True, text=True, timeout=DEADLINE, check=False)

    with subprocess.Popen([*serving, "--cell", CELL], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as cell:
        try:
            with Subscriber(CELL, [endpoint], DEADLINE, config=edited("client", certificates)) as subscriber:
                subscriber.wait_for_cell(DEADLINE)
                next(subscriber.messages(DEADLINE))  # it runs
                refused = hold("reader")
                obeyed = hold("operator")
        finally:
            cell.kill()
    assert refused.returncode == 2, refused.stdout
    assert "takes no commands" in refused.stderr
    assert "or this client's certificate may not command" in refused.stderr
    assert obeyed.returncode == 0, obeyed.stderr


def test_who_is_not_on_the_list_gets_nothing(certificates: Path, tmp_path: Path) -> None:
    config = edited("client", certificates, reader="stranger")
    with secured_cell(certificates, tmp_path / "log") as cell:
        with open_client_session([cell.endpoint], DEADLINE, config) as session:
            got: list[zenoh.Sample] = []
            session.declare_subscriber("deltaph/**", got.append)
            session.liveliness().declare_subscriber("deltaph/**", got.append, history=True)
            assert [r for name in ("schema", "scenario", "plan") for r in replies(session, f"deltaph/{CELL}/{name}", 1.0)] == []
            assert replies(session, f"deltaph/{CELL}/setpoint/@adv/**", 1.0) == []
            assert command(session) == []
            cell.go_on()
            assert cell.process.wait(DEADLINE) == 0  # it has sent everything
            assert got == []
        cell.wait_for("did not match any configured ACL subject")


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"reader": "forged"}, "UnknownIssuer"),  # a certificate of another authority, whatever it calls itself
        ({"ca": "other"}, "UnknownCA"),  # a client that does not trust the cell
    ],
)
def test_wrong_authority_is_refused(certificates: Path, tmp_path: Path, files: dict[str, str], words: str) -> None:
    with secured_cell(certificates, tmp_path / "log") as cell:
        with pytest.raises(EnvironmentProblem, match="nothing answers on tls/localhost"):
            open_client_session([cell.endpoint], 0.5, edited("client", certificates, **files))
        cell.wait_for(words)


def test_without_a_certificate_nobody_is_let_in(certificates: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.json5"
    bare.write_text(json.dumps({"transport": {"link": {"tls": {"root_ca_certificate": str(certificates / "ca.pem")}}}}))
    with secured_cell(certificates, tmp_path / "log") as cell:
        with pytest.raises(EnvironmentProblem, match="nothing answers on tls/localhost"):
            open_client_session([cell.endpoint], 0.5, bare)
        cell.wait_for("peer sent no certificates")


def test_plain_tcp_is_closed(certificates: Path) -> None:
    with pytest.raises(EnvironmentProblem, match="cannot listen on tcp/127"):
        Publisher(CELL, "{}", listen=[free_endpoint()], config=edited("cell", certificates))
