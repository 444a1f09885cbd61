"""Follows a cell from another process."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

import numpy as np
import zenoh

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.keys import MESSAGE_NAMES, CellKeys, MessageName, QueryName
from deltaph.telemetry.messages import Layout, layout, schema_document
from deltaph.telemetry.session import DEFAULT_ENDPOINT, open_client_session

_POLL = 0.1  # how long a wait without a deadline stays deaf to Ctrl-C [s]
_LAST_WORDS = 1.0  # the token's end may overtake messages, which come in order and end with the summary [s]
_ASK = 2.0  # for an answer [s]


class Message(NamedTuple):
    """A decoded message.

    Attributes:
        name: last chunk of its key.
        record: its fields by name, of the dtype of `layout(name)`.
    """

    name: MessageName
    record: np.void


class Subscriber:
    """A client of one cell: subscribed from the start, so that nothing is missed between finding the cell and following it.

    Attributes:
        received: messages so far, by name.
        missing: messages that were lost, by the gaps in the sequence numbers, by name.

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
        self._next: dict[MessageName, int] = dict.fromkeys(MESSAGE_NAMES, 0)
        self._layouts: dict[str, Layout] = {self._keys.of(name): layout(name) for name in MESSAGE_NAMES}
        self._arrived: SimpleQueue[zenoh.Sample] = SimpleQueue()
        self._tokens: SimpleQueue[bool] = SimpleQueue()
        self._summary: dict[str, Any] | None = None
        self._session = open_client_session(connect, timeout)
        self._subscription = self._session.declare_subscriber(self._keys.everything, self._arrived.put)
        self._liveliness = self._session.liveliness().declare_subscriber(self._keys.token, self._on_token, history=True)
