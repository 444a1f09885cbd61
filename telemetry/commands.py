"""Commands to a cell: queries to `deltaph/{cell}/command/{name}`, JSON both ways, SI, every one answered with one reply.

A refusal is a reply too, with `accepted` false and the reason; only a wildcard gets errors, one for each command that it means.
"""

from __future__ import annotations

import ctypes
import reprlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Protocol, Self

import numpy as np
import zenoh
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from deltaph.errors import EnvironmentProblem
from deltaph.frame import COMMANDS, NO_COMMANDS, OUTCOMES, Command, Outcome
from deltaph.telemetry.keys import CellKeys
from deltaph.telemetry.ring import CONTEXT
from deltaph.telemetry.session import open_client_session, replies

MAX_REQUEST = 4096
"""A request is refused unread beyond this [bytes]."""

MOST_WAITING = 100
"""Commands of the feed, of each kind, that may wait to be decided, one each few milliseconds."""

VERDICT_TIMEOUT = 5.0
"""A PPO is answered by then, if only with `failed` [s]."""

_ANSWER_TIMEOUT = VERDICT_TIMEOUT + 1.0  # of a client [s]
_PATIENCE = 1.0  # of a client whose queries reach nobody, much less than a query that is not answered in time takes [s]
_PAUSE = 0.05  # between two of them [s]

NonNegative = Annotated[float, Ge(0)]
Point = tuple[float, float, float]
PerSide = NonNegative | tuple[NonNegative, NonNegative]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class NoRequest(_Model):
    """Of `hold`, `resume` and `stop`: nothing, or {}."""


class FeedRequest(_Model):
    """Of `feed`: the path-speed override."""

    value: Annotated[float, Ge(0), Le(1)] = Field(
        description="1 as planned, 0 stops on the path; under a hold it waits for `resume`"
    )


class PpoRequest(_Model):
    """Of `ppo`: a pick-and-place operation. What is absent is the scenario's; pairs are pick side, place side."""

    place: Point = Field(description="place point in the base frame [m]")
    pick: Point | None = Field(None, description="pick point [m]; absent: where the robot rests once it has done all it was told")
    lift: PerSide | None = Field(None, description="lift height above the points [m]")
    corner_deviation: PerSide | None = Field(None, description="prescribed corner deviation [m]")
    payload: NonNegative | None = Field(None, description="mass that is carried, declared and real [kg]")
    dwell: NonNegative | None = Field(None, description="rest at the pick point before the motion [s]; absent: none")


REQUESTS: dict[Command, type[NoRequest | FeedRequest | PpoRequest]] = {
    "ppo": PpoRequest,
    "hold": NoRequest,
    "resume": NoRequest,
    "stop": NoRequest,
    "feed": FeedRequest,
}
"""What a command takes."""

_URGENCY: tuple[Command, ...] = ("stop", "hold", "resume", "feed")
"""Commands of the feed in the order in which those that wait are decided."""

_MEANING: dict[Command, str] = {
    "ppo": "Plan a pick-and-place operation and run it; one may wait while another runs",
    "hold": "Stop on the path, with bounded jerk; what is accepted waits",
    "resume": "Go on after hold or stop, at the feed that was set last",
    "stop": "As hold; discard what waits or is being planned, and refuse every ppo until resume, when what runs goes on",
    "feed": "Set the path-speed override",
}


class PlanFacts(_Model):
    """An accepted plan, named as the planner's outputs `plan.*`."""

    count: int = Field(description="number of the plan, from 1")
    duration: float = Field(description="of its motion, without the dwell [s]")
    corner_deviation_pick: float = Field(description="[m]")
    corner_deviation_place: float = Field(description="[m]")
    waits: bool = Field(description="another one runs before it")
    start_time: float | None = Field(
        description="simulation time at which it begins [s]; null where it depends on the feed, or steps are longer than 1 ms"
    )


class RefusedPlan(_Model):
    """Why a task is not planned, named as the planner's outputs `plan.*`; quantities in SI."""

    status: str = Field(description="an item of PlanStatus")
    phase: str = Field(description="where on the path, an item of Phase; idle where no phase is meant")
    joint: int = Field(description="1 to 3; 0 where none is meant")
    required: float
    available: float


