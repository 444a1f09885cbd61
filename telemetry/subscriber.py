"""Follows a cell from another process."""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import zenoh

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.keys import MESSAGE_NAMES, CellKeys, MessageName, QueryName
from deltaph.telemetry.messages import Layout, Records, layout, schema_document
from deltaph.telemetry.order import Order
from deltaph.telemetry.session import open_client_session, replies

_ANSWER_TIMEOUT = 2.0  # [s]
_KEPT_TIMEOUT = 10.0  # for the messages that the publisher kept: there may be many [s]
_QUIET = 0.5  # the end of the token may overtake messages; those that are under way are here by then [s]
_LATE = 5.0  # the summary has this long to come after the token went, which overtakes it: a busy machine sends late [s]
_RETURN = 10.0  # a connection that was lost has this long to come back, as when a router restarts [s]


class Message(NamedTuple):
    """A decoded message.

    Attributes:
        name: last chunk of its key.
        record: its fields by name, of the dtype of `layout(name)`.
    """

    name: MessageName
    record: np.void


class _Stream:
    """The messages of one kind from one publisher: a cell that starts again has others.

    Attributes:
        layout: of the messages.
        kept: where the publisher answers with what it keeps.
        order: puts them in order.
        query: number of the query that it waits for, and when to give it up; None where it waits for none.
        newest: last sequence number that was passed on.
        asked_for_rest: whether it has been asked for what the summary says to be missing at the end.
    """

    def __init__(self, subscriber: Subscriber, message: Layout, kept: str) -> None:
        self.layout = message
        self.kept = kept
        self.order = Order(lambda first, last: subscriber._ask(self, first, last))
        self.query: tuple[int, float] | None = None
        self.newest: int | None = None
        self.asked_for_rest = False


class _Answered(NamedTuple):
    """A query for what was kept has ended."""

    stream: _Stream
    query: int


