"""Writes Rerun recordings, from frames or from decoded messages, with the same content. Imports Rerun, which takes a second."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from deltaph.errors import EnvironmentProblem
from deltaph.frame import Frame
from deltaph.telemetry.blueprint import blueprint
from deltaph.telemetry.corner import executed_entity, marks, near, still_corners
from deltaph.telemetry.keys import FRAME_MESSAGES, MessageName
from deltaph.telemetry.messages import Layout, Records, layout
from deltaph.telemetry.scene import CornerMark, Scene
from deltaph.telemetry.signals import PLOT, TRACKING_ERRORS, Signal, is_held, limits, plot_rows, signals, style
from deltaph.telemetry.world import CORNERS, EXECUTED_PATH, POSE_STEPS, MovingWorld, still_world, trace

APPLICATION_ID = "deltaph"

_LANES: tuple[tuple[str, MessageName, str], ...] = (("phase", "setpoint", "path.phase"), ("trip", "actual", "trip"))


class Recorder:
    """A sink that writes a recording. Rows are written in chunks, and what is left on `close`.

    Args:
        path: file to write; checked now, written from the first chunk on, so that a run that never starts leaves nothing behind.
        scene: what is known before the run.
        chunk: frames that are written at once; writing them takes a few milliseconds.

    Raises:
        EnvironmentProblem: the file cannot be written.
    """

    def __init__(self, path: Path, scene: Scene, *, chunk: int = 1000) -> None:
        self._chunk = chunk
        self._frames: list[Frame] = []
        self._messages: dict[MessageName, list[np.void]] = {name: [] for name in FRAME_MESSAGES}
        self._signals = signals(scene)
        self._limits = list(limits(scene))
        self._world = MovingWorld(scene)
        self._unposed = np.empty(0, layout("actual").dtype)  # since the last pose, which comes first
        self._lanes: dict[str, int] = {}
        self._held: dict[str, tuple[float, int]] = {}  # value and step of the last row
        self._last: dict[MessageName, Records] = {}  # one record each
        self._summary: tuple[str, str, Sequence[CornerMark]] | None = None
        self._closed = False
        self._path = path
        self._scene = scene
        self._blueprint = blueprint(scene)
        self._still = list(self._stills())
        self._open_stream: rr.RecordingStream | None = None
        _check_writable(path)

    def take(self, frame: Frame) -> None:
        """Take a frame of a run."""
        self._frames.append(frame)
        if len(self._frames) >= self._chunk:
            self._write_frames()

    def take_message(self, name: MessageName, record: np.void) -> None:
        """Take a decoded message of a cell. Others than `setpoint`, `actual` and `timing` are not recorded."""
        if name not in self._messages:
            return
        self._messages[name].append(record)
        if len(self._messages[name]) >= self._chunk:
            newest = min(int(messages[-1]["sequence"]) if messages else -1 for messages in self._messages.values())
            self._write_messages(newest)

    def summary(self, markdown: str, summary_json: str, corners: Sequence[CornerMark] = ()) -> None:
        """The verdict that `close` writes: a text to read, the facts, and the closest approaches to mark."""
        self._summary = markdown, summary_json, corners

    def close(self) -> None:
        """Write what is left and finish the file. A second call does nothing.

        Raises:
            EnvironmentProblem: the file could not be written to its end; it is removed.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._write_frames()
            self._write_messages(None)
            self._write_held_ends()
            if len(self._unposed) > 1:
                self._write_poses(self._unposed, [0, len(self._unposed) - 1])
            if self._summary is not None and self._open_stream is not None:
                markdown, facts, corners = self._summary
                self._stream.log("summary", _text(markdown), static=True, strict=True)
                self._stream.send_property("summary", rr.AnyValues(json=facts))
                for entity, archetype in marks(self._scene, corners):
                    self._stream.log(entity, archetype, static=True, strict=True)
        finally:
            if self._open_stream is not None:
                self._open_stream.disconnect()
                _check_complete(self._path)

    @property
    def _stream(self) -> rr.RecordingStream:
        """The file, begun with what does not move when the first rows come."""
        if self._open_stream is None:
            stream = rr.RecordingStream(APPLICATION_ID)
            stream.set_log_time_enabled(False)
            try:
                stream.save(self._path, default_blueprint=self._blueprint)
            except RuntimeError as error:
                raise EnvironmentProblem(f"cannot write {self._path}: {error}") from error
            self._open_stream = stream
            stream.send_recording_name(self._scene.title)
            facts = rr.AnyValues(title=self._scene.title, law=self._scene.law, json=self._scene.scenario_json)
            stream.send_property("scenario", facts)
            for entity, archetype in self._still:
                stream.log(entity, archetype, static=True, strict=True)
        return self._open_stream

    def _stills(self) -> Iterator[tuple[str, Any]]:
        yield "summary", _text(f"# {self._scene.title}\n\nLaw `{self._scene.law}`. The run ended before its summary.")
        yield from still_world(self._scene)
        yield from still_corners(self._scene)
        yield from self._world.styles()
        lines = {signal.entity: signal.names for signal in self._signals}
        lines |= {limit.entity: limit.names for limit in self._limits}
        lines |= {error.entity: error.names for error in TRACKING_ERRORS}
        for entity, names in lines.items():
            yield entity, style(entity, names)

    def _write_frames(self) -> None:
        frames, self._frames = self._frames, []
        if frames:
            self._write({name: layout(name).records(frames) for name in FRAME_MESSAGES})

    def _write_messages(self, newest: int | None) -> None:
        """Write the messages up to a sequence number, or all; later ones stay, so that setpoints meet their actual values."""
        rows: dict[MessageName, Records] = {}
        for name, messages in self._messages.items():
            count = len(messages) if newest is None else sum(int(m["sequence"]) <= newest for m in messages)
            rows[name] = np.array(messages[:count], dtype=layout(name).dtype)
            del messages[:count]
        self._write(rows)

    def _write(self, rows: dict[MessageName, Records]) -> None:
        for name, records in rows.items():
            if len(records):
                self._write_message(name, records)
        self._write_tracking_errors(rows["setpoint"], rows["actual"])

    def _write_message(self, name: MessageName, records: Records) -> None:
        self._last[name] = records[-1:]
        for signal in self._signals:
            if signal.message == name:
                self._write_signal(signal, records)
        for entity, message, field in _LANES:
            if message == name:
                self._write_lane(entity, records, layout(name), field)
        if name == "actual":
            self._take_poses(records)
        if name == "setpoint":
            ends = records[[0, -1]]
            for limit in self._limits:
                self._send(limit.entity, _index(ends), rr.Scalars.columns(scalars=[limit.values] * 2))

    def _write_signal(self, signal: Signal, records: Records) -> None:
        values = signal.values(records)
        if is_held(signal.entity):
            before, step = self._held.get(signal.entity, (np.nan, -1))
            chosen = np.diff(values, prepend=before) != 0.0
            self._held[signal.entity] = float(values[-1]), int(records["sequence"][chosen][-1]) if chosen.any() else step
        elif signal.chosen is not None:
            chosen = signal.chosen(records, values)
        else:
            chosen = np.ones(len(records), dtype=np.bool_)
        if chosen.any():
            self._send(signal.entity, _index(records[chosen]), rr.Scalars.columns(scalars=values[chosen]))

    def _write_held_ends(self) -> None:
        """A last row for what did not change, so that its line goes on to the end."""
        for signal in self._signals:
            last = self._last.get(signal.message)
            if last is not None and is_held(signal.entity) and self._held[signal.entity][1] != last["sequence"][0]:
                self._send(signal.entity, _index(last), rr.Scalars.columns(scalars=signal.values(last)))

    def _take_poses(self, actual: Records) -> None:
        """Pose the robot at every POSE_STEPS-th step; what comes after the last one waits, so that chunks leave no trace."""
        waiting = np.concatenate([self._unposed, actual])
        groups = waiting["sequence"].astype(np.int64) // POSE_STEPS
        poses = [0, *(np.flatnonzero(np.diff(groups)) + 1).tolist()]
        if not len(self._unposed):
            self._write_poses(waiting[:1], [0])
        if len(poses) > 1:
            self._write_poses(waiting, poses)
        self._unposed = waiting[poses[-1] :]

    def _write_poses(self, records: Records, poses: Sequence[int]) -> None:
        """The robot at records of these numbers but the first, which was written before, and the path from each to the next."""
        shown = records[[*poses[1:]]] if len(poses) > 1 else records
        index = _index(shown)
        for entity, columns in self._world.rows(shown):
            self._send(entity, index, columns)
        if len(poses) < 2:
            return
        tcp = layout("actual").values(records, "tcp_position")
        pieces = [tcp[first : last + 1] for first, last in pairwise(poses)]
        self._send(EXECUTED_PATH, index, trace(pieces))
        moves = [self._scene.moves[k] for k in self._scene.move_at(records["time"][poses[:-1]])]
        for corner in range(len(CORNERS)):
            seen = [move.seen_from(corner, piece) for move, piece in zip(moves, pieces, strict=True)]
            close = [k for k, points in enumerate(seen) if near(self._scene, corner, points)]
            if close:
                self._send(executed_entity(corner), _index(shown[close]), rr.LineStrips2D.columns(strips=[seen[k] for k in close]))

    def _write_tracking_errors(self, setpoint: Records, actual: Records) -> None:
        common, of_setpoint, of_actual = np.intersect1d(setpoint["sequence"], actual["sequence"], return_indices=True)
        if not len(common):
            return
        for error in TRACKING_ERRORS:
            difference = layout("setpoint").values(setpoint[of_setpoint], error.group) - layout("actual").values(
                actual[of_actual], error.group
            )
            chosen = plot_rows(actual[of_actual]) if error.entity.startswith(PLOT) else np.ones(len(common), dtype=np.bool_)
            if chosen.any():
                rows = rr.Scalars.columns(scalars=error.factor * difference[chosen])
                self._send(error.entity, _index(actual[of_actual][chosen]), rows)

    def _write_lane(self, entity: str, records: Records, message: Layout, field: str) -> None:
        """A row where an enumeration changes."""
        values = records[field].astype(int)
        changed = np.flatnonzero(np.diff(values, prepend=self._lanes.get(entity, -1)))
        items = next(f.items for f in message.fields if f.name == field)
        if len(changed):
            self._send(entity, _index(records[changed]), rr.StateChange.columns(state=[items[value] for value in values[changed]]))
        self._lanes[entity] = int(values[-1])

    def _send(self, entity: str, index: list[rr.TimeColumn], columns: Any) -> None:
        self._stream.send_columns(entity, index, columns, strict=True)


def _text(markdown: str) -> rr.TextDocument:
    return rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN)


def _index(records: Records) -> list[rr.TimeColumn]:
    """Simulation time, to the nearest nanosecond, and step of records (n,)."""
    nanoseconds = np.rint(records["time"] * 1e9).astype("timedelta64[ns]")
    return [rr.TimeColumn("sim_time", duration=nanoseconds), rr.TimeColumn("step", sequence=records["sequence"].astype(np.int64))]


def _check_writable(path: Path) -> None:
    """Refuse a file that cannot be written; an existing one keeps its content.

    Raises:
        EnvironmentProblem: naming the file and the reason.
    """
    existed = path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        raise EnvironmentProblem(f"cannot write {path}: {error.strerror or error}") from error
    if not existed:
        path.unlink()


def _check_complete(path: Path) -> None:
    """Look for the footer: the writing thread of Rerun only warns when it fails, on a full disk for one.

    Raises:
        EnvironmentProblem: there is none; the file is removed.
    """
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            RrdReader(path).store()
        except (RuntimeError, ValueError, OSError) as error:
            path.unlink(missing_ok=True)
            raise EnvironmentProblem(f"cannot write {path}: the recording did not become whole; is the disk full?") from error
