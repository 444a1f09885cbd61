"""`deltaph run --serve`: a cell in real time that waits for commands over Zenoh, until it is told to end."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import Any

from rich.console import Console

from deltaph.attendant import Attendant
from deltaph.checks import deviation_tolerance
from deltaph.desk import ServingPublisher
from deltaph.errors import DeltaphError
from deltaph.fmu import cached_fmus
from deltaph.frame import COMMANDS, OUTCOMES, RecentFrames
from deltaph.importer import attend
from deltaph.pacing import Undisturbed
from deltaph.plan import Plan
from deltaph.recorder import record_summary
from deltaph.report import print_serving
from deltaph.run import (
    QUEUE_FRAMES,
    SLOW_POLL,
    Options,
    await_subscribers,
    load_cell,
    recording,
    recording_fact,
    telemetry_facts,
)
from deltaph.sinks import Sinks
from deltaph.tally import Begun, Tally
from deltaph.telemetry import CommandCounts, SinkProcess, line
from deltaph.verdict import provenance_facts


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


def serve_scenario(path: Path, options: Options, console: Console, log: Console) -> tuple[dict[str, Any], tuple[DeltaphError, ...]]:
    """Serve a cell until Ctrl-C, a request to terminate or the death of its publisher, and print the summary.

    Args:
        path: the scenario: robot, law, drives, the point where the robot rests first, and what a command leaves out.
        options: how to run it.
        console: for the summary.
        log: for remarks.

    Returns:
        the JSON report, in which `plans`, `executed` and `timing` are None where the tally is lost; and what sinks failed at.

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

    def missed(sink: SinkProcess[Any]) -> str:
        if sink is not publisher:
            return "the cell goes on without it"
        attendant.end()
        return "nobody can command the cell any more, and it ends"

    with Sinks(log, scenario.communication_step_ms, missed) as sinks:
        # opened first, closed last: the cell does not stay while its recording is finished
        recorder = recording(options.record, scenario, log, sinks, serves=True) if options.record else None
        counts = CommandCounts()
        (ask_override, overrides), (ask_task, tasks) = line(), line()
        document = json.dumps({**json.loads(scenario.json), "serves": True})
        open_publisher = partial(ServingPublisher, scenario, document, ask_override, ask_task, counts, **options.session)
        publisher = sinks.add(SinkProcess("publisher", open_publisher, QUEUE_FRAMES))
        ask_override.close()
        ask_task.close()
        realtime = options.realtime or Undisturbed()
        open_tally = partial(Tally, deviation_tolerance(scenario), realtime.priority)
        tally = sinks.add(SinkProcess("tally", open_tally, QUEUE_FRAMES, SLOW_POLL))
        sinks.await_open()
        await_subscribers(publisher, scenario, options, log)

        def begin(begun: Begun) -> None:
            tally.tell(methodcaller("begin", begun))

        attendant = Attendant(scenario, overrides, tasks, begin)
        frames = RecentFrames()
        frames.commands = counts.array
        stepping = attend(
            scenario,
            fmus,
            attendant,
            realtime=realtime,
            dropped=lambda: sinks.dropped,
            frames=frames,
        )
        publisher.ask(ServingPublisher.serve)
        log.print("takes commands: see `deltaph command --help`; Ctrl-C ends it", style="dim", soft_wrap=True)
        steps = 0
        # where it is interrupted, what it asks of the system is undone first
        with closing(stepping), _ending(attendant.end):
            for frame in stepping:
                sinks.take(frame)
                steps = frame.step
        overrides.close()
        tasks.close()
        sinks.attempt(partial(publisher.ask, ServingPublisher.end_service))
        counted = sinks.attempt(partial(tally.ask, Tally.facts))
        facts = {
            "scenario": str(path),
            "law": scenario.law.name,
            "communication_step_s": scenario.communication_step_ms / 1000.0,
            **(counted or {"steps": steps, "plans": None, "executed": None, "timing": None}),
            "commands": {
                command: {outcome: n for outcome, n in zip(OUTCOMES, row, strict=True) if n}
                for command, row in zip(COMMANDS, counts.array.tolist(), strict=True)
            },
            "telemetry": telemetry_facts(publisher, sinks),
            "recording": str(options.record) if options.record is not None else None,
            "provenance": provenance_facts(scenario),
        }
        if counted is not None:  # there is no verdict without
            publisher.tell(methodcaller("set_summary", json.dumps(facts)))
            if recorder is not None:
                recorder.tell(partial(record_summary, scenario=scenario, facts=facts))
    facts["recording"] = recording_fact(options.record)  # one that failed has gone
    print_serving(console, scenario, facts)
    if recorder is not None and not recorder.failed:
        log.print(f"recorded {options.record}: open it with `deltaph view {options.record}`", style="dim", soft_wrap=True)
    return facts, sinks.errors
