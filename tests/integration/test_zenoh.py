"""Real sessions on loopback. The reader in another process knows Zenoh and the schema, and nothing of deltaph."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from operator import attrgetter, methodcaller
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import zenoh
from integration.synthetic_cell import frames, replaced, values_of
from integration.waiting import DEADLINE, wait_until
from zenoh import ext

from deltaph.errors import EnvironmentProblem
from deltaph.frame import Frame, Sink
from deltaph.telemetry import DEFAULT_ENDPOINT, EVENT_KINDS, Message, Publisher, SinkProcess, Subscriber, layout, schema_document
from deltaph.telemetry.publisher import HISTORY
from deltaph.telemetry.session import free_endpoint, open_client_session, replies
from deltaph.telemetry.subscriber import _QUIET

CELL = "test-cell"
PLAIN_CLIENT = Path(__file__).parents[2] / "telemetry" / "plain_client.py"

FOREIGN_READER = """
import json, struct, sys, threading
import zenoh

endpoint, root = sys.argv[1:]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
samples, ended = [], threading.Event()

def on_sample(sample):
    samples.append(sample)
    if str(sample.key_expr).endswith("/summary"):
        ended.set()

gone = threading.Event()
with zenoh.open(config) as session:
    schema = json.loads(next(iter(session.get(root + "/schema"))).ok.payload.to_bytes())["messages"]
    session.liveliness().declare_subscriber(root, lambda s: s.kind == zenoh.SampleKind.DELETE and gone.set(), history=True)
    session.declare_subscriber(root + "/*", on_sample)
    complete = ended.wait(20) and gone.wait(20)

FORMATS = {"uint64": "<Q", "float64": "<d", "int32": "<i"}
messages = {}
for sample in samples:
    key, payload = str(sample.key_expr).rpartition("/")[2], sample.payload.to_bytes()
    if key in schema:
        layout = schema[key]
        assert len(payload) == layout["size"] and payload[:4].hex(" ") == layout["header"], key
        assert str(sample.encoding) == layout["encoding"], str(sample.encoding)
        values = {f["name"]: struct.unpack_from(FORMATS[f["type"]], payload, f["offset"])[0] for f in layout["fields"]}
        messages.setdefault(key, []).append(values)
print(json.dumps({"complete": bool(complete), "messages": messages}))
"""

CELL_PROCESS = """
import sys
from deltaph.telemetry import Publisher
from integration.synthetic_cell import frames
publisher = Publisher(sys.argv[1], "{}", listen=[sys.argv[2]])
publisher.wait_for_subscribers(1, 20.0)
for frame in frames(10):
    publisher.take(frame)
print("published", flush=True)
sys.stdin.read()
"""


COUNTING_CELL = """
import sys, threading, time
from deltaph.telemetry import Publisher
from deltaph.telemetry.session import open_client_session

publisher = Publisher("cell1", "{}", listen=[sys.argv[1]])
changes, end = [], time.monotonic() + 2.0

def come_and_go(name):
    with open_client_session(publisher.endpoints) as session:
        session.declare_subscriber("deltaph/cell1/*", lambda _: None)
        while time.monotonic() < end:
            session.declare_subscriber(f"deltaph/cell1/{name}/{len(changes)}", lambda _: None).undeclare()
            changes.append(name)

threads = [threading.Thread(target=come_and_go, args=(name,)) for name in ("a", "b")]
for thread in threads:
    thread.start()
counts = 0
while time.monotonic() < end:
    publisher.subscribers()
    counts += 1
for thread in threads:
    thread.join()
publisher.close()
print(len(changes), counts)
"""


TALLYING_READER = """
import json, sys
from pathlib import Path
from deltaph.telemetry import Subscriber
endpoint, cell, config = sys.argv[1:]
sequences = {}
with Subscriber(cell, [endpoint], config=Path(config)) as subscriber:
    subscriber.wait_for_cell()
    for name, record in subscriber.messages():
        if not sequences:
            print("streaming", flush=True)
        sequences.setdefault(name, []).append(int(record["sequence"]))
