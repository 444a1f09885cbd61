"""The side of a cell that serves to which commands come: a publisher that answers them, in a process of its own."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deltaph.attendant import TASK_INPUTS, Job, Overridden, Standing, Unasked, Verdict
from deltaph.errors import InfeasibleError
from deltaph.frame import Command, Frame, Outcome
from deltaph.importer import task_inputs
from deltaph.kernel import status_sentence
from deltaph.plan import Plan
from deltaph.scenario import Pair, Scenario, Task
from deltaph.telemetry import (
    Asking,
    CommandCounts,
    CommandService,
    FeedFacts,
    LineClosedError,
    PlanFacts,
    PpoRequest,
    Publisher,
    RefusedPlan,
    Reply,
)
from deltaph.telemetry.commands import VERDICT_TIMEOUT
from deltaph.variables import variable_table

JOURNAL_PERIOD = 1.0
"""Between two lines about refused commands, so that a flood is not one on the screen as well [s]."""

_STATUS = variable_table("planner").items("PlanStatus")
_UNASKED = {
    "stopped": "the cell is stopped: resume it first",
    "cancelled": "the cell was stopped before this was planned: resume it and ask again",
    "tripped": "the plant has tripped: its brakes are on until the cell is started again",
}


class Desk:
    """Carries commands out, with the step loop's help.

    Attributes:
        time: simulation time [s].

    Args:
        scenario: what absent values of a request are taken from.
        overrides: to the loop's `Attendant`.
        tasks: likewise.
    """

    def __init__(self, scenario: Scenario, overrides: Asking, tasks: Asking) -> None:
        self.time = 0.0
        self._scenario = scenario
        self._overrides = overrides
        self._tasks = tasks

    def override(self, command: Command, value: float | None) -> Reply:
        """Take hold, resume, stop or feed."""
        answer = self._ask(self._overrides, (command, value), time.monotonic() + VERDICT_TIMEOUT)
        if isinstance(answer, str):
            return self._refusal(command, "failed", answer)
        if isinstance(answer, Unasked):
            return Reply(command=command, accepted=False, outcome="tripped", time=answer.time, reason=_UNASKED[answer.why])
        assert isinstance(answer, Overridden)
        override = answer.override
        feed = FeedFacts(value=override.value, held=override.held, stopped=override.stopped)
        return Reply(command=command, accepted=True, outcome="accepted", time=answer.time, feed=feed, discarded=answer.discarded)

    def ppo(self, request: PpoRequest) -> Reply:
        """Plan with the kernel what nobody waits for, then ask the planner in the step loop: its verdict counts."""
        deadline = time.monotonic() + VERDICT_TIMEOUT
        standing = self._ask(self._tasks, "standing", deadline)
        if isinstance(standing, str):
            return self._refusal("ppo", "failed", standing)
        assert isinstance(standing, Standing)
        scenario = self._scenario
        task = Task(
            pick=request.pick or standing.rest,
            place=request.place,
            lift=_pair(request.lift, scenario.task.lift),
            corner_deviation=_pair(request.corner_deviation, scenario.task.corner_deviation),
        )
        declared = scenario.declared_payload if request.payload is None else request.payload
        real = scenario.payload if request.payload is None else request.payload
        foreseen = None
        try:
            plan = Plan(scenario.robot, task, scenario.law, declared, scenario.limits)
        except InfeasibleError as error:
            foreseen = error  # the planner will say so too, and publish it
        else:
            try:
                plan.require_within(scenario.limits)
            except InfeasibleError as error:
                return self._infeasible(error, self.time)
        inputs = task_inputs(task) | {"task.dwell": request.dwell or 0.0, "payload.mass": declared}
        values = np.array([inputs[name] for name in TASK_INPUTS])
        answer = self._ask(self._tasks, Job(task, values, request.dwell or 0.0, declared, real, standing.stops), deadline)
        if isinstance(answer, str):
            return self._refusal("ppo", "failed", answer)
        if isinstance(answer, Verdict):
            return self._answer(answer, foreseen)
        outcome: Outcome = "tripped" if answer.why == "tripped" else "stopped"
        return Reply(command="ppo", accepted=False, outcome=outcome, time=answer.time, reason=_UNASKED[answer.why])

    def _ask(self, line: Asking, question: object, deadline: float) -> Any:
        """The loop's answer, or in words why there is none."""
        try:
            return line.ask(question, deadline)
        except LineClosedError:
            return "the cell ends"
        except TimeoutError:
            return f"the cell has not decided within {VERDICT_TIMEOUT:g} s: it may yet"

    def _answer(self, verdict: Verdict, foreseen: InfeasibleError | None) -> Reply:
        outputs = verdict.outputs
        status = _STATUS[int(outputs["plan.status"])]
        if status == "ok":
            plan = PlanFacts(
                count=int(outputs["plan.count"]),
                duration=outputs["plan.duration"],
                corner_deviation_pick=outputs["plan.corner_deviation_pick"],
                corner_deviation_place=outputs["plan.corner_deviation_place"],
                waits=verdict.waits,
                start_time=verdict.start_time,
            )
            return Reply(command="ppo", accepted=True, outcome="accepted", time=verdict.time, plan=plan)
        if foreseen is None or foreseen.status != status:  # what only the planner knows, such as `busy`
            required, available = outputs["plan.required"], outputs["plan.available"]
            sentence = status_sentence(status, required, available)
            foreseen = InfeasibleError(sentence, status=status, required=required, available=available)
        return self._infeasible(foreseen, verdict.time)

    @staticmethod
    def _infeasible(error: InfeasibleError, at: float) -> Reply:
        facts = RefusedPlan(
            status=error.status, phase=error.phase, joint=error.joint, required=error.required, available=error.available
        )
        outcome: Outcome = "busy" if error.status == "busy" else "infeasible"
        return Reply(command="ppo", accepted=False, outcome=outcome, time=at, reason=str(error), refused=facts)

    def _refusal(self, command: Command, outcome: Outcome, reason: str) -> Reply:
        return Reply(command=command, accepted=False, outcome=outcome, time=self.time, reason=reason)


