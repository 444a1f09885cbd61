"""Zenoh sessions: on this machine only unless asked for more, no multicast, no gossip."""

from __future__ import annotations

import json
import re
import socket
import threading
import time
from collections.abc import Sequence
from typing import Any

import zenoh

from deltaph.errors import EnvironmentProblem

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a cell listens when nothing else is asked for."""

# A message that waits in the sender's queue for longer than `wait_before_drop` is lost, and Zenoh does not say so. The publisher
# has a thread of its own (BackgroundSink), so it may wait: most of what is too much is then dropped, and counted, at that
# thread's queue. What a stopped subscriber loses in Zenoh or in the network shows as gaps in its sequence numbers alone.
_QUEUE_BATCHES = 16
_WAIT_BEFORE_DROP_US = 100_000

_FREE_PORT_ATTEMPTS = 5
_GRACE = 1.0  # how much later than its own time limit the end of a query is waited for [s]
_PROTOCOLS = ("tcp", "udp", "tls", "quic", "ws", "unixsock-stream")  # what the wheel of eclipse-zenoh is built with


def _config(mode: str, listen: Sequence[str], connect: Sequence[str], **more: Any) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/queue/size/data": _QUEUE_BATCHES,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": _WAIT_BEFORE_DROP_US,
        **{key.replace("__", "/"): value for key, value in more.items()},
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    for endpoint in (*listen, *connect):
        protocol, _, address = endpoint.partition("/")
        if protocol not in _PROTOCOLS or not address:
            raise EnvironmentProblem(f"{endpoint!r} is not a Zenoh endpoint: write it like {DEFAULT_ENDPOINT}")
    config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    config.insert_json5("connect/endpoints", json.dumps(list(connect)))
    return config


def _reason(error: zenoh.ZError) -> str:
    """Zenoh's reason without the places in its sources: `address already in use`."""
    text = re.sub(r" at /\S+?:\d+\.?", "", str(error))
    inner = re.search(r"\[\S+: ([^\[\]]+?)(?: \(os error \d+\))?\]", text)
    return (inner.group(1) if inner else text).strip(" .!").lower()


def _open_peer(listen: Sequence[str], connect: Sequence[str]) -> zenoh.Session:
    # The administration space is what tells the publisher who subscribes.
    return _open("peer", listen, connect, adminspace__enabled=True)


def _open(mode: str, listen: Sequence[str], connect: Sequence[str], **more: Any) -> zenoh.Session:
    config = _config(mode, listen, connect, **more)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = " or ".join(f"on {endpoint}" for endpoint in listen)
        raise EnvironmentProblem(f"cannot listen {where}: {_reason(error)}") from error


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def open_cell_session(listen: Sequence[str] = (), connect: Sequence[str] = ()) -> tuple[zenoh.Session, tuple[str, ...]]:
    """Open the session of a cell: a peer that listens.

    Args:
        listen: endpoints that are asked for; without any the default one, or a free port of this machine where that is taken.
        connect: endpoints to connect to as well; those that are not there yet are tried again and again.

    Returns:
        the session, and the endpoints it listens on.

    Raises:
        EnvironmentProblem: an endpoint that was asked for is in use, or is none.
    """
    if listen:
        return _open_peer(listen, connect), tuple(listen)
    try:
        return _open_peer([DEFAULT_ENDPOINT], connect), (DEFAULT_ENDPOINT,)
    except EnvironmentProblem as taken:
        problem = taken
    for _ in range(_FREE_PORT_ATTEMPTS):  # another process can be faster at a free port
        endpoint = f"tcp/127.0.0.1:{_free_port()}"
        try:
            return _open_peer([endpoint], connect), (endpoint,)
        except EnvironmentProblem as lost:
            problem = lost
    raise problem


def open_router_session(listen: Sequence[str]) -> zenoh.Session:
    """Open a Zenoh router, at which cells and clients meet.

    Raises:
        EnvironmentProblem: an endpoint is in use, or is none.
    """
    return _open("router", listen, [])


def open_client_session(connect: Sequence[str] = (DEFAULT_ENDPOINT,), timeout: float | None = None) -> zenoh.Session:
    """Open the session of a subscriber: a client, which also works through a router; waits until an endpoint answers.

    Args:
        connect: endpoints to connect to, the first that answers is taken.
        timeout: [s]; None waits for ever.

    Raises:
        EnvironmentProblem: nothing answers, or an endpoint is none.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    config = _config("client", [], connect)
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if deadline is not None and time.monotonic() >= deadline:
                raise EnvironmentProblem(f"nothing answers on {' or '.join(connect)} within {timeout:g} s") from error
            time.sleep(0.05)  # between two attempts, so that waiting costs nothing


def replies(session: zenoh.Session, selector: str, timeout: float, payload: bytes | None = None) -> list[zenoh.Reply]:
    """Ask, and wait for all replies.

    Zenoh ends a query at its time limit, but the iterator that `Session.get` returns was seen, rarely, to wait for ever; this
    wait has an end of its own.

    Args:
        session: that asks.
        selector: whom, and what for.
        timeout: [s].
        payload: JSON that goes with it.

    Returns:
        the replies that came, in their order.
    """
    collected: list[zenoh.Reply] = []
    complete = threading.Event()
    encoding = None if payload is None else zenoh.Encoding.APPLICATION_JSON
    handler = zenoh.handlers.Callback(collected.append, complete.set)
    session.get(selector, handler, timeout=timeout, payload=payload, encoding=encoding)
    complete.wait(timeout + _GRACE)
    return list(collected)
