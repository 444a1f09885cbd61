"""`deltaph run --serve`: a cell in real time that waits for commands over Zenoh, until it is told to end."""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from deltaph.checks import deviation_tolerance
from deltaph.errors import DeltaphError, InfeasibleError
from deltaph.fmu import cached_fmus
from deltaph.frame import COMMANDS, OUTCOMES, Command, Outcome, RecentFrames
from deltaph.importer import attend, task_inputs
from deltaph.kernel import status_sentence
from deltaph.pacing import Undisturbed
from deltaph.plan import Plan
from deltaph.report import print_serving
from deltaph.run import QUEUE_FRAMES, Options, load_cell, open_publisher, open_recorder
from deltaph.scenario import Pair, Scenario, Task
from deltaph.scene import served_marks, served_scene
from deltaph.slave import Slave
from deltaph.tally import Begun, Tally
from deltaph.telemetry import BackgroundSink, CommandService, FeedFacts, PlanFacts, PpoRequest, RefusedPlan, Reply
from deltaph.telemetry.background import POLL
from deltaph.telemetry.commands import VERDICT_TIMEOUT
from deltaph.variables import variable_table
from deltaph.verdict import provenance_facts, serving_markdown

FEED_SETTLED = 1.0
"""Twice the time after which the planner's filter of the feed counts as settled, see feed.c [s]."""

JOURNAL_PERIOD = 1.0
"""Between two lines about refused commands, so that a flood is not one on the screen as well [s]."""


class _Override(NamedTuple):
    """The feed as people want it, and how often they have said stop; replaced, never changed."""

    value: float = 1.0
    held: bool = False
    stopped: bool = False
    stops: int = 0

    @property
    def input(self) -> float:
        """The planner's input."""
        return 0.0 if self.held else self.value


class _Verdict(NamedTuple):
    """What the planner made of a request: its outputs at the communication point that shows it."""

    step: int
    outputs: dict[str, float]
    waits: bool
    start_time: float | None


class _Refusal(NamedTuple):
    """Why a task is not planned. No exception: one that is kept keeps its frames, and the cell runs without garbage collection."""

    sentence: str
    facts: RefusedPlan

    @classmethod
    def of(cls, error: InfeasibleError) -> _Refusal:
        """What the kernel says."""
        facts = RefusedPlan(
            status=error.status, phase=error.phase, joint=error.joint, required=error.required, available=error.available
        )
        return cls(str(error), facts)

    def reply(self, time: float) -> Reply:
        """The answer."""
        outcome: Outcome = "busy" if self.facts.status == "busy" else "infeasible"
        return Reply(command="ppo", accepted=False, outcome=outcome, time=time, reason=self.sentence, refused=self.facts)


class _Job:
    """A PPO between the thread that decides commands and the step loop. Each field is written once, by one of them.

    Attributes:
        task: as asked for.
        inputs: of the planner, in the order of TASK_INPUTS (k,).
        dwell: [s].
        declared: what the plan is made for [kg].
        payload: what the gripper then really carries [kg].
        stops: how often the cell had been stopped when it was asked for: a later stop discards it.
        verdict: the loop's: a verdict of the planner, or why there is none.
    """

    def __init__(self, task: Task, inputs: NDArray[np.float64], dwell: float, declared: float, payload: float, stops: int) -> None:
        self.task = task
        self.inputs = inputs
        self.dwell = dwell
        self.declared = declared
        self.payload = payload
        self.stops = stops
        self.verdict: _Verdict | str | None = None


TASK_INPUTS: tuple[str, ...] = tuple(
    v.name for v in variable_table("planner").of("input") if v.is_float and v.name.startswith(("task.", "payload."))
)
"""Planner inputs that a PPO sets before its trigger."""

_STATUS = variable_table("planner").items("PlanStatus")


