"""Binding to the C kernel: cffi in ABI mode on the shared library, declared by the kernel's own header."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import cffi

import deltaph
from deltaph.sources import FMU_SRC


def _library() -> Path:
    """The shared library, which the build installs into the package."""
    for directory in deltaph.__path__:
        for candidate in Path(directory).glob("deltaph_kernel.*"):
            if candidate.suffix in {".so", ".dylib", ".dll"}:
                return candidate
    raise ImportError(
        f"the kernel library is missing in {list(deltaph.__path__)}: install deltaph with pip, do not import a checkout"
    )


def _declarations() -> str:
    """The headers without their include guards; they have no other preprocessor lines."""
    headers = [(FMU_SRC / name).read_text(encoding="utf-8") for name in ("kernel/kernel.h", "planner/feed.h")]
    return re.sub(r"^#.*$", "", "".join(headers), flags=re.MULTILINE)


ffi: Any = cffi.FFI()
ffi.cdef(_declarations())
lib: Any = ffi.dlopen(str(_library()))


@cache
def enumeration(name: str) -> tuple[str, ...]:
    """The items of a kernel enumeration in order, without their common prefix, in lower case; `name` such as `dph_phase`."""
    prefix = f"{name.upper()}_"
    return tuple(item.removeprefix(prefix).lower() for _, item in sorted(ffi.typeof(name).elements.items()))


def sentence(verdict: Any) -> str:
    """The one sentence that says a verdict."""
    text = ffi.new("char[256]")
    lib.dph_verdict_text(ffi.addressof(verdict), text, 256)
    return str(ffi.string(text).decode())


def status_sentence(status: str, required: float, available: float) -> str:
    """The sentence for a status that belongs to no place on the path, such as `busy`."""
    number = enumeration("dph_status").index(status)
    return sentence(ffi.new("dph_verdict *", {"status": number, "required": required, "available": available})[0])
