"""Telemetry: messages over Zenoh, and recordings. It sees frames and variable tables only.

`Recorder` and `Destination` are imported when they are asked for: Rerun takes a second to import.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from deltaph.telemetry.commands import (
    CommandClient,
    CommandCounts,
    CommandService,
    FeedFacts,
    PlanFacts,
    PpoRequest,
    RefusedPlan,
    Reply,
)
from deltaph.telemetry.events import EVENT_KINDS, EventKind
from deltaph.telemetry.keys import MESSAGE_NAMES, CellKeys, MessageName
from deltaph.telemetry.line import Answering, Asking, LineClosedError, line
from deltaph.telemetry.messages import Layout, layout, schema_document
from deltaph.telemetry.publisher import Publisher
from deltaph.telemetry.scene import Scene
from deltaph.telemetry.session import DEFAULT_ENDPOINT, open_client_session, open_router_session
from deltaph.telemetry.sink_process import SinkProcess
from deltaph.telemetry.subscriber import Message, Subscriber

if TYPE_CHECKING:
    from deltaph.telemetry.destination import Destination
    from deltaph.telemetry.recording import Recorder

__all__ = [
    "DEFAULT_ENDPOINT",
    "EVENT_KINDS",
    "MESSAGE_NAMES",
    "Answering",
    "Asking",
    "CellKeys",
    "CommandClient",
    "CommandCounts",
    "CommandService",
    "Destination",
    "EventKind",
    "FeedFacts",
    "Layout",
    "LineClosedError",
    "Message",
    "MessageName",
    "PlanFacts",
    "PpoRequest",
    "Publisher",
    "Recorder",
    "RefusedPlan",
    "Reply",
    "Scene",
    "SinkProcess",
    "Subscriber",
    "layout",
    "line",
    "open_client_session",
    "open_router_session",
    "schema_document",
]


@contextmanager
def _quiet_rerun() -> Iterator[None]:
    """Rerun reads what it is to log when it is imported: not that a file has no footer yet, unless the user wants to know."""
    if "RUST_LOG" in os.environ:
        yield
        return
    os.environ["RUST_LOG"] = "warn,re_log_encoding::rrd::file_sink=error"
    try:
        yield
    finally:
        del os.environ["RUST_LOG"]


def __getattr__(name: str) -> Any:
    if name == "Recorder":
        with _quiet_rerun():
            from deltaph.telemetry.recording import Recorder

        return Recorder
    if name == "Destination":
        with _quiet_rerun():
            from deltaph.telemetry.destination import Destination

        return Destination
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
