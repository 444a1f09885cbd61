"""`deltaph soak`: a cell in real time while its consumers stop, die and fail, each beside a bare loop of the same length."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from deltaph.errors import DeltaphError, EnvironmentProblem
from deltaph.plan import Plan
from deltaph.scenario import Scenario, parse_scenario, template
from deltaph.soak_peer import FLOOD_SECONDS, STREAMING
from deltaph.telemetry.session import free_endpoint

BARE_SECONDS = 60.0
"""The bare loop beside each case runs as long as that, at most so long: a machine misses few deadlines, and not evenly."""

START_TIMEOUT = 60.0
"""For a process to be ready; the FMUs may have to be compiled [s]."""

GROWTH_AFTER = 60.0
"""Memory may grow until then: caches fill, threads get their stacks [s]."""


@dataclass
class Observed:
    """What came of one case.

    Attributes:
        name: of the case.
        cell: the cell's own report.
        bare: the report of the bare loop beside it.
        subscriber: what the subscriber that lasted to the end got.
        commands: what became of those that were sent; None where the case has none.
        growth: of the resident memory after the first minute, by process [MB]; empty where the case is shorter.
        failures: what should not be.
    """

    name: str
    cell: dict[str, Any]
    bare: dict[str, Any]
    subscriber: dict[str, Any]
    commands: dict[str, Any] | None = None
    growth: dict[str, float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)


def _resident(pid: int) -> float | None:
    """Resident memory of a process and those that it has started [MB]; None where it is gone."""
    pages = 0
    for process in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[1])
            if pid in (int(process.name), parent):
                pages += int((process / "statm").read_text(encoding="ascii").split()[1])
        except OSError:  # it ended meanwhile
            continue
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6 if pages else None


def _growth(samples: Sequence[float]) -> float:
    """From the first quarter of samples to the last; their medians, as memory goes up and down with each chunk that is written."""
    quarter = max(1, len(samples) // 4)
    return float(np.median(samples[-quarter:]) - np.median(samples[:quarter]))


class _Stage:
    """The processes of one case, killed at its end at the latest."""

    def __init__(self, directory: Path, scenario: Path, cell: str, priority: int | None, stack: ExitStack) -> None:
        self.directory = directory
        self._priority = [] if priority is None else ["--realtime-priority", str(priority)]
        self.endpoint = free_endpoint()
        self.cell = cell
        self._scenario = scenario
        self._stack = stack
        self.processes: dict[str, subprocess.Popen[str]] = {}

    def start(self, name: str, arguments: Sequence[str], *, ready: bool = False, file_size: int | None = None) -> None:
        """Start `python -m ...`; its output goes to a file of its name.

        Args:
            name: of the process.
            arguments: from the module's name on.
            ready: it says so, which is waited for.
            file_size: the largest file it may write, as on a disk that is full [bytes].
        """
        log = self.directory / f"{name}.log"
        command = [sys.executable, "-P", "-m", *arguments]  # what lies in the working directory is not meant
        with log.open("w", encoding="utf-8") as stream:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=stream, stderr=subprocess.STDOUT, text=True)
        self._stack.callback(self._end, process)
        if file_size is not None:
            import resource  # not on every system

            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (file_size, file_size))
        self.processes[name] = process
        if ready:
            self._await_line(name, STREAMING)

    def run(self, seconds: float, cycle: float, options: Sequence[str], name: str = "cell") -> None:
        """Start a cell that runs in real time for at least so long."""
        cycles = math.ceil(seconds / cycle)
        report = self.directory / f"{name}.json"
        arguments = ["deltaph", "run", str(self._scenario), "--realtime", "--cycles", str(cycles), "--json", str(report)]
        self.start(name, [*arguments, *self._priority, *options])

    def serve(self) -> None:
        """Start a cell that takes commands until it is told to end."""
        report = self.directory / "cell.json"
        arguments = ["deltaph", "run", str(self._scenario), "--serve", "--json", str(report), "--listen", self.endpoint]
        self.start("cell", [*arguments, *self._priority, "--wait-subscribers", "1"])

    def subscribe(self, name: str = "subscriber", endpoint: str | None = None) -> None:
        """Start a subscriber; it waits for the cell."""
        report = str(self.directory / f"{name}.json")
        self.start(name, ["deltaph.soak_peer", "subscriber", endpoint or self.endpoint, self.cell, report])

    def await_streaming(self, name: str = "subscriber") -> None:
        """Wait for a subscriber's first message."""
        self._await_line(name, STREAMING)

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal."""
        self.processes[name].send_signal(number)

    def kill(self, name: str) -> None:
        """Kill, and wait for the end."""
        self._end(self.processes[name])

    def finish(self, name: str, timeout: float) -> int:
        """Wait for a process to end by itself; returns its exit code."""
        try:
            return self.processes[name].wait(timeout)
        except subprocess.TimeoutExpired:
            raise EnvironmentProblem(f"the {name} of the soak did not end within {timeout:.0f} s: {self.said(name)}") from None

    def said(self, name: str) -> str:
        """The last line that a process printed."""
        lines = (self.directory / f"{name}.log").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"

    def report(self, name: str) -> dict[str, Any]:
        """The report that a process wrote.

        Raises:
            EnvironmentProblem: it wrote none.
        """
        try:
            facts: dict[str, Any] = json.loads((self.directory / f"{name}.json").read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise EnvironmentProblem(f"the {name} of the soak ended without a report: {self.said(name)}") from None
        return facts

    def _await_line(self, name: str, line: str) -> None:
        deadline = time.monotonic() + START_TIMEOUT
        log = self.directory / f"{name}.log"
        while line not in log.read_text(encoding="utf-8", errors="replace").splitlines():
            if self.processes[name].poll() is not None or time.monotonic() > deadline:
                raise EnvironmentProblem(f"the {name} of the soak is not ready: {self.said(name)}")
            time.sleep(0.02)

    @staticmethod
    def _end(process: subprocess.Popen[str]) -> None:
        if process.poll() is None:
            process.kill()
        process.wait()
        if process.stdin is not None:
            process.stdin.close()


def _stopped(seconds: float) -> Callable[[_Stage], None]:
    def act(stage: _Stage) -> None:
        stage.signal("subscriber", signal.SIGSTOP)
        time.sleep(seconds)
        stage.signal("subscriber", signal.SIGCONT)

    return act


def _killed(stage: _Stage) -> None:
    stage.kill("subscriber")
    time.sleep(1.0)
    stage.subscribe()
    stage.await_streaming()


def _router_killed(stage: _Stage) -> None:
    stage.kill("router")
    time.sleep(2.0)
    _start_router(stage)


def _start_router(stage: _Stage) -> None:
    stage.start("router", ["deltaph.soak_peer", "router", stage.endpoint], ready=True)


def _commanded(kind: str) -> Callable[[_Stage], None]:
    def act(stage: _Stage) -> None:
        stage.start("commands", ["deltaph.soak_peer", kind, stage.endpoint, stage.cell, str(stage.directory / "commands.json")])
        stage.finish("commands", FLOOD_SECONDS + START_TIMEOUT)
        time.sleep(1.0)  # it goes on undisturbed
        stage.signal("cell", signal.SIGINT)

    return act


DISK_BYTES = 2_000_000
"""Room for a few seconds of recording."""


@dataclass(frozen=True, slots=True)
class _Case:
    """A disturbance.

    Attributes:
        name: what happens.
        seconds: how long the cell runs, at least; one that serves runs until it is told to end.
        act: what is done, one second after the subscriber has its first message.
        router: the cell and the subscriber meet at a router.
        disk: a recorder without room on its disk is there as well.
        serves: the cell takes commands; `act` ends it.
    """

    name: str
    seconds: float
    act: Callable[[_Stage], None]
    router: bool = False
    disk: bool = False
    serves: bool = False


CASES = (
    _Case("subscriber stopped for 5 s", 9.0, _stopped(5.0)),
    _Case("subscriber stopped for 20 s", 26.0, _stopped(20.0)),
    _Case("subscriber killed and restarted", 8.0, _killed),
    _Case("router killed and restarted", 12.0, _router_killed, router=True),
    _Case("no room for the recorder", 8.0, lambda _: None, disk=True),
    _Case("a flood of commands", FLOOD_SECONDS + 2.0, _commanded("flood"), serves=True),
    _Case("malformed commands", FLOOD_SECONDS + 2.0, _commanded("malformed"), serves=True),
)


def _lost(observed: Observed) -> list[str]:
    """What is wrong with what the subscriber got: the cell keeps all that any case disturbs, so that nothing is lost for good."""
    got, failures = observed.subscriber, []
    if not got["summary"]:
        failures.append("the subscriber did not get the summary")
    failures += [f"{seen['missing']} {name} lost" for name, seen in got["messages"].items() if seen["missing"]]
    for name in ("setpoint", "actual", "timing"):
        seen = got["messages"].get(name)
        if seen is None:
            failures.append(f"no {name} came")
            continue
        if seen["out_of_order"]:
            failures.append(f"{seen['out_of_order']} {name} out of order")
        if seen["last"] != observed.cell["steps"]:
            failures.append(f"the last {name} is {seen['last']} of {observed.cell['steps']}: service did not resume")
        if seen["received"] + seen["missing"] != observed.cell["steps"] + 1:
            failures.append(f"{name}: {seen['received']} received and {seen['missing']} missing are not all that was sent")
    return failures


def _unanswered(commands: dict[str, Any], cell: dict[str, Any], *, malformed: bool) -> list[str]:
    """What is wrong with what became of commands: each is answered once and counted, unless it is malformed and means none."""
    failures = []
    if not malformed and commands["answered"] != commands["sent"]:
        failures.append(f"{commands['answered']} of {commands['sent']} commands were answered")
    counted = sum(sum(outcomes.values()) for outcomes in cell["commands"].values())
    answered = commands["answered"] + 2 * commands["holds"]
    if counted != answered:
        failures.append(f"the cell counted {counted} commands, {answered} were answered")
    if malformed and commands["accepted"]:
        failures.append(f"{commands['accepted']} malformed commands were accepted")
    if not malformed and not commands["accepted"]:
        failures.append("none of the commands was accepted")
    return failures


def _undisturbed(minutes: float) -> str:
    return f"undisturbed, {minutes:g} min"


class Soak:
    """Runs the cases.

    Args:
        directory: for reports, logs and recordings.
        console: for progress.
        priority: of the step loops, see `Undisturbed`; None is that of `deltaph run --realtime`.
    """

    def __init__(self, directory: Path, console: Console, priority: int | None) -> None:
        self._priority = priority
        self._console = console
        self._directory = directory
        self._scenario_file = directory / "scenario.toml"
        self._scenario_file.write_text(template(), encoding="utf-8")
        self._scenario: Scenario = parse_scenario(template(), self._scenario_file)
        self._cycle = 2.0 * Plan.of(self._scenario).duration  # the way back takes as long

    def undisturbed(self, minutes: float) -> Observed:
        """A subscriber and a recorder, and nothing happens."""
        name, seconds = _undisturbed(minutes), 60.0 * minutes
        bare = self._bare(name, seconds)
        with ExitStack() as stack:
            stage = self._stage(name, stack)
            stage.subscribe()
            recording = stage.directory / "soak.rrd"
            stage.start("recorder", ["deltaph", "record", "-o", str(recording), "--connect", stage.endpoint, "--cell", stage.cell])
            stage.run(seconds, self._cycle, ["--listen", stage.endpoint, "--wait-subscribers", "2"])
            stage.await_streaming()
            begin = time.monotonic()
            memory: dict[str, list[float]] = {process: [] for process in stage.processes}
            with self._console.status(name) as status:
                while stage.processes["cell"].poll() is None:
                    passed = time.monotonic() - begin
                    status.update(f"{name}: {passed:.0f} s of {seconds:.0f} s")
                    # what the cell does after its last step, the evaluation, is no part of the loop
                    if GROWTH_AFTER <= passed < seconds - 1.0:
                        for process, samples in memory.items():
                            if (now := _resident(stage.processes[process].pid)) is not None:
                                samples.append(now)
                    time.sleep(1.0)
            observed = self._observe(name, stage, bare, seconds)
            if stage.finish("recorder", 60.0 + seconds) != 0 or " no messages lost" not in " ".join(
                (stage.directory / "recorder.log").read_text(encoding="utf-8").split()
            ):
                observed.failures.append(f"the recorder lost something: {stage.said('recorder')}")
        observed.growth = {process: _growth(samples) for process, samples in memory.items() if samples}
        observed.failures += _lost(observed)
        return observed

    def disturbed(self, case: _Case) -> Observed:
        """One disturbance."""
        bare = self._bare(case.name, case.seconds)
        with ExitStack() as stack, self._console.status(case.name):
            stage = self._stage(case.name, stack)
            if case.router:
                _start_router(stage)
            stage.subscribe()
            waited = 1
            if case.disk:
                recording = str(stage.directory / "soak.rrd")
                arguments = ["deltaph", "record", "-o", recording, "--connect", stage.endpoint, "--cell", stage.cell]
                stage.start("recorder", arguments, file_size=DISK_BYTES)
                waited += 1
            if case.serves:
                stage.serve()
            else:
                where = "--connect" if case.router else "--listen"
                listen = ["--listen", free_endpoint()] if case.router else []
                stage.run(case.seconds, self._cycle, [where, stage.endpoint, *listen, "--wait-subscribers", str(waited)])
            stage.await_streaming()
            time.sleep(1.0)
            case.act(stage)
            observed = self._observe(case.name, stage, bare, case.seconds)
            if case.disk and (code := stage.finish("recorder", 60.0)) != 2:
                observed.failures.append(f"the recorder without room ended with {code}: {stage.said('recorder')}")
            if case.serves:
                observed.commands = stage.report("commands")
                observed.failures += _unanswered(observed.commands, observed.cell, malformed="malformed" in case.name)
        observed.failures += _lost(observed)
        return observed

    def _stage(self, name: str, stack: ExitStack) -> _Stage:
        directory = self._directory / name.replace(" ", "_").replace(",", "")
        directory.mkdir(exist_ok=True)
        return _Stage(directory, self._scenario_file, self._scenario.cell, self._priority, stack)

    def _bare(self, name: str, seconds: float) -> dict[str, Any]:
        seconds = min(seconds, BARE_SECONDS)
        with ExitStack() as stack, self._console.status(f"{name}: the bare loop"):
            stage = self._stage(name, stack)
            stage.run(seconds, self._cycle, ["--no-telemetry"], name="bare")
            stage.finish("bare", seconds + START_TIMEOUT)
            return stage.report("bare")

    def _observe(self, name: str, stage: _Stage, bare: dict[str, Any], seconds: float) -> Observed:
        stage.finish("cell", seconds + START_TIMEOUT)
        stage.finish("subscriber", START_TIMEOUT)
        return Observed(name, stage.report("cell"), bare, stage.report("subscriber"))


def _per_minute(facts: dict[str, Any]) -> float:
    return 60_000.0 * float(facts["timing"]["missed_deadlines"]) / float(facts["steps"])


def _loop_figures(observed: Observed) -> tuple[tuple[float, float], ...]:
    """Lateness, median and 99.9 % [us], and missed deadlines a minute: of the cell, of the bare loop."""
    cell, bare = observed.subscriber["lateness_us"], observed.bare["timing"]["lateness_us"]
    missed = _per_minute(observed.cell), _per_minute(observed.bare)
    return (cell["p50"], bare["p50"]), (cell["p999"], bare["p999"]), missed


def _print_loop(console: Console, found: Sequence[Observed]) -> None:
    """What the loop noticed, beside the bare loop."""
    heads = (column for name in ("late (us) p50", "p99.9", "missed/min") for column in (name, "bare", "ratio"))
    table = Table("in real time", *heads, box=None, pad_edge=False)
    ratios: list[list[float]] = []
    for observed in found:
        figures = _loop_figures(observed)
        ratios.append([cell / bare if bare else math.nan for cell, bare in figures])
        texts = (f"{cell:.3f}" if k == 0 else f"{cell:.0f}" for k, pair in enumerate(figures) for cell in pair)
        table.add_row(observed.name, *_triples(texts, ratios[-1]))
    table.add_row("median of the ratios", *_triples([""] * 6, np.nanmedian(ratios, axis=0).tolist()))
    console.print(table)


def _triples(texts: Iterable[str], ratios: Sequence[float]) -> Iterator[str]:
    """Cells of the table: two texts and a ratio, again and again."""
    values = iter(texts)
    for ratio in ratios:
        yield from (next(values), next(values), "-" if math.isnan(ratio) else f"{ratio:.2f}")


def _print_messages(console: Console, found: Sequence[Observed]) -> None:
    """What came of the messages, and what handing them over cost."""
    table = Table("messages", "steps", "received", "lost", "pause (s)", "hand over (us) p50", "p99.9", box=None, pad_edge=False)
    for observed in found:
        seen = observed.subscriber["messages"].values()
        handing = observed.subscriber["publish_us"]
        table.add_row(
            observed.name,
            f"{observed.cell['steps']}",
            f"{sum(message['received'] for message in seen)}",
            f"{sum(message['missing'] for message in seen)}",
            f"{observed.subscriber['longest_pause_s']:.2f}",
            f"{handing['p50']:.1f}",
            f"{handing['p999']:.0f}",
        )
    console.print(table)


def _print_commands(console: Console, found: Sequence[Observed]) -> None:
    """What came of the commands."""
    table = Table("commands", "sent", "answered", "accepted", "hold answered within (ms)", box=None, pad_edge=False)
    for observed in found:
        if (told := observed.commands) is not None:
            counts = (f"{told[what]}" for what in ("sent", "answered", "accepted"))
            table.add_row(observed.name, *counts, f"{1e3 * told['hold_max_s']:.1f}")
    console.print(table)


def run_soak(minutes: float, priority: int | None, console: Console, log: Console) -> tuple[list[Observed], dict[str, str]]:
    """Run all cases and print the table. A case that cannot be run to its end does not end the others.

    Args:
        minutes: of the undisturbed case; the others have their own lengths, one and a half minutes together.
        priority: of the step loops, see `Undisturbed`; None is that of `deltaph run --realtime`.
        console: for the table.
        log: for progress.

    Returns:
        what came of the cases, and why others, by name, could not be run to their ends.

    Raises:
        DeltaphError: it is too short, or not possible on this system.
    """
    if not 0.05 <= minutes < math.inf:
        raise DeltaphError(f"--minutes is {minutes:g}: give at least 0.05")
    if sys.platform != "linux":
        raise EnvironmentProblem("only Linux lets a process limit another's files and tells its memory: soak there")
    with tempfile.TemporaryDirectory(prefix="deltaph-soak-") as directory:
        soak = Soak(Path(directory), log, priority)
        cases = {_undisturbed(minutes): partial(soak.undisturbed, minutes)}
        cases |= {case.name: partial(soak.disturbed, case) for case in CASES}
        found: list[Observed] = []
        ended: dict[str, str] = {}
        for name, run in cases.items():
            try:
                found.append(run())
            except DeltaphError as error:
                ended[name] = str(error)
    if found:
        _print_loop(console, found)
        _print_messages(console, found)
        _print_commands(console, found)
    for observed in found:
        if observed.growth:
            grown = ", ".join(f"{process} {value:+.1f} MB" for process, value in observed.growth.items())
            console.print(f"{observed.name}: memory after the first minute: {grown}", soft_wrap=True)
    failures = [(observed.name, failure) for observed in found for failure in observed.failures]
    for name, failure in (*failures, *ended.items()):
        console.print(f"[bold red]{name}[/]: {failure}", soft_wrap=True)
    return found, ended
