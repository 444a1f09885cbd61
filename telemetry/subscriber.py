"""Follows a cell from another process."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator, Sequence
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import zenoh

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.keys import MESSAGE_NAMES, CellKeys, MessageName, QueryName
from deltaph.telemetry.messages import Layout, layout, schema_document
from deltaph.telemetry.session import DEFAULT_ENDPOINT, open_client_session, replies

_ANSWER_TIMEOUT = 2.0  # [s]
_QUIET = 0.5  # the end of the token may overtake messages; those that are under way are here by then [s]
_RETURN = 10.0  # a connection that was lost has this long to come back, as when a router restarts [s]


class Message(NamedTuple):
    """A decoded message.

    Attributes:
        name: last chunk of its key.
        record: its fields by name, of the dtype of `layout(name)`.
    """

    name: MessageName
    record: np.void


class Subscriber:
    """A client of one cell; subscribed from the start, so that nothing is missed between finding the cell and reading its messages.

    Attributes:
        received: messages so far, by name.
        missing: messages lost so far, by name: the gaps in the sequence numbers.

    Args:
        cell: name of the cell.
        connect: endpoints to connect to; the first that answers is taken.
        timeout: for the connection [s]; None waits for ever.

    Raises:
        ValueError: the cell's name does not fit into a key.
        EnvironmentProblem: nothing answers, or an endpoint is none.
    """

    def __init__(self, cell: str, connect: Sequence[str] = (DEFAULT_ENDPOINT,), timeout: float | None = None) -> None:
        self._keys = CellKeys(cell)
        self.received: dict[MessageName, int] = dict.fromkeys(MESSAGE_NAMES, 0)
        self.missing: dict[MessageName, int] = dict.fromkeys(MESSAGE_NAMES, 0)
        self._newest: dict[MessageName, int] = {}
        self._layouts: dict[str, Layout] = {self._keys.of(name): layout(name) for name in MESSAGE_NAMES}
        self._samples: SimpleQueue[zenoh.Sample] = SimpleQueue()
        self._alive = threading.Event()
        self._summary: dict[str, Any] | None = None
        self._session = open_client_session(connect, timeout)
        self._subscription = self._session.declare_subscriber(self._keys.everything, self._samples.put)
        self._liveliness = self._session.liveliness().declare_subscriber(self._keys.token, self._on_token, history=True)

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

    def messages(self) -> Iterator[Message]:
        """The messages as they come; ends when the cell has gone and all that it sent is here.

        A connection that is lost is made again, and what was sent meanwhile is missing; the end comes where it stays away for 10 s.
        """
        gone: float | None = None
        while True:
            try:
                sample = self._samples.get(timeout=None if gone is None else _QUIET)
            except Empty:
                if gone is None or self._connected() or time.monotonic() > gone + _RETURN:
                    return
                continue
            key = str(sample.key_expr)
            if key in self._layouts:
                yield self._message(self._layouts[key], sample.payload.to_bytes())
            elif key == self._keys.token:
                gone = None if sample.kind == zenoh.SampleKind.PUT else time.monotonic()
            elif key == self._keys.of("summary"):
                self._summary = json.loads(sample.payload.to_bytes())
            if gone is not None and self._summary is not None:  # the summary is the last message, and messages keep their order
                return

    def close(self) -> None:
        """Close the session. A second call does nothing."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]

    def _on_token(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._alive.set()
        self._samples.put(sample)

    def _connected(self) -> bool:
        return bool(self._session.info.routers_zid() or self._session.info.peers_zid())

    def _message(self, message: Layout, payload: bytes) -> Message:
        record = message.decode(payload)
        sequence = int(record["sequence"])
        self.missing[message.key] += max(sequence - self._newest.get(message.key, sequence - 1) - 1, 0)
        self._newest[message.key] = sequence
        self.received[message.key] += 1
        return Message(message.key, record)