class ServingPublisher(Publisher):
    """A publisher whose cell takes commands, once `serve` is called.

    Args:
        scenario: of the cell.
        document: what the queryable `scenario` answers.
        overrides: to the step loop's `Attendant`.
        tasks: likewise.
        counts: of commands, for the frames.
        listen: endpoints that are asked for; see `open_cell_session`.
        connect: endpoints to connect to as well.
        config: a Zenoh configuration file.

    Raises:
        EnvironmentProblem: as of a `Publisher`.
    """

    def __init__(
        self,
        scenario: Scenario,
        document: str,
        overrides: Asking,
        tasks: Asking,
        counts: CommandCounts,
        *,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        config: Path | None = None,
    ) -> None:
        super().__init__(scenario.cell, document, listen=listen, connect=connect, config=config)
        self._desk = Desk(scenario, overrides, tasks)
        self._cell = scenario.cell
        self._counts = counts
        self._service: CommandService | None = None

    def serve(self) -> None:
        """Take commands from now on."""
        self._service = CommandService(self.session, self._cell, self._desk, self._counts, Journal())

    def take(self, frame: Frame) -> None:
        """Publish a frame."""
        self._desk.time = frame.time
        super().take(frame)

    def end_service(self) -> None:
        """Take no more commands, and answer those that are under way."""
        if self._service is not None:
            self._service.close()

    def close(self) -> None:
        """End the service, then as a `Publisher`."""
        self.end_service()
        super().close()


def _pair(given: float | Pair | None, otherwise: Pair) -> Pair:
    """A pair as given, of one value, or the scenario's."""
    if given is None:
        return otherwise
    return given if isinstance(given, tuple) else (given, given)


class Journal:
    """Says on standard error what becomes of commands: all that is accepted, and of refusals one a second."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._last, self._silent = -JOURNAL_PERIOD, 0

    def __call__(self, line: str) -> None:
        """Say a line, or count it."""
        with self._lock:
            if " refused " in line:
                now = self._clock()
                if now - self._last < JOURNAL_PERIOD:
                    self._silent += 1
                    return
                self._last = now
            more = f" (and {self._silent} refused since the last line)" if self._silent else ""
            self._silent = 0
        with contextlib.suppress(OSError):  # who read it has gone: the command is answered all the same
            sys.stderr.write(f"{line}{more}\n")
            sys.stderr.flush()