class Attendant:
    """Carries commands out: the step loop's side (`attach`, `post`) and the side of Zenoh's threads (`override`, `ppo`, `end`).

    The sides meet in single attributes that one of them replaces and the other reads; the loop never waits and takes no lock.

    Args:
        scenario: what absent values of a request are taken from.
        tally: is told which plan begins when.
    """

    def __init__(self, scenario: Scenario, tally: Tally) -> None:
        self._scenario = scenario
        self._tally = tally
        self._size = scenario.communication_step_ms / 1000.0
        self._rest = scenario.task.pick  # where the robot is when it has done all it was told
        self._override = self._applied = _Override()
        self._job: _Job | None = None
        self._posted = False
        self._discarded = 0, 0  # which stop was the last one that the planner has seen, and what it discarded
        self._step = 0
        self.ended = False
        # the loop's own
        self._trigger = 1
        self._before = (0, 0)
        self._place = scenario.task.pick  # where the plan that runs, or ran last, ends
        self._waiting: tuple[_Job, Begun] | None = None
        self._cancelling: tuple[int, int] | None = None  # the stop that the planner is told of, and plan.cancelled before it
        self._arc = 0.0
        self._end: float | None = None
        self._nominal_from = -FEED_SETTLED  # since when the feed is 1

    # The step loop's side

    def attach(self, planner: Slave, plant: Slave) -> None:
        """Find the columns."""
        self._planner, self._plant = planner, plant
        inputs = [v.name for v in planner.table.of("input") if v.is_float]
        self._task_columns = np.array([inputs.index(name) for name in TASK_INPUTS])
        self._feed = inputs.index("feed")
        floats = [v.name for v in planner.table.of("output") if v.is_float]
        others = [v.name for v in planner.table.of("output") if not v.is_float]
        self._plan_floats = {name: column for column, name in enumerate(floats) if name.startswith("plan.")}
        self._arc_column = floats.index("path.arc_length")
        self._count, self._refused, self._cancelled, self._status, self._phase = (
            others.index(name) for name in ("plan.count", "plan.refused", "plan.cancelled", "plan.status", "path.phase")
        )
        self._trip = [v.name for v in plant.table.of("output") if not v.is_float].index("trip")

    def post(self, step: int) -> None:
        """See what the last step brought, and set the inputs of the next one."""
        self._step = step
        if self._cancelling is not None:
            self._discard(*self._cancelling)
        if self._override is not self._applied:
            self._apply(step)
        if self._waiting is not None:
            self._watch(step)
        if self._job is not None:
            self._attend(self._job, step)

    def _apply(self, step: int) -> None:
        override = self._override
        self._planner.inputs[self._feed] = override.input
        self._planner.write()
        if override.input != self._applied.input:
            self._end = None
            self._nominal_from = step * self._size if override.input == 1.0 else np.inf
        if override.stops != self._applied.stops:
            self._planner.set({"task.cancel": override.stops})
            self._cancelling = override.stops, int(self._planner.integers[self._cancelled])
        self._applied = override

    def _discard(self, stop: int, before: int) -> None:
        """See what a stop has cancelled: what waited, else what was being planned. Of a hold, `_end` is unknown."""
        self._cancelling = None
        count = int(self._planner.integers[self._cancelled]) - before
        if count and self._waiting is not None:
            self._waiting = None
            self._rest = self._place
        elif count and self._job is not None:
            job, self._job, self._posted = self._job, None, False
            job.verdict = "cancelled"
        self._discarded = stop, count

    def _watch(self, step: int) -> None:
        """Whether the plan that waited has begun: the arc length never falls on a path."""
        before, self._arc = self._arc, float(self._planner.outputs[self._arc_column])
        if self._arc < before and self._waiting is not None:
            job, begun = self._waiting
            self._waiting = None
            self._begin(job, begun._replace(step=step))

    def _attend(self, job: _Job, step: int) -> None:
        planner = self._planner
        decided = int(planner.integers[self._count]), int(planner.integers[self._refused])
        if self._posted and decided != self._before:
            self._posted, self._job = False, None
            job.verdict = self._decided(job, step)
            return
        self._before = decided
        self._moving = bool(planner.integers[self._phase])
        self._arc = float(planner.outputs[self._arc_column])
        if self._posted:
            return
        applied = self._applied
        late = job.stops < applied.stops
        if applied.stopped or late or self._plant.integers[self._trip]:
            self._job = None
            job.verdict = "stopped" if applied.stopped else "cancelled" if late else "tripped"
            return
        planner.inputs[self._task_columns] = job.inputs
        planner.write()
        self._trigger = 3 - self._trigger  # 1 and 2 by turns: any value but the last one asks
        planner.set({"task.trigger": self._trigger})
        self._posted = True

    def _decided(self, job: _Job, step: int) -> _Verdict:
        planner = self._planner
        status, count = int(planner.integers[self._status]), int(planner.integers[self._count])
        outputs = {name: float(planner.outputs[column]) for name, column in self._plan_floats.items()}
        outputs |= {"plan.status": status, "plan.count": count}
        if count == self._before[0]:
            return _Verdict(step, outputs, waits=False, start_time=None)
        self._rest = job.task.place
        waits = self._moving
        start = self._end if waits else (step - 1) * self._size
        nominal = (step - 1) * self._size - self._nominal_from >= FEED_SETTLED
        if not nominal or self._scenario.communication_step_ms > 1:  # a longer step may be over before it begins
            start = None
        self._end = None if start is None else start + _whole_ms(job.dwell) + outputs["plan.duration"]
        planned = outputs["plan.corner_deviation_pick"], outputs["plan.corner_deviation_place"]
        begun = Begun(step, count, job.task, job.declared, planned)
        if waits:
            self._waiting = job, begun
            self._watch(step)
        else:
            self._begin(job, begun)
        return _Verdict(step, outputs, waits, start)

    def _begin(self, job: _Job, begun: Begun) -> None:
        """A plan runs, and its load is in the gripper: from this exchange on the torque that the planner gives counts on it."""
        self._place = job.task.place
        self._tally.begun.append(begun)
        self._plant.set({"payload.mass": job.payload})

    # The side of Zenoh's threads

    @property
    def time(self) -> float:
        """Simulation time by which an override that is given now is in force [s]."""
        return (self._step + 1) * self._size

    def end(self) -> None:
        """End with the step that runs."""
        self.ended = True

    def override(self, command: Command, value: float | None) -> FeedFacts:
        """Take hold, resume, stop or feed."""
        match command:
            case "hold":
                self._override = self._override._replace(held=True)
            case "stop":
                self._override = self._override._replace(held=True, stopped=True, stops=self._override.stops + 1)
            case "resume":
                self._override = self._override._replace(held=False, stopped=False)
            case _:
                self._override = self._override._replace(value=float(value or 0.0))
        return FeedFacts(value=self._override.value, held=self._override.held, stopped=self._override.stopped)

    def discarded(self) -> int | None:
        """How many requests the last stop has discarded; waits for the planner, two steps."""
        stops, deadline = self._override.stops, time.monotonic() + VERDICT_TIMEOUT
        while self._discarded[0] < stops and not self._late(deadline):
            time.sleep(POLL)
        stop, count = self._discarded
        return count if stop >= stops else None

    def ppo(self, request: PpoRequest) -> Reply:
        """Plan with the kernel what nobody waits for, then ask the planner in the step loop: its verdict counts."""
        scenario, stops = self._scenario, self._override.stops
        task = Task(
            pick=request.pick or self._rest,
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
            foreseen = _Refusal.of(error)  # the planner will say so too, and publish it
        else:
            try:
                plan.require_within(scenario.limits)
            except InfeasibleError as error:
                return _Refusal.of(error).reply(self.time)
        inputs = task_inputs(task) | {"task.dwell": request.dwell or 0.0, "payload.mass": declared}
        values = np.array([inputs[name] for name in TASK_INPUTS])
        job = _Job(task, values, request.dwell or 0.0, declared, real, stops)
        return self._ask(job, foreseen)

    def _ask(self, job: _Job, foreseen: _Refusal | None) -> Reply:
        """Hand a job to the loop, and wait for what comes of it."""
        deadline = time.monotonic() + VERDICT_TIMEOUT
        while self._job is not None and not self._late(deadline):  # one that was given up is still there
            time.sleep(POLL)
        if self._job is None:
            self._job = job
        while job.verdict is None and not self._late(deadline):
            time.sleep(POLL)  # to be woken would cost the loop a system call
        match job.verdict:
            case None:
                reason = "the cell ends" if self.ended else f"the planner has not decided within {VERDICT_TIMEOUT:g} s: it may yet"
                return Reply(command="ppo", accepted=False, outcome="failed", time=self.time, reason=reason)
            case "stopped":
                reason = "the cell is stopped: resume it first"
                return Reply(command="ppo", accepted=False, outcome="stopped", time=self.time, reason=reason)
            case "cancelled":
                reason = "the cell was stopped before this was planned: resume it and ask again"
                return Reply(command="ppo", accepted=False, outcome="stopped", time=self.time, reason=reason)
            case str():
                reason = "the plant has tripped: its brakes are on until the cell is started again"
                return Reply(command="ppo", accepted=False, outcome="tripped", time=self.time, reason=reason)
            case verdict:
                return self._answer(verdict, foreseen)

    def _late(self, deadline: float) -> bool:
        return self.ended or time.monotonic() > deadline

    def _answer(self, verdict: _Verdict, foreseen: _Refusal | None) -> Reply:
        outputs, at = verdict.outputs, verdict.step * self._size
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
            return Reply(command="ppo", accepted=True, outcome="accepted", time=at, plan=plan)
        if foreseen is None or foreseen.facts.status != status:  # what only the planner knows, such as `busy`
            required, available = outputs["plan.required"], outputs["plan.available"]
            facts = RefusedPlan(status=status, phase="idle", joint=0, required=required, available=available)
            foreseen = _Refusal(status_sentence(status, required, available), facts)
        return foreseen.reply(at)


def _pair(given: float | Pair | None, otherwise: Pair) -> Pair:
    """A pair as given, of one value, or the scenario's."""
    if given is None:
        return otherwise
    return given if isinstance(given, tuple) else (given, given)


def _whole_ms(dwell: float) -> float:
    """A dwell as the planner rounds it: up to whole milliseconds, with the kernel's tolerance [s]."""
    return float(np.ceil(1000.0 * dwell - 1e-6)) / 1000.0


class _Journal:
    """Says on standard error what becomes of commands: all that is accepted, and of refusals one a second."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._last, self._silent = -JOURNAL_PERIOD, 0

    def __call__(self, line: str) -> None:
        with self._lock:
            if " refused " in line:
                now = self._clock()
                if now - self._last < JOURNAL_PERIOD:
                    self._silent += 1
                    return
                self._last = now
            more = f" (and {self._silent} refused since the last line)" if self._silent else ""
            self._silent = 0
        sys.stderr.write(f"{line}{more}\n")
        sys.stderr.flush()


@contextmanager
def _ending(end: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C and the wish to terminate call `end`; a second one interrupts."""
    numbers = [n for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.getsignal(number) for number in numbers}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def on_signal(_number: int, _frame: Any) -> None:
        restore()
        end()

    for number in numbers:
        signal.signal(number, on_signal)
    try:
        yield
    finally:
        restore()


def serve_scenario(path: Path, options: Options, console: Console, log: Console) -> dict[str, Any]:
    """Serve a cell until Ctrl-C or a request to terminate, and print the summary.

    Args:
        path: the scenario: robot, law, drives, the point where the robot rests first, and what a command leaves out.
        options: how to run it.
        console: for the summary.
        log: for remarks.

    Returns:
        the JSON report.

    Raises:
        DeltaphError: the scenario or the machine do not allow it.
    """
    scenario = load_cell(path, options)
    if scenario.parts or scenario.feed:
        table = "[sequence]" if scenario.parts else "[[feed]]"
        raise DeltaphError(f"{path}: {table} is not for --serve, which does what commands say: leave one of them out")
    Plan.of(scenario).require_within(scenario.limits)  # what commands leave out comes from a task that is possible
    with log.status("building the FMUs"):
        fmus = cached_fmus()
    tally = Tally(deviation_tolerance(scenario))
    attendant = Attendant(scenario, tally)
    with ExitStack() as stack:
        # opened first, closed last: the cell does not stay while its recording is finished
        recorder, recording = open_recorder(scenario, options.record, log, stack, serves=True) if options.record else (None, None)
        publisher, publishing = open_publisher(scenario, options, log, stack, serves=True)
        counting = BackgroundSink(tally, QUEUE_FRAMES, poll=0.05)
        stack.callback(counting.close)
        sinks = [sink for sink in (publishing, recording, counting) if sink is not None]
        service = CommandService(publisher.session, scenario.cell, attendant, _Journal())
        stack.callback(service.close)
        stack.callback(attendant.end)  # a PPO that is under way when the loop fails is not waited for
        frames = RecentFrames()
        stepping = attend(
            scenario,
            fmus,
            attendant,
            realtime=options.realtime or Undisturbed(),
            dropped=lambda: sum(sink.dropped for sink in sinks),
            frames=frames,
        )
        log.print("takes commands: see `deltaph command --help`; Ctrl-C ends it", style="dim", soft_wrap=True)
        with _ending(attendant.end):
            for frame in stepping:
                for sink in sinks:
                    sink.take(frame)
                frames.commands = service.counts
        service.close()
        for sink in sinks:
            sink.drain()
        counting.close()
        facts = {
            "scenario": str(path),
            "law": scenario.law.name,
            "communication_step_s": scenario.communication_step_ms / 1000.0,
            **tally.facts(),
            "commands": {
                command: {outcome: n for outcome, n in zip(OUTCOMES, row, strict=True) if n}
                for command, row in zip(COMMANDS, service.counts.tolist(), strict=True)
            },
            "telemetry": {"published": publisher.published, "dropped": publishing.dropped},
            "recording": str(options.record) if options.record is not None else None,
            "provenance": provenance_facts(scenario),
        }
        publisher.set_summary(json.dumps(facts))
        if recorder is not None:
            recorder.summary(
                serving_markdown(scenario, facts), json.dumps(facts), served_marks(facts), served_scene(scenario, facts)
            )
    print_serving(console, scenario, facts)
    if options.record is not None:
        log.print(f"recorded {options.record}: open it with `deltaph view {options.record}`", style="dim", soft_wrap=True)
    return facts
