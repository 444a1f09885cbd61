"""Publishes a cell over Zenoh: its frames, that it lives, and what a newcomer asks for."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import zenoh
from zenoh import ext

from deltaph.errors import EnvironmentProblem
from deltaph.frame import Frame
from deltaph.telemetry.events import EventWatch
from deltaph.telemetry.keys import FRAME_MESSAGES, QUERY_NAMES, CellKeys, MessageName, QueryName
from deltaph.telemetry.messages import layout, schema_document
from deltaph.telemetry.session import is_alive, open_cell_session
from deltaph.variables import variable_table

HISTORY = 30_000
"""Messages of each kind that are kept for those who come late or have lost some: 30 s at 1 kHz, some 60 MB once it is full."""

_RARER = {"plan": 100, "event": 20}
"""Plans are no more than 10 a second, events 50: they are kept as long with so much less, and memory is full as soon."""

_HEARTBEAT = 0.5  # between two messages that tell Zenoh's own advanced subscribers how many there have been [s]
_LINGER = 0.5  # after the summary, which tells a subscriber that it has lost the last messages: it may ask for them [s]
_SETTLE = 0.2  # a session subscribes soon after it has connected [s]


class Publisher:
    """A sink that publishes.

    The sequence number of `setpoint`, `actual` and `timing` is the frame's step: a frame that never came here shows as a gap.
    The last message is the summary; its attachment tells the last sequence number of each kind: a loss at the end shows as well.

    The newest messages are kept by Zenoh's advanced publishers, which any advanced subscriber asks for what it missed. `take` waits
    while they answer, up to 0.3 s where that is all they keep: it belongs into a `SinkProcess`. Replies are dropped where a
    reader does not read, not waited for: one that has stopped must not hold up the others.

    Attributes:
        endpoints: where it listens.
        published: frames published so far.

    Args:
        cell: name of the cell.
        scenario_json: what the queryable `scenario` answers.
        listen: endpoints that are asked for; see `open_cell_session`.
        connect: endpoints to connect to as well.
        config: a Zenoh configuration file; see `deltaph zenoh-config`.
        history: messages of each kind that are kept; of events a twentieth, of plans a hundredth.

    Raises:
        ValueError: the cell's name does not fit into a key.
        EnvironmentProblem: an endpoint that was asked for is in use, or is none; the configuration is none; a cell of this name is
            there already.
    """

    def __init__(
        self,
        cell: str,
        scenario_json: str,
        *,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        config: Path | None = None,
        history: int = HISTORY,
    ) -> None:
        self._keys = CellKeys(cell)
        if is_alive(self._keys.token, connect, config):
            raise EnvironmentProblem(
                f"a cell {cell} is there already: give this one another name with --cell, or as `cell` under [run]"
            )
        self._session, self.endpoints = open_cell_session(listen, connect, config)
        self._history = history
        self.published = 0
        self._last_step = -1
        self._plans = 0
        self._decided = [0, 0, 0]
        integers = [v.name for v in variable_table("planner").of("output") if not v.is_float]
        self._decisions = [integers.index(f"plan.{name}") for name in ("count", "refused", "cancelled")]
        self._answers: dict[QueryName, tuple[bytes, zenoh.Encoding]] = {}
        self._answer("schema", json.dumps(schema_document()))
        self._answer("scenario", scenario_json)
        self._messages = [(layout(name), self._publisher(name)) for name in FRAME_MESSAGES]
        self._plan, self._plan_publisher = layout("plan"), self._publisher("plan")
        self._event, self._event_publisher = layout("event"), self._publisher("event")
        block = zenoh.CongestionControl.BLOCK  # it ends the stream: it may wait, and must not be lost
        self._summary_publisher = self._session.declare_publisher(self._keys.of("summary"), congestion_control=block)
        self._audience = self._session.declare_publisher(self._keys.everything)  # sends nothing, but knows whether somebody listens
        self._watch, self._events = EventWatch(), 0
        self._queryables = [self._session.declare_queryable(self._keys.of(name), self._answering(name)) for name in QUERY_NAMES]
        self._token = self._session.liveliness().declare_token(self._keys.token)

    @property
    def session(self) -> zenoh.Session:
        """The cell's session, for what else it offers."""
        return self._session

    def take(self, frame: Frame) -> None:
        """Publish a frame, what happened since the last one, and the plan where one was accepted, refused or cancelled."""
        decided = frame.planner_integers[self._decisions].tolist()
        if decided != self._decided:
            self._decided = decided
            payload = self._plan.encode(frame, self._plans)
            self._plans += 1
            self._answers["plan"] = (payload, zenoh.Encoding(self._plan.encoding))
            self._plan_publisher.put(payload)
        for message, publisher in self._messages:
            publisher.put(message.encode(frame, frame.step))
        for event in self._watch.see(frame):
            self._event_publisher.put(self._event.encode(event, self._events))
            self._events += 1
        self._last_step = frame.step
        self.published += 1

    def set_summary(self, summary_json: str) -> None:
        """What the queryable `summary` answers from now on; also sent to the subscribers on `close`, after all messages."""
        self._answer("summary", summary_json)

    def subscribers(self) -> int:
        """Number of sessions that are connected once one of them subscribes to messages of the cell; 0 before.

        Which of them subscribe only Zenoh's administration space tells. It is not asked, and is off: a query of it while somebody
        declares a subscriber can stop the session for good (eclipse-zenoh 1.10.2, eclipse-zenoh/zenoh pull request 2619).
        Those behind one router count once.
        """
        if not self._audience.matching_status.matching:  # type: ignore[attr-defined]  # Zenoh's stub says it is a bool
            return 0
        return max(1, len(self._session.info.transports()))

    def wait_for_subscribers(self, count: int, timeout: float) -> None:
        """Wait until so many sessions subscribe to messages of the cell.

        Args:
            count: at least, as `subscribers` counts.
            timeout: [s].

        Raises:
            EnvironmentProblem: they do not come in time.
        """
        begin = since = time.monotonic()
        while (now := time.monotonic()) < since + _SETTLE:
            if (found := self.subscribers()) < count:
                if now >= begin + timeout:
                    raise EnvironmentProblem(
                        f"{found} of {count} Zenoh subscribers came within {timeout:g} s to {', '.join(self.endpoints)}"
                    )
                since = now
            time.sleep(0.01)  # between two looks, so that waiting costs nothing

    def close(self) -> None:
        """Send the summary and close the session, which ends the token. A second call does nothing."""
        if self._session.is_closed():
            return
        if "summary" in self._answers:
            payload, encoding = self._answers["summary"]
            self._summary_publisher.put(payload, encoding=encoding, attachment=json.dumps(self._last_numbers()))
            if self._summary_publisher.matching_status.matching:  # type: ignore[attr-defined]  # Zenoh's stub says it is a bool
                time.sleep(_LINGER)
        self._session.close()  # type: ignore[no-untyped-call]

    def _last_numbers(self) -> dict[MessageName, int]:
        """The last sequence number of each kind; of what was never sent there is none."""
        numbers = dict.fromkeys(FRAME_MESSAGES, self._last_step) | {"plan": self._plans - 1, "event": self._events - 1}
        return {name: number for name, number in numbers.items() if number >= 0}

    def _publisher(self, name: MessageName) -> ext.AdvancedPublisher:
        drop = zenoh.CongestionControl.DROP
        history = max(1, self._history // _RARER.get(name, 1))
        return ext.declare_advanced_publisher(
            self._session,
            self._keys.of(name),
            encoding=zenoh.Encoding(layout(name).encoding),
            congestion_control=drop,
            express=False,
            cache=ext.CacheConfig(history, replies_config=ext.RepliesConfig(congestion_control=drop)),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=_HEARTBEAT, sporadic_heartbeat=None),
            publisher_detection=True,
        )

    def _answer(self, name: QueryName, document: str) -> None:
        self._answers[name] = (document.encode(), zenoh.Encoding.APPLICATION_JSON)

    def _answering(self, name: QueryName) -> Callable[[zenoh.Query], None]:
        key = self._keys.of(name)

        def reply(query: zenoh.Query) -> None:
            if name in self._answers:
                payload, encoding = self._answers[name]
                query.reply(key, payload, encoding=encoding)
            else:
                query.reply_err(f"there is no {name} yet".encode())

        return reply