class FeedFacts(_Model):
    """The override as it is from now on."""

    value: float = Field(description="the feed that was set last")
    held: bool = Field(description="the planner's input is 0 until `resume`")
    stopped: bool = Field(description="every ppo is refused until `resume`")


class Reply(_Model):
    """What became of a command."""

    command: Command
    accepted: bool
    outcome: Outcome = Field(description="accepted, or why not")
    time: float = Field(description="simulation time of the decision; of the override: from when on it is in force [s]")
    reason: str | None = Field(None, description="of a refusal, one sentence")
    plan: PlanFacts | None = Field(None, description="of an accepted ppo")
    refused: RefusedPlan | None = Field(None, description="of a ppo that is not planned")
    feed: FeedFacts | None = Field(None, description="of hold, resume, stop and feed")
    discarded: int | None = Field(
        None, description="of stop: requests that waited or were being planned, and never run; null where the cell ends first"
    )


def commands_schema() -> dict[str, Any]:
    """The commands for the queryable `schema`: JSON Schema of requests and of the reply."""
    return {
        "served": "only by a cell that was started with --serve; another one does not answer",
        "key": "deltaph/{cell}/command/{name}",
        "encoding": "application/json",
        "max_request_bytes": MAX_REQUEST,
        "max_waiting": MOST_WAITING,  # of hold, resume, stop and feed each; of ppo none: what is more is refused as busy
        "requests": {
            name: {"description": _MEANING[name], "schema": model.model_json_schema()} for name, model in REQUESTS.items()
        },
        "reply": Reply.model_json_schema(),
    }


class Cell(Protocol):
    """Who carries commands out."""

    @property
    def time(self) -> float:
        """Simulation time [s]."""
        ...

    def override(self, command: Command, value: float | None) -> Reply:
        """Take hold, resume, stop or feed; may wait, some steps. One call at a time."""
        ...

    def ppo(self, request: PpoRequest) -> Reply:
        """Take a PPO; may wait. One call at a time, in a thread of its own."""
        ...


class CommandCounts:
    """How many commands so far had which outcome, in memory that the process that answers them shares with the step loop.

    Attributes:
        array: the counts as they are now (COMMANDS, OUTCOMES).
    """

    def __init__(self) -> None:
        self._attach(CONTEXT.RawArray(ctypes.c_int32, NO_COMMANDS.size))

    def _attach(self, memory: ctypes.Array[ctypes.c_int32]) -> None:
        self._memory = memory
        self.array: NDArray[np.int32] = np.frombuffer(memoryview(memory), NO_COMMANDS.dtype).reshape(NO_COMMANDS.shape)

    def __getstate__(self) -> ctypes.Array[ctypes.c_int32]:
        return self._memory

    def __setstate__(self, memory: ctypes.Array[ctypes.c_int32]) -> None:
        self._attach(memory)

    def add(self, command: Command, outcome: Outcome) -> None:
        """Count one; one call at a time."""
        self.array[COMMANDS.index(command), OUTCOMES.index(outcome)] += 1