print(json.dumps({"sequences": sequences, "missing": subscriber.missing, "summary": subscriber.summary}))
"""


def publish_in_real_time(publisher: Sink, offered: list[Frame]) -> None:
    begin = time.perf_counter()
    for frame in offered:
        time.sleep(max(0.0, begin + frame.time - time.perf_counter()))
        publisher.take(frame)


@contextmanager
def cell(scenario: str = '{"title": "a test"}', history: int = HISTORY) -> Iterator[Publisher]:
    publisher = Publisher(CELL, scenario, listen=[free_endpoint()], history=history)
    try:
        yield publisher
    finally:
        publisher.close()


@contextmanager
def following(publisher: Publisher) -> Iterator[tuple[Subscriber, Callable[[], list[Message]]]]:
    """A subscriber that reads in a thread, and a function that waits for its end and gives what it read."""
    messages: list[Message] = []
    with Subscriber(CELL, publisher.endpoints, timeout=DEADLINE) as subscriber:
        subscriber.wait_for_cell(DEADLINE)
        reader = threading.Thread(target=lambda: messages.extend(subscriber.messages()), daemon=True)
        reader.start()
        publisher.wait_for_subscribers(1, DEADLINE)

        def read() -> list[Message]:
            reader.join(DEADLINE)
            assert not reader.is_alive()
            return messages

        yield subscriber, read


def test_foreign_reader_decodes_every_message_at_1_khz() -> None:
    offered = frames(1000)
    with SinkProcess("publisher", partial(Publisher, CELL, "{}", listen=[free_endpoint()]), len(offered)) as sink:
        (endpoint,) = sink.ask(attrgetter("endpoints"))
        command = [sys.executable, "-c", FOREIGN_READER, endpoint, f"deltaph/{CELL}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as reader:
            sink.ask(methodcaller("wait_for_subscribers", 1, DEADLINE))
            publish_in_real_time(sink, offered)
            sink.tell(methodcaller("set_summary", "{}"))
            published = sink.ask(attrgetter("published"))
            sink.close()
            output, _ = reader.communicate(timeout=DEADLINE)
    assert reader.returncode == 0
    read = json.loads(output)
    assert read["complete"], "the token's end or the summary did not come"
    assert (published, sink.dropped) == (len(offered), 0)
    for name in ("setpoint", "actual", "timing"):
        assert read["messages"][name] == [{"sequence": frame.step, **values_of(frame)[name]} for frame in offered]
    assert read["messages"]["plan"] == [{"sequence": 0, **values_of(offered[0])["plan"]}]


def test_plain_client_works_where_there_is_no_deltaph(tmp_path: Path) -> None:
    client = tmp_path / "client.py"
    shutil.copy(PLAIN_CLIENT, client)
    (tmp_path / "deltaph.py").write_text("raise ImportError('the client must not need it')", encoding="utf-8")
    offered = frames(200)
    with cell() as publisher:
        command = [sys.executable, str(client), publisher.endpoints[0], CELL]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as reader:
            publisher.wait_for_subscribers(1, DEADLINE)
            publish_in_real_time(publisher, [*offered[:100], *offered[102:]])
            publisher.set_summary("{}")
            publisher.close()
            output, _ = reader.communicate(timeout=DEADLINE)
    assert reader.returncode == 0
    lines = output.splitlines()
    joints = [values_of(offered[0])["setpoint"][f"joint[{i}].position"] for i in (1, 2, 3)]
    assert lines[0] == "0.000 s " + " ".join(f"{joint:.6f}" for joint in joints) + " rad"
    assert {"setpoint: 198 received, 2 missing", "actual: 198 received, 2 missing", "plan: 1 received, 0 missing"} <= set(lines)


def test_subscriber_gets_messages_documents_and_the_end() -> None:
    offered = frames(20)
    with cell() as publisher, following(publisher) as (subscriber, read):
        assert subscriber.ask("scenario") == {"title": "a test"}
        assert subscriber.ask("schema") == schema_document()
        with pytest.raises(EnvironmentProblem, match="there is no summary yet"):
            subscriber.ask("summary")
        for frame in offered:
            publisher.take(frame)
        publisher.set_summary('{"verdict": "kept"}')
        assert subscriber.ask("summary") == {"verdict": "kept"}
        publisher.close()
        messages = read()
        assert subscriber.summary == {"verdict": "kept"}
        assert subscriber.received == {"setpoint": 20, "actual": 20, "timing": 20, "plan": 1, "event": 2}
        assert set(subscriber.missing.values()) == {0}
    for name in ("setpoint", "actual", "timing"):
        records = [message.record for message in messages if message.name == name]
        assert [layout(name).as_dict(record) for record in records] == [
            {"sequence": frame.step, **values_of(frame)[name]} for frame in offered
        ]


def test_summary_that_the_end_of_the_token_overtook_is_waited_for() -> None:
    """As on a busy machine, where what was sent before the token went arrives a good while after."""
    with cell() as publisher, following(publisher) as (subscriber, read):
        publisher.set_summary('{"verdict": "kept"}')
        publisher._token.undeclare()  # type: ignore[no-untyped-call]
        wait_until(lambda: subscriber._gone is not None and time.monotonic() > subscriber._gone + 3.0 * _QUIET)
        publisher.close()
        read()
        assert subscriber.summary == {"verdict": "kept"}


def test_plan_is_published_when_one_is_decided_and_kept_for_newcomers() -> None:
    offered = frames(6)
    decisions = [(0, 0, 0), (1, 0, 0), (1, 0, 0), (1, 2, 0), (2, 2, 0), (2, 2, 1)]  # count, refused, cancelled: four changes
    names = [field.name for field in layout("plan").fields if field.type == "int32"]
    for frame, decided in zip(offered, decisions, strict=True):
        for output, value in zip(("plan.count", "plan.refused", "plan.cancelled"), decided, strict=True):
            frame.planner_integers[1 + names.index(output)] = value
    with cell() as publisher, following(publisher) as (subscriber, read):
        with pytest.raises(EnvironmentProblem, match="there is no plan yet"):
            subscriber.ask("plan")
        for frame in offered:
            publisher.take(frame)
        last = layout("plan").encode(offered[5], sequence=3)
        assert subscriber.ask("plan").tobytes() == last
        publisher.close()
        plans = [message.record for message in read() if message.name == "plan"]
    assert [(r["sequence"], r["time"], r["plan.count"], r["plan.refused"], r["plan.cancelled"]) for r in plans] == [
        (0, offered[1].time, 1, 0, 0),
        (1, offered[3].time, 1, 2, 0),
        (2, offered[4].time, 2, 2, 0),
        (3, offered[5].time, 2, 2, 1),
    ]
    assert plans[-1].tobytes() == last


def test_lost_frames_show_as_gaps() -> None:
    offered = frames(10)
    with cell() as publisher, following(publisher) as (subscriber, read):
        for frame in (*offered[:3], *offered[5:8], offered[9]):
            publisher.take(frame)
        publisher.close()
        events = [message.record for message in read() if message.name == "event"]
        assert subscriber.missing == {"setpoint": 3, "actual": 3, "timing": 3, "plan": 0, "event": 0}
    kinds = [EVENT_KINDS[record["kind"]] for record in events]
    assert kinds == ["plan_accepted", "phase", "dropped", "dropped"]
    assert [int(record["count"]) for record in events[2:]] == [2, 1]
    assert [int(record["sequence"]) for record in events] == [0, 1, 2, 3]


def test_who_comes_late_gets_what_was_before_and_then_what_comes_in_order_and_once() -> None:
    offered = frames(3000)
    with cell() as publisher:
        streaming = threading.Thread(target=publish_in_real_time, args=(publisher, offered))
        streaming.start()
        wait_until(lambda: publisher.published > 1000)
        with following(publisher) as (subscriber, read):
            joined = publisher.published
            streaming.join()
            publisher.set_summary("{}")
            publisher.close()
            messages = read()
    assert joined < len(offered), "it did not come while messages were sent"
    for name in ("setpoint", "actual", "timing"):
        assert [int(m.record["sequence"]) for m in messages if m.name == name] == list(range(len(offered)))
    assert [int(m.record["sequence"]) for m in messages if m.name == "plan"] == [0]
    assert set(subscriber.missing.values()) == {0}


def test_the_past_is_what_the_cell_keeps_or_as_much_as_is_asked_for() -> None:
    offered = frames(100)
    with cell(history=20) as publisher:
        for frame in offered[:60]:
            publisher.take(frame)
        for wanted, first in ((None, 40), (5, 55), (0, 60)):
            with Subscriber(CELL, publisher.endpoints, timeout=DEADLINE, history=wanted) as subscriber:
                subscriber.wait_for_cell(DEADLINE)
                publisher.wait_for_subscribers(1, DEADLINE)
                before = subscriber.collect(0.5)["setpoint"]["sequence"].tolist()
                assert before == list(range(first, 60))
                if wanted == 0:
                    publisher.take(offered[60])
                    assert next(subscriber.messages()).record["sequence"] == 60
                assert set(subscriber.missing.values()) == {0}


def test_zenohs_own_advanced_subscriber_gets_the_history() -> None:
    offered = frames(50)
    numbers: list[int] = []

    def take(sample: zenoh.Sample) -> None:
        numbers.append(int(layout("setpoint").decode(sample.payload.to_bytes())["sequence"]))

    with cell() as publisher, open_client_session(publisher.endpoints, DEADLINE) as session:
        for frame in offered[:40]:
            publisher.take(frame)
        history = ext.HistoryConfig(max_samples=10)
        advanced = ext.declare_advanced_subscriber(session, f"deltaph/{CELL}/setpoint", take, history=history)
        publisher.wait_for_subscribers(1, DEADLINE)
        wait_until(lambda: len(numbers) == 10)
        for frame in offered[40:]:
            publisher.take(frame)
        wait_until(lambda: len(numbers) == 20)
        advanced.undeclare()
    assert numbers == list(range(30, 50))


@pytest.mark.parametrize("history", [HISTORY, 500])
def test_who_was_stopped_gets_what_is_kept_and_counts_the_rest(tmp_path: Path, history: int) -> None:
    config = tmp_path / "lease.json5"  # who is silent for so long is given up, and what was on its way to him is lost [ms]
    config.write_text("{ transport: { link: { tx: { lease: 1000 } } } }", encoding="utf-8")
    offered = [replaced(frame, step=n, time=1e-3 * n) for n, frame in enumerate(frames(1000) * 8)]
    command = [sys.executable, "-P", "-c", TALLYING_READER]
    with cell(history=history) as publisher, ExitStack() as stack:
        arguments = [*command, publisher.endpoints[0], CELL, str(config)]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        reader = stack.enter_context(subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True, env=environment))
        stack.callback(reader.kill)
        assert reader.stdout is not None
        publisher.wait_for_subscribers(1, DEADLINE)
        streaming = threading.Thread(target=publish_in_real_time, args=(publisher, offered))
        streaming.start()
        stack.callback(streaming.join)
        assert reader.stdout.readline() == "streaming\n"
        reader.send_signal(signal.SIGSTOP)
        wait_until(lambda: publisher.subscribers() == 0)
        given_up = publisher.published
        wait_until(lambda: publisher.published > given_up + 1000)
        reader.send_signal(signal.SIGCONT)
        publisher.wait_for_subscribers(1, DEADLINE)
        assert publisher.published < len(offered), "it was not back before the end"
        streaming.join()
        publisher.set_summary("{}")
        publisher.close()
        output, _ = reader.communicate(timeout=DEADLINE)
    got = json.loads(output)
    assert got["summary"] == {}
    for name in ("setpoint", "actual", "timing"):
        sequences = got["sequences"][name]
        assert sequences == sorted(set(sequences))
        assert (sequences[0], sequences[-1]) == (0, len(offered) - 1)
        assert got["missing"][name] == len(offered) - len(sequences)
        assert (got["missing"][name] == 0) == (history == HISTORY)


def test_what_is_lost_at_the_very_end_is_counted() -> None:
    with cell(history=1) as publisher, following(publisher) as (subscriber, read):
        for frame in frames(10):
            publisher.take(frame)
        publisher._last_step += 3  # as if three more had been sent
        publisher.set_summary("{}")
        publisher.close()
        read()
        assert list(subscriber.messages()) == []  # what is counted is counted once
    assert subscriber.missing == {"setpoint": 3, "actual": 3, "timing": 3, "plan": 0, "event": 0}


def test_what_is_lost_at_the_very_end_comes_back_where_it_is_kept() -> None:
    """No message that comes later tells of the gap: the summary does."""
    offered = frames(20)
    with cell() as publisher, following(publisher) as (subscriber, read):
        for frame in offered[:10]:
            publisher.take(frame)
        wait_until(lambda: subscriber.received["timing"] == 10)
        subscriber._subscription.undeclare()  # type: ignore[no-untyped-call]
        wait_until(lambda: publisher.subscribers() == 0)
        for frame in offered[10:]:
            publisher.take(frame)
        subscriber._subscription = subscriber._session.declare_subscriber(subscriber._keys.everything, subscriber._samples.put)
        publisher.wait_for_subscribers(1, DEADLINE)
        publisher.set_summary("{}")
        publisher.close()
        sequences = [int(message.record["sequence"]) for message in read() if message.name == "actual"]
    assert sequences == list(range(20))
    assert set(subscriber.missing.values()) == {0}


def test_reading_in_slices_goes_on_where_it_ended_and_ends_with_the_cell() -> None:
    offered = frames(300)
    with cell() as publisher, Subscriber(CELL, publisher.endpoints, timeout=DEADLINE) as subscriber:
        subscriber.wait_for_cell(DEADLINE)
        publisher.wait_for_subscribers(1, DEADLINE)
        streaming = threading.Thread(target=publish_in_real_time, args=(publisher, offered))
        streaming.start()
        slices = [subscriber.collect(0.05)["actual"] for _ in range(4)]
        streaming.join()
        publisher.set_summary("{}")
        publisher.close()
        wait_until(lambda: bool(slices.append(subscriber.collect(0.001)["actual"]) or subscriber.summary is not None))
        slices.append(subscriber.collect()["actual"])
        assert len(subscriber.collect()["actual"]) == 0  # it has ended, and says so at once
        assert set(subscriber.missing.values()) == {0}
    assert sum(len(part) > 0 for part in slices) > 2
    assert np.concatenate(slices)["sequence"].tolist() == list(range(len(offered)))


def test_cell_of_the_same_name_is_refused() -> None:
    with cell() as publisher:
        with pytest.raises(EnvironmentProblem, match=f"a cell {CELL} is there already: give this one another name with --cell"):
            Publisher(CELL, "{}", listen=[free_endpoint()], connect=publisher.endpoints)
        Publisher("another", "{}", listen=[free_endpoint()], connect=publisher.endpoints).close()
    with cell():  # who has gone is not in the way
        pass


def test_messages_are_collected_as_arrays() -> None:
    offered = frames(50)
    with cell() as publisher, Subscriber(CELL, publisher.endpoints, timeout=DEADLINE) as subscriber:
        subscriber.wait_for_cell(DEADLINE)
        publisher.wait_for_subscribers(1, DEADLINE)
        for frame in offered:
            publisher.take(frame)
        publisher.set_summary("{}")
        publisher.close()
        got = subscriber.collect()
    for name in ("setpoint", "actual", "timing"):
        assert got[name].tobytes() == layout(name).records(offered).tobytes()
    assert got["actual"]["joint[1].position"].shape == (50,)


def test_killed_cell_ends_the_messages() -> None:
    endpoint = free_endpoint()
    with subprocess.Popen(
        [sys.executable, "-P", "-c", CELL_PROCESS, CELL, endpoint],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as process:
        messages: list[Message] = []
        with Subscriber(CELL, [endpoint], timeout=DEADLINE) as subscriber:
            subscriber.wait_for_cell(DEADLINE)
            reader = threading.Thread(target=lambda: messages.extend(subscriber.messages()), daemon=True)
            reader.start()
            assert process.stdout is not None
            assert process.stdout.readline() == b"published\n"
            process.send_signal(signal.SIGKILL)
            reader.join(DEADLINE)
            assert not reader.is_alive()
            assert subscriber.summary is None


def test_endpoint_that_was_asked_for_and_is_taken_is_an_error() -> None:
    with cell() as publisher, pytest.raises(EnvironmentProblem) as problem:
        Publisher(CELL, "{}", listen=publisher.endpoints)
    assert str(problem.value) == f"cannot listen on {publisher.endpoints[0]}: address already in use"


def test_default_endpoint_that_is_taken_gives_way_to_a_free_port() -> None:
    first = Publisher(CELL, "{}")  # on the default endpoint, unless a cell of somebody else is there already
    second = Publisher("another", "{}")
    try:
        (endpoint,) = second.endpoints
        assert endpoint != DEFAULT_ENDPOINT
        assert endpoint.startswith("tcp/127.0.0.1:")
        with Subscriber("another", second.endpoints, timeout=DEADLINE) as subscriber:
            subscriber.wait_for_cell(DEADLINE)
    finally:
        first.close()
        second.close()


@pytest.mark.parametrize("endpoint", ["nonsense", "tpc/127.0.0.1:7447", "tcp/"])
def test_what_is_no_endpoint_is_named(endpoint: str) -> None:
    with pytest.raises(EnvironmentProblem, match=f"'{endpoint}' is not a Zenoh endpoint: write it like tcp/"):
        Publisher(CELL, "{}", connect=[endpoint])
    with pytest.raises(EnvironmentProblem, match="is not a Zenoh endpoint"):
        Subscriber(CELL, [endpoint])


def test_sessions_are_counted_once_one_of_them_subscribes_to_whatever_it_is() -> None:
    with cell() as publisher:
        with pytest.raises(EnvironmentProblem, match=r"0 of 1 Zenoh subscribers came within 0\.05 s"):
            publisher.wait_for_subscribers(1, 0.05)
        with open_client_session(publisher.endpoints, DEADLINE) as connected:
            connected.declare_subscriber("deltaph/another/setpoint", lambda _: None)
            with pytest.raises(EnvironmentProblem, match="0 of 1 "):
                publisher.wait_for_subscribers(1, 0.5)
            for key in ("deltaph/**", f"deltaph/{CELL}/timing"):
                subscription = connected.declare_subscriber(key, lambda _: None)
                publisher.wait_for_subscribers(1, DEADLINE)
                assert publisher.subscribers() == 1
                subscription.undeclare()  # type: ignore[no-untyped-call]
                wait_until(lambda: publisher.subscribers() == 0)
            connected.declare_subscriber(f"deltaph/{CELL}/*", lambda _: None)
            with pytest.raises(EnvironmentProblem, match="1 of 2 "):
                publisher.wait_for_subscribers(2, 0.5)
            with open_client_session(publisher.endpoints, DEADLINE) as other:
                other.declare_subscriber(f"deltaph/{CELL}/timing", lambda _: None)
                publisher.wait_for_subscribers(2, DEADLINE)
            wait_until(lambda: publisher.subscribers() == 1)


def test_subscribers_that_come_and_go_do_not_stop_a_cell_that_counts_them() -> None:
    """A query of Zenoh's administration space meanwhile did, within a second."""
    command = [sys.executable, "-P", "-c", COUNTING_CELL, free_endpoint()]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    counting = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert counting.returncode == 0, counting.stderr
    changes, counts = map(int, counting.stdout.split())
    assert changes > 100
    assert counts > 100


