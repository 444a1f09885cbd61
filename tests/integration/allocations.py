"""`allocations.c`, compiled and loaded: counts what Python allocates in one thread."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SOURCE = Path(__file__).with_name("allocations.c")


class Counter:
    """Counts in the thread that calls it, while it is on."""

    def __init__(self, library: ctypes.PyDLL) -> None:
        self._library = library
        library.counted.restype = ctypes.c_longlong

    def on(self) -> None:
        self._library.set_counting(1)

    def off(self) -> int:
        """Stop; returns how many there have been so far, since the first time it was on."""
        self._library.set_counting(0)
        return int(self._library.counted())


@contextmanager
def counting(folder: Path) -> Iterator[Counter]:
    """Stand in front of Python's allocators."""
    compiler, shared = shutil.which("cc") or shutil.which("gcc"), folder / "allocations.so"
    assert compiler
    options = ["-shared", "-fPIC", "-O2", "-std=gnu99", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *options, str(SOURCE), "-o", str(shared)], check=True)
    library = ctypes.PyDLL(str(shared))
    library.install()
    try:
        yield Counter(library)
    finally:
        library.remove_counter()