class CommandService:
    """Answers the commands to a cell, each query with one reply.

    Zenoh's threads, one for each command, refuse what is no request. A thread decides the commands of the feed, `stop` and `hold`
    first, so that they are heard in any flood. Another one decides PPOs, one at a time; what comes meanwhile is refused as busy. An
    access list says who may command.

    Args:
        session: of the cell.
        cell: its name.
        carry_out: who does it.
        counts: of commands by outcome.
        journal: takes a line on every command.
    """

    def __init__(
        self, session: zenoh.Session, cell: str, carry_out: Cell, counts: CommandCounts, journal: Callable[[str], None]
    ) -> None:
        self._keys = CellKeys(cell)
        self._cell = carry_out
        self._counts = counts
        self._journal = journal
        self._counting = threading.Lock()
        self._changed = threading.Condition()  # what waits, and whether more may
        self._waiting: dict[Command, deque[tuple[zenoh.Query, NoRequest | FeedRequest]]] = {name: deque() for name in _URGENCY}
        self._ppo: tuple[zenoh.Query, PpoRequest] | None = None  # that is being decided, or is next
        self._open = True
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._decide_overrides, self._decide_ppos)]
        for thread in self._threads:
            thread.start()
        # One for each key, and none for others: a query to what is no command ends in Zenoh, without a look at it here.
        self._queryables = [session.declare_queryable(self._keys.command(name), self._on_query) for name in REQUESTS]

    def close(self) -> None:
        """Take no more, and wait until what is under way is answered. A second call does nothing."""
        if not self._open:
            return
        for queryable in self._queryables:
            queryable.undeclare()  # type: ignore[no-untyped-call]
        with self._changed:
            self._open = False
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()

    def _on_query(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        command = next((name for name in REQUESTS if key == self._keys.command(name)), None)
        if command is None:
            self._count("none", "invalid")
            query.reply_err(f"{key} is no single command: known are {', '.join(map(self._keys.command, REQUESTS))}".encode())
            return
        length = 0 if query.payload is None else len(query.payload)
        if length > MAX_REQUEST:
            self._reply(query, self._refusal(command, "invalid", f"the request has {length} bytes: at most {MAX_REQUEST}"))
            return
        request = _parse(command, b"" if query.payload is None else query.payload.to_bytes())
        if isinstance(request, str):
            self._reply(query, self._refusal(command, "invalid", request))
        elif (reason := self._hand_over(query, command, request)) is not None:
            self._reply(query, self._refusal(command, "busy", reason))

    def _hand_over(self, query: zenoh.Query, command: Command, request: NoRequest | FeedRequest | PpoRequest) -> str | None:
        """Leave a request to the thread that decides it; returns why not."""
        with self._changed:
            if isinstance(request, PpoRequest):
                if self._ppo is not None:
                    return "busy: another PPO is being decided"
                self._ppo = query, request
            else:
                if len(self._waiting[command]) >= MOST_WAITING:
                    return f"busy: {MOST_WAITING} of these commands wait to be decided"
                self._waiting[command].append((query, request))
            self._changed.notify_all()
        return None

    def _decide_overrides(self) -> None:
        while True:
            with self._changed:
                while (command := next((name for name in _URGENCY if self._waiting[name]), None)) is None:
                    if not self._open:
                        return
                    self._changed.wait()
                query, request = self._waiting[command].popleft()
            value = request.value if isinstance(request, FeedRequest) else None
            self._reply(query, self._decide(command, partial(self._cell.override, command, value)))
            del query  # which ends it

    def _decide_ppos(self) -> None:
        while True:
            with self._changed:
                while self._ppo is None:
                    if not self._open:
                        return
                    self._changed.wait()
                query, request = self._ppo
            reply = self._decide("ppo", partial(self._cell.ppo, request))
            with self._changed:
                self._ppo = None  # before the answer: who has it may send the next one
            self._reply(query, reply)
            del query  # which ends it

    def _decide(self, command: Command, decide: Callable[[], Reply]) -> Reply:
        try:
            return decide()
        except Exception as error:  # a cell does not stop for what one request brings up; it says so
            return self._refusal(command, "failed", f"the cell could not judge it: {type(error).__name__}: {error}")

    def _refusal(self, command: Command, outcome: Outcome, reason: str) -> Reply:
        return Reply(command=command, accepted=False, outcome=outcome, time=self._cell.time, reason=reason)

    def _reply(self, query: zenoh.Query, reply: Reply) -> None:
        self._count(reply.command, reply.outcome)
        self._journal(f"command {reply.command} {sentence(reply)}")
        document = reply.model_dump_json().encode()
        try:
            query.reply(self._keys.command(reply.command), document, encoding=zenoh.Encoding.APPLICATION_JSON)
        except zenoh.ZError as error:
            self._journal(f"command {reply.command} could not be answered: {error}")

    def _count(self, command: Command, outcome: Outcome) -> None:
        with self._counting:
            self._counts.add(command, outcome)


def sentence(reply: Reply) -> str:
    """A reply in words."""
    if not reply.accepted:
        return f"refused ({reply.outcome}): {reply.reason}"
    if reply.plan is not None:
        plan = reply.plan
        starts = "waits" if plan.start_time is None else f"starts at {plan.start_time:.3f} s"
        deviations = f"{1e3 * plan.corner_deviation_pick:.4g} and {1e3 * plan.corner_deviation_place:.4g} mm"
        return f"accepted: plan {plan.count}, {1e3 * plan.duration:g} ms, corner deviation {deviations}, {starts}"
    if reply.feed is not None:
        feed = reply.feed
        state = "stopped" if feed.stopped else "held" if feed.held else "runs"
        discarded = "" if reply.discarded is None else f", {reply.discarded} discarded"
        return f"accepted: {state}, feed {feed.value:g}, from {reply.time:.3f} s on{discarded}"
    return "accepted"


def _parse(command: Command, payload: bytes) -> NoRequest | FeedRequest | PpoRequest | str:
    """The request, or what is wrong with it."""
    try:
        return REQUESTS[command].model_validate_json(payload or b"{}")
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False)
        errors = sorted(found, key=lambda one: one["type"] != "extra_forbidden")  # what is misspelt is missing as well
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        return _say(command, errors[0]) + more