class Subscriber:
    """A client of one cell; subscribed from the start, so that nothing is missed between finding the cell and reading its messages.

    What the cell sent before, as far back as it keeps it, comes first; what is lost on the way is asked for again. The messages of
    each kind come in order and once.

    Zenoh's own advanced subscriber is not used: with `history` and `recovery` together it dropped the history in 8 of 12 trials at
    1 kHz (eclipse-zenoh 1.10.2), as messages that come in meanwhile start a second query whose end is taken for that of both. The
    cell's publishers are Zenoh's advanced ones, and what they keep is asked for here.

    Attributes:
        received: messages so far, by name.
        missing: messages lost so far, by name: the gaps in the sequence numbers that remain when nobody has the messages any more.

    Args:
        cell: name of the cell.
        connect: endpoints to connect to, the first that answers is taken; without any those of the configuration file, or the
            default one.
        timeout: for the connection [s]; None waits for ever.
        config: a Zenoh configuration file; see `deltaph zenoh-config`.
        history: messages of each kind from before; None is all that the cell keeps, 0 none.

    Raises:
        ValueError: the cell's name does not fit into a key.
        EnvironmentProblem: nothing answers, an endpoint is none, or the file is no configuration.
    """

    def __init__(
        self,
        cell: str,
        connect: Sequence[str] = (),
        timeout: float | None = None,
        *,
        config: Path | None = None,
        history: int | None = None,
    ) -> None:
        self._keys = CellKeys(cell)
        self._history = history
        self.received: dict[MessageName, int] = dict.fromkeys(MESSAGE_NAMES, 0)
        self.missing: dict[MessageName, int] = dict.fromkeys(MESSAGE_NAMES, 0)
        self._layouts: dict[str, Layout] = {self._keys.of(name): layout(name) for name in MESSAGE_NAMES}
        self._streams: dict[tuple[str, str, int], _Stream] = {}
        self._opening = threading.Lock()  # of a stream: by Zenoh's thread or by the reader's, whoever hears of it first
        self._queries = itertools.count()
        self._samples: SimpleQueue[zenoh.Sample | _Answered] = SimpleQueue()
        self._alive = threading.Event()
        self._gone: float | None = None  # when the cell's token went
        self._summary: dict[str, Any] | None = None
        self._last: dict[MessageName, int] = {}  # sequence numbers, that the summary tells
        self._session = open_client_session(connect, timeout, config)
        self._subscription = self._session.declare_subscriber(self._keys.everything, self._samples.put)
        liveliness = self._session.liveliness()
        self._publishers = liveliness.declare_subscriber(self._keys.publishers, self._on_publisher, history=True)
        self._liveliness = liveliness.declare_subscriber(self._keys.token, self._on_token, history=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def wait_for_cell(self, timeout: float | None = None) -> None:
        """Wait until the cell lives.

        Args:
            timeout: [s]; None waits for ever.

        Raises:
            EnvironmentProblem: it does not come in time, or its messages are not laid out as this version's.
        """
        if not self._alive.wait(timeout):
            raise EnvironmentProblem(f"cell {self._keys.cell} did not appear within {timeout:g} s")
        if self.ask("schema").get("messages") != schema_document()["messages"]:
            raise EnvironmentProblem(
                f"the messages of cell {self._keys.cell} are not this version's: use the same deltaph on both sides"
            )

    def ask(self, name: QueryName) -> Any:
        """What a queryable of the cell answers: the parsed JSON, or for `plan` the record of the last plan.

        Raises:
            EnvironmentProblem: no answer, such as for a summary before the end.
        """
        key = self._keys.of(name)
        reason = "no answer"
        for reply in replies(self._session, key, _ANSWER_TIMEOUT):
            if reply.ok is not None:
                return (
                    self._layouts[key].decode(reply.ok.payload.to_bytes())
                    if name == "plan"
                    else json.loads(reply.ok.payload.to_bytes())
                )
            if reply.err is not None:
                reason = reply.err.payload.to_string()
        raise EnvironmentProblem(f"cell {self._keys.cell} does not tell its {name}: {reason}")

    @property
    def summary(self) -> dict[str, Any] | None:
        """What the cell sent at its end; None before, and where it ended without one."""
        return self._summary

    def messages(self, seconds: float | None = None) -> Iterator[Message]:
        """The messages as they come; ends when the cell has gone and all that it sent is here.

        A connection that is lost is made again, and what was sent meanwhile is asked for; where it stays away for 10 s, that is the
        end. A cell that goes without a summary is waited for 5 s longer: the summary, its last message, may be late.

        Args:
            seconds: end after so long in any case; None does not. The next call goes on where this one ended.
        """
        end = None if seconds is None else time.monotonic() + seconds
        while end is None or time.monotonic() < end:
            if self._last:
                self._ask_for_the_rest()
            asking = [stream for stream in list(self._streams.values()) if stream.query is not None]
            yield from self._give_up(asking)
            if self._gone is not None and self._summary is not None and not asking and self._samples.empty():
                break  # the summary is the last message
            try:
                sample = self._samples.get(timeout=self._patience(end, waiting=self._gone is not None or bool(asking)))
            except Empty:
                if self._gone is not None and not asking:
                    more = _LATE if self._connected() else _RETURN  # only a connection that lives can still bring the summary
                    if time.monotonic() > self._gone + more:
                        break
                continue
            if isinstance(sample, _Answered):
                if sample.stream.query is not None and sample.stream.query[0] == sample.query:
                    sample.stream.query = None
                    yield from self._passed_on(sample.stream, sample.stream.order.answered())
                continue
            key = str(sample.key_expr)
            if key in self._layouts:
                stream, number = self._stream_of(key, sample)
                yield from self._passed_on(stream, stream.order.take(number, sample.payload.to_bytes()))
            elif key == self._keys.token:
                self._gone = None if sample.kind == zenoh.SampleKind.PUT else time.monotonic()
            elif key == self._keys.of("summary"):
                self._summary = json.loads(sample.payload.to_bytes())
                self._last = json.loads(sample.attachment.to_bytes()) if sample.attachment is not None else {}
            elif sample.kind == zenoh.SampleKind.PUT:  # a publisher is there again after a connection was lost
                self._stream(*self._source(key)).order.catch_up()
        else:
            return
        for stream in self._streams.values():
            yield from self._passed_on(stream, stream.order.rest())
        for stream, last in self._unfinished():
            if stream.newest is not None:
                self.missing[stream.layout.key] += last - stream.newest
                stream.newest = last

    def collect(self, seconds: float | None = None) -> dict[MessageName, Records]:
        """The messages as arrays, until the cell ends or for so long: by name, structured (n,), with the fields of the layout.

        Example: `plt.plot(got["actual"]["time"], got["actual"]["joint[1].tracking_error"])`.

        Args:
            seconds: how long at most; None waits for the end of the cell.
        """
        payloads: dict[MessageName, list[bytes]] = {name: [] for name in MESSAGE_NAMES}
        for name, record in self.messages(seconds):
            payloads[name].append(record.tobytes())
        return {name: np.frombuffer(b"".join(found), layout(name).dtype) for name, found in payloads.items()}

    def close(self) -> None:
        """Close the session. A second call does nothing."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]

    def _on_token(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._alive.set()
        self._samples.put(sample)

    def _on_publisher(self, sample: zenoh.Sample) -> None:
        """Ask a new publisher for what it keeps at once, whenever somebody reads: it may soon be gone."""
        source = self._source(str(sample.key_expr))
        if source[0] not in self._layouts:
            return
        if source in self._streams:
            self._samples.put(sample)
        elif sample.kind == zenoh.SampleKind.PUT:
            self._stream(*source)

    def _connected(self) -> bool:
        return bool(self._session.info.routers_zid() or self._session.info.peers_zid())

    @staticmethod
    def _patience(end: float | None, *, waiting: bool) -> float | None:
        """How long to wait for the next sample [s]; None is for ever."""
        left = None if end is None else max(end - time.monotonic(), 0.0)
        if waiting:
            return _QUIET if left is None else min(left, _QUIET)
        return left

    def _stream_of(self, key: str, sample: zenoh.Sample) -> tuple[_Stream, int]:
        """The stream that a message belongs to, and its number there."""
        source = sample.source_info
        if source is None:
            raise EnvironmentProblem(f"a message on {key} does not come from a cell of this version: it has no number")
        return self._stream(key, str(source.source_id.zid), source.source_id.eid), source.source_sn

    def _stream(self, key: str, session: str, entity: int) -> _Stream:
        with self._opening:
            if (found := self._streams.get((key, session, entity))) is None:
                message = self._layouts[key]
                found = _Stream(self, message, self._keys.kept(message.key, session, entity))
                found.order.catch_up()
                self._streams[key, session, entity] = found
        return found

    @staticmethod
    def _source(token: str) -> tuple[str, str, int]:
        """Key, session and entity of a publisher, from its token."""
        key, _, rest = token.partition("/@adv/pub/")
        session, _, entity = rest.partition("/")
        return key, session, int(entity.partition("/")[0])

    def _ask_for_the_rest(self) -> None:
        """What was lost at the end shows in the summary alone, as no later message tells of a gap; the cell waits for this."""
        for stream, _ in self._unfinished():
            if stream.query is None and not stream.asked_for_rest:
                stream.asked_for_rest = True
                stream.order.catch_up()

    def _unfinished(self) -> list[tuple[_Stream, int]]:
        """The streams whose end is not here, with the number of their last message, which the summary tells."""
        newest = {stream.layout.key: stream for stream in self._streams.values()}  # of a kind: the last that opened
        ends = [(stream, self._last.get(name, -1)) for name, stream in newest.items()]
        return [(stream, last) for stream, last in ends if last > (-1 if stream.newest is None else stream.newest)]

    def _ask(self, stream: _Stream, first: int | None, last: int | None) -> None:
        """Ask for messages that a publisher kept; what comes, and that nothing more comes, goes where the messages go."""
        number = next(self._queries)
        stream.query = number, time.monotonic() + _KEPT_TIMEOUT + _QUIET
        answered = _Answered(stream, number)
        if first is not None:
            which = f"_sn={first}..{'' if last is None else last}"
        elif self._history is None:
            which = "_sn=0.."
        elif self._history:
            which = f"_max={self._history}"
        else:
            self._samples.put(answered)
            return

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._samples.put(reply.ok)

        try:
            self._session.get(
                f"{stream.kept}?{which}",
                zenoh.handlers.Callback(take, lambda: self._samples.put(answered)),
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=_KEPT_TIMEOUT,
            )
        except zenoh.ZError:
            if not self._session.is_closed():  # by `close`, while a publisher came: nobody reads any more
                raise

    def _give_up(self, asking: Sequence[_Stream]) -> Iterator[Message]:
        """End queries whose end did not come in time."""
        for stream in asking:
            if stream.query is not None and time.monotonic() > stream.query[1]:
                stream.query = None
                yield from self._passed_on(stream, stream.order.answered())

    def _passed_on(self, stream: _Stream, payloads: Iterator[bytes]) -> Iterator[Message]:
        name = stream.layout.key
        for payload in payloads:
            record = stream.layout.decode(payload)
            sequence = int(record["sequence"])
            if stream.newest is not None:
                self.missing[name] += max(sequence - stream.newest - 1, 0)
            stream.newest = sequence
            self.received[name] += 1
            yield Message(name, record)
