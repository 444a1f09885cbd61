"""Zenoh sessions: on this machine only unless asked for more, no multicast, no gossip."""

from __future__ import annotations

import json
import os
import re
import socket
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import json5
import zenoh

from deltaph.errors import EnvironmentProblem

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a cell listens when nothing else is asked for."""

# A connection that was lost is tried again each second: Zenoh's own pauses grow to 4 s.
#
# A message that waits in the sender's queue for longer than `wait_before_drop` is lost, and Zenoh does not say so. The publisher
# has a process of its own (SinkProcess), so it may wait: most of what is too much is then dropped, and counted, at the ring
# before it. What a stopped subscriber loses in Zenoh or in the network shows as gaps in its sequence numbers alone.
_DEFAULTS: dict[str, Any] = {
    "connect": {"retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2}},
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    "transport": {
        "link": {"tx": {"queue": {"size": {"data": 16}, "congestion_control": {"drop": {"wait_before_drop": 100_000}}}}}  # [us]
    },
}

CONFIGURATIONS = {name: Path(__file__).with_name(f"{name}.json5") for name in ("cell", "client")}
"""Examples of configuration files."""

_FREE_PORT_ATTEMPTS = 5
_TOKEN_TIMEOUT = 1.0  # for cells of the same name [s]
_GRACE = 1.0  # how much later than its own time limit the end of a query is waited for [s]
_PROTOCOLS = ("tcp", "udp", "tls", "quic", "ws", "unixsock-stream")  # what the wheel of eclipse-zenoh is built with


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Two configurations as one; where both say something, `above` holds."""
    found = dict(below)
    for key, value in above.items():
        before = found.get(key)
        found[key] = _merged(before, value) if isinstance(before, dict) and isinstance(value, dict) else value
    return found


def _endpoints(endpoints: Sequence[str]) -> list[str]:
    for endpoint in endpoints:
        protocol, _, address = endpoint.partition("/")
        if protocol not in _PROTOCOLS or not address:
            raise EnvironmentProblem(f"{endpoint!r} is not a Zenoh endpoint: write it like {DEFAULT_ENDPOINT}")
    return list(endpoints)


