"""Writes Rerun recordings, from frames or from decoded messages, with the same content. Imports Rerun, which takes a second."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from deltaph.frame import Frame
from deltaph.telemetry.blueprint import blueprint
from deltaph.telemetry.corner import allowed, approaches, executed_entity, marks, near, passes, still_corners, worst
from deltaph.telemetry.destination import Destination, RecordingFile
from deltaph.telemetry.events import EVENT_KINDS, EventWatch, level, sentence
from deltaph.telemetry.keys import FRAME_MESSAGES, MessageName
from deltaph.telemetry.messages import Layout, Records, layout
from deltaph.telemetry.reading import APPLICATION_ID
from deltaph.telemetry.scene import CornerMark, FloatArray, Scene
from deltaph.telemetry.signals import (
    ERROR_STEPS,
    MISSED_DEADLINES,
    PLOT,
    TRACKING_ERRORS,
    Signal,
    every,
    is_held,
    limits,
    signals,
    style,
)
from deltaph.telemetry.world import (
    COMMANDED_PATH,
    CORNERS,
    EXECUTED_PATH,
    POSE_STEPS,
    TRACE_STEPS,
    MovingWorld,
    still_moves,
    still_world,
    trace,
)

_ALL = slice(None)
_LANES: tuple[tuple[str, MessageName, str], ...] = (("phase", "setpoint", "path.phase"), ("trip", "actual", "trip"))


class Recorder:
    """A sink that writes a recording. Rows are written in chunks, and what is left on `close`.

    Chunks end at whole multiples of their length, whichever way the rows come: recordings of one run are equal, chunk by chunk.

    Args:
        destination: file to write, or another place.
        scene: what is known before the run.
        chunk: communication steps that are written at once; the destination's where it is not given.

    Raises:
        EnvironmentProblem: the file cannot be written.
    """

    def __init__(self, destination: Path | Destination, scene: Scene, *, chunk: int | None = None) -> None:
        self._destination = RecordingFile(destination) if isinstance(destination, Path) else destination
        self._chunk = chunk or self._destination.chunk
        self._end = 0  # step at which the chunk ends
        self._frames: list[Frame] = []
        self._messages: dict[MessageName, list[np.void]] = {name: [] for name in FRAME_MESSAGES}
        self._signals = signals(scene)
        self._limits = list(limits(scene))
        self._world = MovingWorld(scene)
        self._waiting = np.empty(0, layout("actual").dtype)  # from the end of the last piece of the trace on
        self._commanded = np.empty(0, layout("setpoint").dtype)  # likewise
        self._lanes: dict[str, int] = {}
        self._watch = EventWatch()
        self._events: list[np.void] = []
        self._held: dict[str, tuple[float, int]] = {}  # value and step of the last row
        self._time = np.inf, -np.inf  # of the first and of the newest setpoint [s]
        self._last: dict[MessageName, Records] = {}  # one record each
        self._spans: dict[str, tuple[float, float]] = {}  # least and greatest value of each entity
        self._summary: tuple[str, str, Sequence[CornerMark], Scene | None] | None = None
        self._closed = False
        self._scene = scene
        self._still = list(self._stills())
        self._open_stream: rr.RecordingStream | None = None

    @property
    def scene(self) -> Scene:
        """What was known before the run."""
        return self._scene

    def take(self, frame: Frame) -> None:
        """Take a frame of a run."""
        if frame.step >= self._end:
            if self._destination.due():
                self._write_frames()
            self._end = self._next_end(frame.step)
        self._frames.append(frame)

    def take_message(self, name: MessageName, record: np.void) -> None:
        """Take a decoded message of a cell. A `plan` is not recorded: an event says the same."""
        if name == "event":
            self._events.append(record)
        if name not in self._messages:
            return
        self._messages[name].append(record)
        if record["sequence"] >= self._end:
            newest = min(int(messages[-1]["sequence"]) if messages else -1 for messages in self._messages.values())
            if newest >= self._end:  # all of the chunk is here: messages come in order, an event after the frame it is seen in
                if self._destination.due():
                    self._write_messages(self._end)
                self._end = self._next_end(newest)

    def _next_end(self, step: int) -> int:
        return (step // self._chunk + 1) * self._chunk

    def summary(self, markdown: str, summary_json: str, corners: Sequence[CornerMark] = (), scene: Scene | None = None) -> None:
        """The verdict that `close` writes.

        Args:
            markdown: a text to read.
            summary_json: the facts.
            corners: the closest approach of each pass in order of time.
            scene: with the moves that were run, where they were not known before.
        """
        self._summary = markdown, summary_json, corners, scene

    def close(self) -> None:
        """Write what is left and finish the file, which takes some 0.3 s for each minute at 1 kHz. A second call does nothing.

        Raises:
            EnvironmentProblem: the file could not be written to its end, it is removed; or it got no footer, it is kept.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._write_frames()
            self._write_messages(None)
            self._write_held_ends()
            if len(self._waiting) > 1:
                self._write_motion(self._waiting[:0], last=True)
            if len(self._commanded) > 1:
                self._write_commanded(self._commanded[:0], last=True)
            if self._summary is not None and self._open_stream is not None:
                markdown, facts, corners, scene = self._summary
                if scene is not None:
                    self._scene = scene
                    for entity, archetype in (*still_world(scene), *still_moves(scene), *still_corners(scene)):
                        _log(self._stream, entity, archetype)
                _log(self._stream, "summary", _text(markdown))
                self._stream.send_property("summary", rr.AnyValues(json=facts))
                of_passes = approaches(self._scene, corners) if self._scene.served else ()
                self._stream.flush()
                for entity, archetype in (*marks(self._scene, corners), *of_passes):
                    _log(self._stream, entity, archetype)
                if len(corners) > len(CORNERS) or (corners and self._scene.served):
                    self._write_passes(corners)
                self._destination.written(self._stream)
            if self._open_stream is not None and not self._destination.live:  # somebody may be changing the layout of a live one
                seen = worst(self._scene, self._summary[2]) if self._summary is not None else ()
                self._open_stream.send_blueprint(blueprint(self._scene, spans=self._spans, time=self._time, passed=seen))
        finally:
            if self._open_stream is not None:
                self._open_stream.disconnect()
                self._destination.end()

    @property
    def _stream(self) -> rr.RecordingStream:
        """The recording, begun with what does not move when the first rows come."""
        if self._open_stream is None:
            stream = rr.RecordingStream(APPLICATION_ID)
            stream.set_log_time_enabled(False)
            self._destination.begin(stream, blueprint(self._scene, live=self._destination.live))
            self._open_stream = stream
            stream.send_recording_name(self._scene.title)
            facts = rr.AnyValues(title=self._scene.title, law=self._scene.law, json=self._scene.scenario_json)
            stream.send_property("scenario", facts)
            stream.flush()
            for entity, archetype in self._still:
                _log(stream, entity, archetype)  # a recorder that is killed leaves a file that says what it is
        return self._open_stream

    def _stills(self) -> Iterator[tuple[str, Any]]:
        yield "summary", _text(f"# {self._scene.title}\n\nLaw `{self._scene.law}`. The verdict comes at the end of the run.")
        yield from still_world(self._scene)
        if not self._scene.served:
            yield from still_moves(self._scene)
            yield from still_corners(self._scene)
        yield from self._world.styles()
        lines = {signal.entity: signal.names for signal in self._signals}
        lines |= {limit.entity: limit.names for limit in self._limits}
        lines |= {error.entity: error.names for error in TRACKING_ERRORS}
        for entity, names in lines.items():
            yield entity, style(entity, names, self._scene)

    def _write_frames(self) -> None:
        frames, self._frames = self._frames, []
        if frames:
            event = layout("event")
            self._events += [event.decode(event.encode(found, 0)) for frame in frames for found in self._watch.see(frame)]
            self._write({name: layout(name).records(frames) for name in FRAME_MESSAGES}, None)

    def _write_messages(self, end: int | None) -> None:
        """Write the messages before a sequence number, or all; later ones stay, so that setpoints meet their actual values."""
        rows: dict[MessageName, Records] = {}
        for name, messages in self._messages.items():
            count = len(messages) if end is None else sum(int(m["sequence"]) < end for m in messages)
            rows[name] = np.array(messages[:count], dtype=layout(name).dtype)
            del messages[:count]
        self._write(rows, end)

    def _write(self, rows: dict[MessageName, Records], end: int | None) -> None:
        for name, records in rows.items():
            if len(records):
                self._write_message(name, records)
        self._write_tracking_errors(rows["setpoint"], rows["actual"])
        self._write_events(end)
        if self._open_stream is not None:
            self._destination.written(self._open_stream)

    def _write_message(self, name: MessageName, records: Records) -> None:
        self._last[name] = records[-1:]
        index = _index(records)
        for signal in self._signals:
            if signal.message == name:
                self._write_signal(signal, records, index)
        for entity, message, field in _LANES:
            if message == name:
                self._write_lane(entity, records, layout(name), field)
        if name == "actual":
            self._write_motion(records)
        if name == "setpoint" and self._scene.served:
            self._write_commanded(records)
        if name == "setpoint" and len(self._scene.moves) > 1:
            self._write_operations(records)
        if name == "setpoint":
            ends = records[[0, -1]]
            self._time = min(self._time[0], float(ends["time"][0])), float(ends["time"][1])
            for limit in self._limits:
                self._send_scalars(limit.entity, _index(ends), np.array([limit.values] * 2))

    def _write_signal(self, signal: Signal, records: Records, index: list[rr.TimeColumn]) -> None:
        values = signal.values(records)
        chosen = None
        if is_held(signal.entity):
            before, step = self._held.get(signal.entity, (np.nan, -1))
            chosen = np.diff(values, prepend=before) != 0.0
            self._held[signal.entity] = float(values[-1]), int(records["sequence"][chosen][-1]) if chosen.any() else step
        elif signal.chosen is not None:
            chosen = signal.chosen(records, values)
        if chosen is None:
            self._send_scalars(signal.entity, index, values)
        elif chosen.any():
            self._send_scalars(signal.entity, _index(records, chosen), values[chosen])

    def _write_held_ends(self) -> None:
        """A last row for what did not change, so that its line goes on to the end."""
        for signal in self._signals:
            last = self._last.get(signal.message)
            if last is not None and is_held(signal.entity) and self._held[signal.entity][1] != last["sequence"][0]:
                self._send_scalars(signal.entity, _index(last), signal.values(last))

    def _write_motion(self, actual: Records, *, last: bool = False) -> None:
        """The robot and its trace. What comes after a whole piece of the trace waits, so that chunks leave no marks."""
        waiting = np.concatenate([self._waiting, actual])
        if not len(self._waiting):
            self._write_robot(waiting[:1])
        ends, poses = (_begins(waiting, steps) for steps in (TRACE_STEPS, POSE_STEPS))
        if last and len(waiting) - 1 not in (0, *ends):
            ends.append(len(waiting) - 1)
            poses = sorted({*poses, len(waiting) - 1})
        if ends:
            self._write_robot(waiting[[pose for pose in poses if pose <= ends[-1]]])
            self._write_trace(waiting, ends)
            self._waiting = waiting[ends[-1] :]
        else:
            self._waiting = waiting

    def _write_commanded(self, setpoint: Records, *, last: bool = False) -> None:
        """The setpoints' trace, in pieces that end where those of the executed one do."""
        waiting = np.concatenate([self._commanded, setpoint])
        ends = _begins(waiting, TRACE_STEPS)
        if last and len(waiting) - 1 not in (0, *ends):
            ends.append(len(waiting) - 1)
        self._commanded = waiting[ends[-1] :] if ends else waiting
        if ends:
            tcp = layout("setpoint").values(waiting, "tcp_position")
            self._send(COMMANDED_PATH, _index(waiting[ends]), trace([tcp[a : b + 1] for a, b in pairwise([0, *ends])]))

    def _write_robot(self, poses: Records) -> None:
        index = _index(poses)
        for entity, columns in self._world.rows(poses):
            self._send(entity, index, columns)

    def _write_trace(self, records: Records, ends: list[int]) -> None:
        """The executed path from the first record to the first end, from there to the next, and so on."""
        tcp = layout("actual").values(records, "tcp_position")
        pieces = [tcp[first : last + 1] for first, last in pairwise([0, *ends])]
        shown = records[ends]
        self._send(EXECUTED_PATH, _index(shown), trace(pieces))
        if self._scene.served:  # the corners are not known yet
            return
        moves = self._scene.move_at(records["time"][[0, *ends[:-1]]])
        for corner in range(len(CORNERS)):
            self._write_corner(corner, moves, pieces, shown)

    def _write_corner(self, corner: int, moves: NDArray[np.intp], pieces: list[FloatArray], shown: Records) -> None:
        """The executed path where it comes near a corner of the move that runs."""
        for number in np.unique(moves):
            of_move = np.flatnonzero(moves == number)
            seen = self._scene.moves[number].seen_from(corner, np.concatenate([pieces[k] for k in of_move]))
            strips = np.split(seen, np.cumsum([len(pieces[k]) for k in of_move])[:-1])
            close = [k for k, points in enumerate(strips) if near(self._scene, corner, points)]
            if close:
                rows = rr.LineStrips2D.columns(strips=[strips[k] for k in close])
                self._send(executed_entity(corner), _index(shown[of_move[close]]), rows)

    def _write_tracking_errors(self, setpoint: Records, actual: Records) -> None:
        if not np.array_equal(setpoint["sequence"], actual["sequence"]):  # messages were lost
            _, of_setpoint, of_actual = np.intersect1d(setpoint["sequence"], actual["sequence"], return_indices=True)
            setpoint, actual = setpoint[of_setpoint], actual[of_actual]
        if not len(actual):
            return
        index, shown = _index(actual), every(ERROR_STEPS, actual)
        for error in TRACKING_ERRORS:
            difference = layout("setpoint").values(setpoint, error.group) - layout("actual").values(actual, error.group)
            if not error.entity.startswith(PLOT):
                self._send_scalars(error.entity, index, difference)
            elif shown.any():
                self._send_scalars(error.entity, _index(actual, shown), error.factor * difference[shown])

    def _write_events(self, end: int | None) -> None:
        """What happened before a step, or all of it, in words."""
        due = [event for event in self._events if end is None or event["step"] < end]
        self._events = [event for event in self._events if end is not None and event["step"] >= end]
        missed = EVENT_KINDS.index("missed_deadline")
        for entity, found in (
            ("event", [event for event in due if event["kind"] != missed]),
            (MISSED_DEADLINES, [event for event in due if event["kind"] == missed]),
        ):
            if found:
                events = np.array(found, dtype=layout("event").dtype)
                texts = rr.TextLog.columns(text=[sentence(event) for event in found], level=[level(event) for event in found])
                self._send(entity, _index(events, step="step"), texts)

    def _write_lane(self, entity: str, records: Records, message: Layout, field: str) -> None:
        """A row where an enumeration changes."""
        values = records[field].astype(int)
        changed = np.flatnonzero(np.diff(values, prepend=self._lanes.get(entity, -1)))
        items = next(f.items for f in message.fields if f.name == field)
        if len(changed):
            self._send(entity, _index(records[changed]), rr.StateChange.columns(state=[items[value] for value in values[changed]]))
        self._lanes[entity] = int(values[-1])

    def _write_operations(self, setpoint: Records) -> None:
        """A row where another move begins; none after the last one."""
        idle = len(self._scene.moves)
        number = np.where(setpoint["path.phase"] == 0, idle, self._scene.move_at(setpoint["time"]))
        if (number == idle).any():
            self._world.ended = min(self._world.ended, float(setpoint["time"][number == idle][0]))
        changed = np.flatnonzero(np.diff(number, prepend=self._lanes.get("operation", -1)))
        if len(changed):
            names = ["none" if move == idle else self._scene.name_of(move) for move in number[changed].tolist()]
            self._send("operation", _index(setpoint[changed]), rr.StateChange.columns(state=names))
        self._lanes["operation"] = int(number[-1])

    def _write_passes(self, corners: Sequence[CornerMark]) -> None:
        """The deviation at each corner, when it was passed."""
        time = np.rint([1e9 * corner.time for corner in corners]).astype("timedelta64[ns]")
        found = list(passes(self._scene, corners))
        line, lines, bounds = allowed(self._scene)
        for entity, archetype in ((line, lines), *((entity, points) for entity, points, _ in found)):
            _log(self._stream, entity, archetype)
        for entity, _, values in found:
            self._send_scalars(entity, [rr.TimeColumn("sim_time", duration=time)], values)
        ends = np.rint([1e9 * end for end in self._time]).astype("timedelta64[ns]")
        self._send_scalars(line, [rr.TimeColumn("sim_time", duration=ends)], np.array([bounds] * 2))

    def _send_scalars(self, entity: str, index: list[rr.TimeColumn], values: FloatArray) -> None:
        """Rows (n,) or (n, series)."""
        self._send(entity, index, rr.Scalars.columns(scalars=values))
        low, high = self._spans.get(entity, (np.inf, -np.inf))
        self._spans[entity] = min(low, float(values.min())), max(high, float(values.max()))

    def _send(self, entity: str, index: list[rr.TimeColumn], columns: Any) -> None:
        self._stream.send_columns(entity, index, columns, strict=True)


def _log(stream: rr.RecordingStream, entity: str, archetype: Any) -> None:
    """Write what does not move, at once.

    Left to the stream, which writes every so many milliseconds, it would come in an order that depends on when, and after columns
    that were sent later: equal recordings have their chunks in one order.
    """
    stream.log(entity, archetype, static=True, strict=True)
    stream.flush()


def _text(markdown: str) -> rr.TextDocument:
    return rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN)


def _begins(records: Records, steps: int) -> list[int]:
    """Where, after the first of records (n,), the next so many communication steps begin."""
    begins: list[int] = (np.flatnonzero(np.diff(records["sequence"].astype(np.int64) // steps)) + 1).tolist()
    return begins


def _index(records: Records, chosen: NDArray[np.bool_] | slice = _ALL, step: str = "sequence") -> list[rr.TimeColumn]:
    """Simulation time, to the nearest nanosecond, and step, which a field holds, of records (n,) or of those that are chosen."""
    nanoseconds = np.rint(records["time"][chosen] * 1e9).astype("timedelta64[ns]")
    steps = records[step][chosen].astype(np.int64)
    return [rr.TimeColumn("sim_time", duration=nanoseconds), rr.TimeColumn("step", sequence=steps)]
