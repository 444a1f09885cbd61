"""Writing results: checked before anything happens, complete or not at all."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

from deltaph.errors import EnvironmentProblem

STDOUT = Path("-")
"""`-` as an output file means standard output."""


def check_writable(*paths: Path | None) -> None:
    """Refuse output files that cannot be written, before anything is computed for them.

    Raises:
        EnvironmentProblem: naming the file and the reason.
    """
    named = [path for path in paths if path is not None]
    for path in named:
        if named.count(path) > 1:
            raise EnvironmentProblem(f"cannot write two outputs to {path}: give each its own file")
        if path == STDOUT:
            continue
        if path.is_dir():
            raise EnvironmentProblem(f"cannot write {path}: it is a directory, name a file in it")
        if path.exists() and not path.is_file():
            raise EnvironmentProblem(f"cannot write {path}: it is not a regular file; - is standard output")
        if not path.parent.is_dir():
            raise EnvironmentProblem(f"cannot write {path}: there is no directory {path.parent}")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise EnvironmentProblem(f"cannot write {path}: permission denied")


def write_text(path: Path, write: Callable[[IO[str]], object]) -> None:
    """Write a text file by way of a temporary one beside it, or standard output.

    Raises:
        EnvironmentProblem: the file cannot be written; nothing is left behind.
    """
    if path == STDOUT:
        write(sys.stdout)
        return
    replace(path, lambda temporary: _write_with(temporary, write))


def _write_with(path: Path, write: Callable[[IO[str]], object]) -> None:
    with path.open("w", encoding="utf-8") as stream:
        write(stream)


def replace(path: Path, produce: Callable[[Path], object]) -> None:
    """Let `produce` write a temporary file with the same suffix beside `path`, then put it in place.

    A link is followed: what it points to is replaced.

    Raises:
        EnvironmentProblem: the file cannot be written; nothing is left behind.
    """
    try:
        path = path.resolve()
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
        temporary = Path(name)
        try:
            produce(temporary)
            umask = os.umask(0)
            os.umask(umask)
            temporary.chmod(0o666 & ~umask)  # mkstemp is for secrets; this is a result
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise EnvironmentProblem(f"cannot write {path}: {error.strerror or error}") from error
