"""Where a recording goes: into a file, or into a viewer that runs."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

import rerun as rr
import rerun.blueprint as rrb

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.footer import add_footer

_PERIOD = 0.09  # between two chunks to a viewer: less than a chunk takes at 1 ms, so that none waits for the next [s]
_TIMEOUT = 5.0  # for a viewer to accept a connection, or to take what it was sent [s]

_BLOCK = 1 << 20  # that is read from the pipe at once, at most [bytes]


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


class PipedFile:
    """A file that Rerun writes through a pipe, from which a thread here takes what comes.

    Of a full disk Rerun 0.41 itself would tell its log alone, and who waits then for what it was about to write waits for ever.

    Args:
        path: of the file.

    Raises:
        OSError: it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._error: OSError | None = None

    def begin(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint | None = None, *, footer: bool = True) -> None:
        """Have all that is logged from now on written, until `end`."""
        reading, writing = os.pipe()
        self._thread = threading.Thread(target=self._copy, args=(reading,), name="recording", daemon=True)
        self._thread.start()
        try:
            stream.save(f"/dev/fd/{writing}", default_blueprint=blueprint, write_footer=footer)
        finally:
            os.close(writing)  # Rerun has opened it anew

    def written(self, stream: rr.RecordingStream) -> None:
        """Wait until what was logged is in the pipe.

        Raises:
            OSError: the file cannot be written any more.
        """
        stream.flush()
        if self._error is not None:
            raise self._error

    def end(self) -> None:
        """Wait until all is in the file. The stream has ended.

        Raises:
            OSError: it could not be written to its end.
        """
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _copy(self, reading: int) -> None:
        """Write what comes through the pipe until it ends; what cannot be written any more is dropped, so that Rerun goes on."""
        with self._file as file, open(reading, "rb", buffering=0) as pipe:
            while block := pipe.read(_BLOCK):
                left = memoryview(block)
                while left and self._error is None:
                    try:
                        left = left[file.write(left) :]
                    except OSError as error:
                        self._error = error


@contextmanager
def written_to(path: Path, stream: rr.RecordingStream, blueprint: rrb.Blueprint | None = None) -> Iterator[None]:
    """Have what is logged meanwhile written to a file, which is finished at the end.

    Raises:
        OSError: it cannot be.
    """
    file = PipedFile(path)
    file.begin(stream, blueprint)
    try:
        yield
    finally:
        stream.disconnect()
        file.end()


class RecordingFile:
    """A file. It is checked now and written from the first rows on, so that a run that never starts leaves nothing behind.

    Raises:
        EnvironmentProblem: it cannot be written; an existing one keeps its content.
    """

    live = False
    chunk = 4000
    """Takes 0.1 to 0.2 s of the recorder's thread; a recorder that is killed loses what is in it, 4 s at 1 ms. Longer chunks would
    make the file smaller, by 2 % at most, and memory larger."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: PipedFile | None = None
        existed = path.exists()
        try:
            path.open("ab").close()
        except OSError as error:
            raise self._problem(error) from error
        if not existed:
            path.unlink()

    def due(self) -> bool:
        """Each chunk is."""
        return True

    def begin(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Open the file. Without a footer, for which Rerun would remember each chunk: the recorder's memory is to stay flat."""
        try:
            self._file = PipedFile(self._path)
        except OSError as error:
            raise self._problem(error) from error
        self._file.begin(stream, blueprint, footer=False)

    def written(self, stream: rr.RecordingStream) -> None:
        """Wait until they are in the pipe, so that they do not pile up here.

        Raises:
            EnvironmentProblem: the file cannot be written any more.
        """
        assert self._file is not None
        try:
            self._file.written(stream)
        except OSError as error:
            raise self._problem(error) from error

    def end(self) -> None:
        """Append the footer; a file that could not be written to its end is removed.

        Raises:
            EnvironmentProblem: it could not, or it gets no footer, without which it is complete.
        """
        assert self._file is not None
        try:
            self._file.end()
        except OSError as error:
            self._path.unlink(missing_ok=True)
            raise self._problem(error) from error
        add_footer(self._path)

    def _problem(self, error: OSError) -> EnvironmentProblem:
        return EnvironmentProblem(f"cannot write {self._path}: {error.strerror or error}")


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
