"""Writing results: checked before anything happens, complete or not at all."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO

from deltaph.errors import EnvironmentProblem

STDOUT = Path("-")
"""`-` as an output file means standard output."""


def check_writable(*texts: Path | None, binary: Sequence[Path | None] = (), inputs: Sequence[Path | None] = ()) -> None:
    """Refuse output files that cannot be written, before anything is computed for them.

    Args:
        texts: files to write, of which one may be standard output.
        binary: files to write that are no text.
        inputs: files that are read, and must not be overwritten.

    Raises:
        EnvironmentProblem: naming the file and the reason.
    """
    targets: list[Path] = []
    for path in (*texts, *binary):
        if path is None:
            continue
        target = path if path == STDOUT else Path(os.path.realpath(path))
        if target in targets:
            raise EnvironmentProblem(f"cannot write two outputs to {path}: give each its own file")
        targets.append(target)
        if path != STDOUT:
            _check_target(path, target, [one for one in inputs if one is not None])
        elif path in binary:
            raise EnvironmentProblem(f"cannot write {path}: only text goes to standard output, name a file")


def _check_target(path: Path, target: Path, inputs: Sequence[Path]) -> None:
    """Refuse an output file that, with all links followed, is not one to write."""
    if target.is_dir():
        raise EnvironmentProblem(f"cannot write {path}: it is a directory, name a file in it")
    if target.is_symlink():
        raise EnvironmentProblem(f"cannot write {path}: it is a link that leads nowhere")
    if target.exists() and not target.is_file():
        raise EnvironmentProblem(f"cannot write {path}: it is not a regular file; - is standard output")
    if not target.parent.is_dir():
        directory = target.parent if path.is_symlink() else path.parent
        raise EnvironmentProblem(f"cannot write {path}: there is no directory {directory}")
    if not os.access(target if target.exists() else target.parent, os.W_OK):
        raise EnvironmentProblem(f"cannot write {path}: permission denied")
    if target.exists() and any(one.exists() and target.samefile(one) for one in inputs):
        raise EnvironmentProblem(f"cannot write {path}: it is what is read, name another file")


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
        path = Path(os.path.realpath(path))
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