def _say(command: Command, error: Any) -> str:
    key = ".".join(str(part) for part in error["loc"] if not str(part).startswith(("float", "tuple", "constrained")))
    message = error["msg"][0].lower() + error["msg"][1:]
    match error["type"]:
        case "json_invalid":
            return f"the request is not JSON: {message.removeprefix('invalid JSON: ')}"
        case "extra_forbidden":
            known = ", ".join(REQUESTS[command].model_fields) or "none"
            return f"unknown key {reprlib.repr(key)}: known are {known}"
        case "missing":
            return f"key {key} is missing"
        case _:
            return f"{key or 'the request'} is {reprlib.repr(error['input'])}: {message}"


class CommandClient:
    """Sends commands to a cell, and waits for what becomes of them.

    Args:
        cell: name of the cell.
        connect: endpoints to connect to, the first that answers is taken; without any those of `config`, or the default one.
        timeout: for the connection [s]; None waits for ever.
        config: a Zenoh configuration file, such as one with TLS.

    Raises:
        ValueError: the cell's name does not fit into a key.
        EnvironmentProblem: nothing answers, an endpoint is none, or the file is no configuration.
    """

    def __init__(self, cell: str, connect: Sequence[str] = (), timeout: float | None = None, config: Path | None = None) -> None:
        self._keys = CellKeys(cell)
        self._session = open_client_session(connect, timeout, config)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def ppo(self, request: PpoRequest) -> Reply:
        """Plan and run a pick-and-place operation."""
        return self._send("ppo", request)

    def hold(self) -> Reply:
        """Stop on the path."""
        return self._send("hold", NoRequest())

    def resume(self) -> Reply:
        """Go on after hold or stop."""
        return self._send("resume", NoRequest())

    def stop(self) -> Reply:
        """Stop on the path, discard what waits or is being planned, and refuse every PPO until `resume`."""
        return self._send("stop", NoRequest())

    def feed(self, value: float) -> Reply:
        """Set the path-speed override, 0 to 1."""
        return self._send("feed", FeedRequest(value=value))

    def close(self) -> None:
        """Close the session. A second call does nothing."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]

    def _answers(self, key: str, payload: bytes) -> list[zenoh.Reply]:
        """What comes back. A query that ends at once has reached no cell, which a router may not know yet: it is sent again."""
        patience = time.monotonic() + _PATIENCE
        while not (answers := replies(self._session, key, _ANSWER_TIMEOUT, payload)) and time.monotonic() < patience:
            time.sleep(_PAUSE)
        return answers

    def _send(self, command: Command, request: BaseModel) -> Reply:
        """Send a command.

        Raises:
            EnvironmentProblem: no cell takes it, or what answers is none of this version.
        """
        key = self._keys.command(command)
        for answer in self._answers(key, request.model_dump_json(exclude_none=True).encode()):
            if answer.ok is not None:
                try:
                    return Reply.model_validate_json(answer.ok.payload.to_bytes())
                except ValidationError as error:
                    raise EnvironmentProblem(
                        f"what answers {key} is not this version's: use the same deltaph on both sides"
                    ) from error
        raise EnvironmentProblem(
            f"cell {self._keys.cell} takes no commands: start it with `deltaph run SCENARIO --serve`, "
            f"or give its own --cell and --connect; or this client's certificate may not command"
        )
