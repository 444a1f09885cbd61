"""The main job: scenario in; frames, telemetry, recording, summary and verdict out."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import Progress

from deltaph.checks import evaluate_expectations, executed_values, planned_values
from deltaph.errors import DeltaphError
from deltaph.execution import Trace, evaluate
from deltaph.fmu import cached_fmus
from deltaph.frame import Frame, Frames
from deltaph.importer import cosimulate
from deltaph.pacing import Undisturbed
from deltaph.recorder import finish, open_recorder, record_summary
from deltaph.report import executed_facts, operation_facts, plan_facts, print_run, sequence_facts, timing_facts
from deltaph.scenario import Scenario, load_scenario
from deltaph.schedule import Schedule, schedule
from deltaph.sinks import Sinks
from deltaph.telemetry import CellKeys, Publisher, SinkProcess
from deltaph.verdict import provenance_facts

if TYPE_CHECKING:
    from deltaph.telemetry import Recorder

PROGRESS_STEPS = 100
"""Steps between two updates of the progress bar."""

SUBSCRIBER_TIMEOUT = 60.0
"""How long `--wait-subscribers` waits [s]."""

QUEUE_FRAMES = 20_000
"""Frames that may wait for a sink: 20 s at 1 kHz, some 20 MB."""

SLOW_POLL = 0.05
"""Between two looks of a sink from which nobody expects an answer at once [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How to run a scenario; see `deltaph run --help`."""

    record: Path | None = None
    realtime: Undisturbed | None = None
    cycles: int | None = None
    telemetry: bool = True
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    wait_subscribers: int = 0
    zenoh_config: Path | None = None
    cell: str | None = None

    @property
    def session(self) -> dict[str, Any]:
        """What a publisher is told about its session."""
        return {"listen": self.listen, "connect": self.connect, "config": self.zenoh_config}


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a run.

    Attributes:
        frames: all of them.
        facts: the JSON report.
        ok: every expectation is met, and the plant tripped only if it was expected to.
        errors: what sinks failed at.
    """

    frames: Sequence[Frame]
    facts: dict[str, Any]
    ok: bool
    errors: tuple[DeltaphError, ...]


def run_scenario(path: Path, options: Options, console: Console, log: Console) -> Result:
    """Run a scenario file and print its summary.

    Args:
        path: the scenario.
        options: how to run it.
        console: for the summary.
        log: for progress and remarks.

    Raises:
        DeltaphError: the scenario, the plan or the machine do not allow it; nothing is left half-written. What a sink fails at
            while the cell runs is in the result.
    """
    scenario = load_cell(path, options)
    run = schedule(scenario, options.cycles)
    run.require_within(scenario.limits)
    with log.status("building the FMUs"):
        fmus = cached_fmus()
    with Sinks(log, scenario.communication_step_ms, lambda _: "the run goes on without it") as sinks:
        # opened first, closed last: the cell does not stay while its recording is finished
        recorder = recording(options.record, scenario, log, sinks, serves=False) if options.record else None
        publisher = sinks.add(_publishing(scenario, options)) if options.telemetry else None
        sinks.await_open()
        if publisher is not None:
            await_subscribers(publisher, scenario, options, log)

        frames = Frames(run.steps + 1)
        stepping = cosimulate(scenario, run, fmus, realtime=options.realtime, dropped=lambda: sinks.dropped, frames=frames)
        # where it is interrupted, what it asks of the system is undone before the sinks are finished
        with closing(stepping), closing(_with_progress(stepping, run, log)) as shown:
            for frame in shown:
                sinks.take(frame)

        trace = Trace(frames)
        execution = evaluate(trace, run)
        values = planned_values(run) | executed_values(execution)
        checks = evaluate_expectations(scenario.expect, values, execution.trip)
        facts = {
            "scenario": str(path),
            "law": scenario.law.name,
            "steps": run.steps,
            "communication_step_s": run.communication_step_ms / 1000.0,
            "plan": plan_facts(run.operations[0].plan),
            "sequence": sequence_facts(scenario, run),
            "operations": operation_facts(run, execution),
            "executed": executed_facts(execution),
            "timing": timing_facts(trace, options.realtime),
            "telemetry": telemetry_facts(publisher, sinks),
            "recording": str(options.record) if options.record is not None else None,
            "expect": [check.as_dict() for check in checks],
            "provenance": provenance_facts(scenario),
        }
        if publisher is not None:
            publisher.tell(methodcaller("set_summary", json.dumps(facts)))
        if recorder is not None:
            recorder.tell(partial(record_summary, scenario=scenario, facts=facts))

    facts["recording"] = recording_fact(options.record)  # one that failed has gone
    print_run(console, scenario, run, facts, execution, checks)
    if recorder is not None and not recorder.failed:
        log.print(f"recorded {options.record}: open it with `deltaph view {options.record}`", style="dim", soft_wrap=True)
    return Result(frames, facts, all(check.ok for check in checks), sinks.errors)


def load_cell(path: Path, options: Options) -> Scenario:
    """The scenario, under the name that the cell is to have.

    Raises:
        DeltaphError: the scenario or the name is none.
    """
    scenario = load_scenario(path)
    if options.cell is None:
        return scenario
    try:
        CellKeys(options.cell)
    except ValueError as error:
        raise DeltaphError(str(error)) from error
    return replace(scenario, cell=options.cell)


def _publishing(scenario: Scenario, options: Options) -> SinkProcess[Publisher]:
    return SinkProcess("publisher", partial(Publisher, scenario.cell, scenario.json, **options.session), QUEUE_FRAMES)


def telemetry_facts(publisher: SinkProcess[Any] | None, sinks: Sinks) -> dict[str, int]:
    """The `telemetry` object of the JSON reports, once the publisher has published all that it got."""
    if publisher is None:
        return {"published": 0, "dropped": 0}
    sinks.attempt(partial(publisher.ask, bool))
    return {"published": publisher.taken, "dropped": publisher.dropped}


def recording_fact(path: Path | None) -> str | None:
    """The `recording` of the JSON reports: the file, where there is one."""
    return str(path) if path is not None and path.exists() else None


def await_subscribers(publisher: SinkProcess[Any], scenario: Scenario, options: Options, log: Console) -> None:
    """Say where a cell publishes, and wait until its subscribers are there.

    Raises:
        EnvironmentProblem: they do not come.
    """
    endpoints = publisher.ask(attrgetter("endpoints"))
    log.print(f"cell {scenario.cell} on {', '.join(endpoints)}", style="dim", soft_wrap=True)
    if options.wait_subscribers:
        with log.status(f"waiting for {options.wait_subscribers} subscribers"):
            publisher.ask(methodcaller("wait_for_subscribers", options.wait_subscribers, SUBSCRIBER_TIMEOUT))


def recording(path: Path, scenario: Scenario, log: Console, sinks: Sinks, *, serves: bool) -> SinkProcess[Recorder]:
    """The recorder of a cell."""
    sink = SinkProcess("recorder", partial(open_recorder, path, scenario, serves=serves), QUEUE_FRAMES, SLOW_POLL)
    return sinks.add(sink, partial(finish, sink, log))


def _with_progress(frames: Iterator[Frame], run: Schedule, log: Console) -> Generator[Frame, None, None]:
    """Pass frames on and show how far the run has come, where somebody watches and it takes long enough to see."""
    if not log.is_terminal:
        yield from frames
        return
    with Progress(console=log, transient=True) as progress:
        task = progress.add_task("co-simulating", total=run.steps)
        for frame in frames:
            yield frame
            if frame.step % PROGRESS_STEPS == 0:
                progress.update(task, completed=frame.step)
