"""Which C files an FMU is made of, and the token that stands for their content."""

from __future__ import annotations

import hashlib
import uuid
from functools import cache
from pathlib import Path

from deltaph.fmu import c_table
from deltaph.fmu.model_description import FmiVersion
from deltaph.sources import FMU_SRC
from deltaph.variables import Model, variable_table

_ADAPTERS: dict[FmiVersion, str] = {2: "fmi2.c", 3: "fmi3.c"}
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "urn:deltaph:fmu")
ELEMENTARY = FMU_SRC / "math" / "elementary.c"
"""Elementary functions for where there is no libm: part of source FMUs alone."""


def c_files(model: Model, version: FmiVersion) -> tuple[Path, ...]:
    """The C files to compile, in a fixed order; the generated one comes on top."""
    others = {name for v, name in _ADAPTERS.items() if v != version}
    files = [file for folder in ("kernel", "fmi", model) for file in sorted((FMU_SRC / folder).glob("*.c"))]
    return tuple(file for file in files if file.name not in others)


def _headers(model: Model) -> list[Path]:
    return [file for folder in (".", "kernel", "fmi", model) for file in sorted((FMU_SRC / folder).glob("*.h"))]


@cache
def token(model: Model, version: FmiVersion) -> str:
    """The instantiation token (FMI 2.0: GUID), a fingerprint of the variable table and of the C sources."""
    table = variable_table(model)
    digest = hashlib.sha256(f"{table.model} {version} {c_table.header(table)} {c_table.source(model, table, '')}".encode())
    for file in (*c_files(model, version), *_headers(model), ELEMENTARY):
        digest.update(f"{file.relative_to(FMU_SRC).as_posix()}\n".encode())
        digest.update(file.read_bytes())
    return f"{{{uuid.uuid5(_NAMESPACE, digest.hexdigest())}}}"