class _Settings:
    """What a session is opened with: our defaults, over them the configuration file, over that what the command line says.

    Raises:
        EnvironmentProblem: the file cannot be read, or is no configuration.
    """

    def __init__(self, mode: str, file: Path | None) -> None:
        if "RUST_LOG" in os.environ:
            # Zenoh's own log, on standard output: whom it refuses is told there and nowhere else.
            zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
        self._file = file
        self._mode = mode
        self._given: dict[str, Any] = {}
        if file is not None:
            try:
                self._given = json5.loads(file.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                reason = error.strerror if isinstance(error, OSError) else str(error).replace("<string>:", "line ")
                raise EnvironmentProblem(f"cannot read the Zenoh configuration {file}: {reason}") from error
            if not isinstance(self._given, dict):
                raise EnvironmentProblem(f"{file} is no Zenoh configuration: it must be an object, {{ ... }}")

    def endpoints(self, which: str) -> tuple[str, ...]:
        """The endpoints that the file asks for, to `listen` on or to `connect` to."""
        section = self._given.get(which)
        found = section.get("endpoints", []) if isinstance(section, dict) else []
        if isinstance(found, dict):  # by mode
            found = found.get(self._given.get("mode", self._mode), [])
        return tuple(found)

    def config(self, listen: Sequence[str], connect: Sequence[str]) -> zenoh.Config:
        """The configuration with these endpoints."""
        ours = _merged(_DEFAULTS, {"mode": self._mode})
        asked = {"listen": {"endpoints": _endpoints(listen)}, "connect": {"endpoints": _endpoints(connect)}}
        try:
            return zenoh.Config.from_json5(json.dumps(_merged(_merged(ours, self._given), asked)))
        except zenoh.ZError as error:
            raise EnvironmentProblem(f"{self._file} is no Zenoh configuration: {_reason(error)}") from error


def _reason(error: zenoh.ZError) -> str:
    """Zenoh's reason without the places in its sources: `address already in use`."""
    text = re.sub(r" at /\S+?:\d+\.?", "", str(error))
    inner = re.search(r"\[\S+: ([^\[\]]+?)(?: \(os error \d+\))?\]", text)
    return (inner.group(1) if inner else text).strip(" .!").lower()


def _open(settings: _Settings, listen: Sequence[str], connect: Sequence[str]) -> zenoh.Session:
    config = settings.config(listen, connect)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = " or ".join(f"on {endpoint}" for endpoint in listen)
        raise EnvironmentProblem(f"cannot listen {where}: {_reason(error)}") from error


def free_port() -> int:
    """A TCP port of this machine that nobody has; another process can be faster at it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def free_endpoint() -> str:
    """A Zenoh endpoint on such a port."""
    return f"tcp/127.0.0.1:{free_port()}"


def open_cell_session(
    listen: Sequence[str] = (), connect: Sequence[str] = (), config: Path | None = None
) -> tuple[zenoh.Session, tuple[str, ...]]:
    """Open the session of a cell: a peer that listens.

    Args:
        listen: endpoints that are asked for; without any those of the configuration file; without those the default one, or a
            free port of this machine where that is taken.
        connect: endpoints to connect to as well; those that are not there yet are tried again and again.
        config: a Zenoh configuration file.

    Returns:
        the session, and the endpoints it listens on.

    Raises:
        EnvironmentProblem: an endpoint that was asked for is in use, or is none; the file is no configuration.
    """
    settings = _Settings("peer", config)
    listen = listen or settings.endpoints("listen")
    connect = connect or settings.endpoints("connect")
    opened = partial(_open, settings, connect=connect)
    if listen:
        return opened(listen), tuple(listen)
    try:
        return opened([DEFAULT_ENDPOINT]), (DEFAULT_ENDPOINT,)
    except EnvironmentProblem as taken:
        problem = taken
    for _ in range(_FREE_PORT_ATTEMPTS):
        endpoint = free_endpoint()
        try:
            return opened([endpoint]), (endpoint,)
        except EnvironmentProblem as lost:
            problem = lost
    raise problem


def open_router_session(listen: Sequence[str]) -> zenoh.Session:
    """Open a Zenoh router, at which cells and clients meet.

    Raises:
        EnvironmentProblem: an endpoint is in use, or is none.
    """
    return _open(_Settings("router", None), listen, [])


def open_client_session(connect: Sequence[str] = (), timeout: float | None = None, config: Path | None = None) -> zenoh.Session:
    """Open the session of a subscriber: a client, which also works through a router; waits until an endpoint answers.

    Args:
        connect: endpoints to connect to, the first that answers is taken; without any those of the configuration file, or the
            default one.
        timeout: [s]; None waits for ever.
        config: a Zenoh configuration file.

    Raises:
        EnvironmentProblem: nothing answers, an endpoint is none, or the file is no configuration.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    settings = _Settings("client", config)
    connect = connect or settings.endpoints("connect") or (DEFAULT_ENDPOINT,)
    zenoh_config = settings.config(settings.endpoints("listen"), connect)
    while True:
        try:
            return zenoh.open(zenoh_config)
        except zenoh.ZError as error:
            if deadline is not None and time.monotonic() >= deadline:
                raise EnvironmentProblem(f"nothing answers on {' or '.join(connect)} within {timeout:g} s") from error
            time.sleep(0.05)  # between two attempts, so that waiting costs nothing


def is_alive(token: str, connect: Sequence[str] = (), config: Path | None = None) -> bool:
    """Whether a liveliness token is seen from the endpoints that a cell connects to; those that are not there see none.

    It is asked as a client: a router and a peer tell a peer nothing of other peers.

    Raises:
        EnvironmentProblem: an endpoint is none, or the file is no configuration.
    """
    settings = _Settings("client", config)
    for endpoint in connect or settings.endpoints("connect"):
        zenoh_config = settings.config([], [endpoint])
        try:
            session = zenoh.open(zenoh_config)
        except zenoh.ZError:
            continue
        with session:
            found = collected(partial(session.liveliness().get, token, timeout=_TOKEN_TIMEOUT), _TOKEN_TIMEOUT)
        if any(reply.ok is not None for reply in found):
            return True
    return False


def replies(session: zenoh.Session, selector: str, timeout: float, payload: bytes | None = None) -> list[zenoh.Reply]:
    """Ask, and wait for all replies.

    Args:
        session: that asks.
        selector: whom, and what for.
        timeout: [s].
        payload: JSON that goes with it.

    Returns:
        the replies that came, in their order.
    """
    encoding = None if payload is None else zenoh.Encoding.APPLICATION_JSON
    return collected(partial(session.get, selector, timeout=timeout, payload=payload, encoding=encoding), timeout)


def collected(ask: Callable[[Any], object], timeout: float) -> list[zenoh.Reply]:
    """Ask, and wait for all replies.

    Zenoh ends a query at its time limit; this wait has an end of its own.

    Args:
        ask: does it, with the handler that it is given.
        timeout: of the query [s].

    Returns:
        the replies that came, in their order.
    """
    found: list[zenoh.Reply] = []
    complete = threading.Event()
    ask(zenoh.handlers.Callback(found.append, complete.set))
    complete.wait(timeout + _GRACE)
    return list(found)