def test_strangers_learn_nothing_of_a_cell_from_zenohs_administration_space() -> None:
    with cell() as publisher, open_client_session(publisher.endpoints, DEADLINE) as session:
        assert replies(session, f"deltaph/{CELL}/schema", 2.0)
        assert replies(session, f"@/{publisher.session.zid()}/**", 2.0) == []


def test_publisher_that_comes_while_a_subscriber_closes_is_no_error() -> None:
    with cell() as publisher:
        subscriber = Subscriber(CELL, publisher.endpoints, timeout=DEADLINE)
        subscriber.close()
        token = f"deltaph/{CELL}/setpoint/@adv/pub/{publisher.session.zid()}/99/_"
        subscriber._on_publisher(SimpleNamespace(key_expr=token, kind=zenoh.SampleKind.PUT))  # type: ignore[arg-type]


def test_nobody_there_is_said_in_time() -> None:
    endpoint = free_endpoint()
    with pytest.raises(EnvironmentProblem, match=f"nothing answers on {endpoint} within"):
        Subscriber(CELL, [endpoint], timeout=0.2)
    with (
        cell() as publisher,
        Subscriber("missing", publisher.endpoints, timeout=DEADLINE) as subscriber,
        pytest.raises(EnvironmentProblem, match=r"cell missing did not appear within 0\.2 s"),
    ):
        subscriber.wait_for_cell(0.2)


def test_messages_of_another_version_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deltaph.telemetry.publisher.schema_document", lambda: {"messages": {}})
    with (
        cell() as publisher,
        Subscriber(CELL, publisher.endpoints, timeout=DEADLINE) as subscriber,
        pytest.raises(EnvironmentProblem, match="not this version's"),
    ):
        subscriber.wait_for_cell(DEADLINE)
