"""Where a recording goes: into a file, or into a viewer that runs."""

from __future__ import annotations

import socket
import time
import warnings
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

import rerun as rr
import rerun.blueprint as rrb

from deltaph.errors import EnvironmentProblem

_PERIOD = 0.09  # between two chunks to a viewer: less than a chunk takes at 1 ms, so that none waits for the next [s]
_TIMEOUT = 5.0  # for a viewer to accept a connection, or to take what it was sent [s]


class Destination(Protocol):
    """What a recorder asks of the place where its stream goes.

    Attributes:
        live: whether somebody watches while it is recorded.
        chunk: communication steps that are written at once; more where it is not due for them.
    """

    live: bool
    chunk: int

    def due(self) -> bool:
        """Whether it is time to write a chunk."""

    def begin(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Take a new stream and its layout.

        Raises:
            EnvironmentProblem: it cannot be taken.
        """

    def written(self, stream: rr.RecordingStream) -> None:
        """Some rows have been written.

        Raises:
            EnvironmentProblem: they cannot arrive.
        """

    def end(self) -> None:
        """The stream has ended.

        Raises:
            EnvironmentProblem: it did not arrive as a whole.
        """


class RecordingFile:
    """A file. It is checked now and written from the first rows on, so that a run that never starts leaves nothing behind.

    Raises:
        EnvironmentProblem: it cannot be written; an existing one keeps its content.
    """

    live = False
    chunk = 4000
    """Takes 0.1 to 0.2 s of the recorder's thread; a recorder that is killed loses what is in it, 4 s at 1 ms.

    Memory grows by this: until the end Rerun keeps one to three kilobytes on each chunk of each of some 60 entities, for the footer
    without which a viewer cannot jump about in a file. Longer chunks make it less; without a footer memory is flat.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        existed = path.exists()
        try:
            path.open("ab").close()
        except OSError as error:
            raise EnvironmentProblem(f"cannot write {path}: {error.strerror or error}") from error
        if not existed:
            path.unlink()

    def due(self) -> bool:
        """Each chunk is."""
        return True

    def begin(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Open the file."""
        try:
            stream.save(self._path, default_blueprint=blueprint)
        except RuntimeError as error:
            raise EnvironmentProblem(f"cannot write {self._path}: {error}") from error

    def written(self, stream: rr.RecordingStream) -> None:
        """Rerun's thread writes them."""

    def end(self) -> None:
        """Look for the footer: Rerun's thread only warns when it fails, on a full disk for one. A file without is removed."""
        from rerun.chunk import RrdReader

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                RrdReader(self._path).store()
            except (RuntimeError, ValueError, OSError) as error:
                self._path.unlink(missing_ok=True)
                raise EnvironmentProblem(
                    f"cannot write {self._path}: the recording did not become whole; is the disk full?"
                ) from error


class ViewerGoneError(EnvironmentProblem):
    """The viewer was closed, or cannot be reached any more."""


class RunningViewer:
    """A viewer that runs; it keeps what it was sent.

    Args:
        url: such as rerun+http://127.0.0.1:9876/proxy.

    Raises:
        EnvironmentProblem: the URL is none, or nothing answers there.
    """

    live = True
    chunk = 100

    def __init__(self, url: str) -> None:
        self._url = url
        self._next = 0.0
        try:
            parts = urlsplit(url)
            if parts.scheme not in ("rerun", "rerun+http", "rerun+https") or parts.path != "/proxy" or parts.port is None:
                raise ValueError("it is not of the form rerun+http://127.0.0.1:9876/proxy")
            socket.create_connection((parts.hostname or "", parts.port), _TIMEOUT).close()
        except (ValueError, OSError) as error:
            raise EnvironmentProblem(f"there is no viewer on {url}: {error}") from error

    def due(self) -> bool:
        """Ten times a second, however fast the cell runs: the price is that of a chunk, and hardly of the rows in it."""
        if (now := time.monotonic()) < self._next:
            return False
        self._next = now + _PERIOD
        return True

    def begin(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Connect. The layout becomes active also where the viewer has one of an earlier cell."""
        stream.connect_grpc(self._url)
        stream.send_blueprint(blueprint)

    def written(self, stream: rr.RecordingStream) -> None:
        """Wait until they are on their way, so that they do not pile up here.

        Raises:
            ViewerGoneError: they cannot be sent.
        """
        try:
            stream.flush(timeout_sec=_TIMEOUT)
        except RuntimeError as error:
            raise ViewerGoneError(f"the viewer on {self._url} does not answer any more") from error

    def end(self) -> None:
        """The viewer stays."""
