"""Compiling an FMU's shared library with the C compiler of the machine."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path

from deltaph.errors import EnvironmentProblem
from deltaph.fmu import c_table
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.sources import c_files, token
from deltaph.sources import FMU_SRC
from deltaph.variables import Model

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden", "-Wall", "-Wextra")
"""No contraction, no fast-math: the FMUs and the Python binding give the same bits."""


def compiler() -> tuple[str, ...]:
    """The command of the C compiler: `$CC`, else the first of cc, gcc, clang.

    Raises:
        EnvironmentProblem: there is none.
    """
    chosen = shlex.split(os.environ.get("CC", ""))
    if chosen:
        found = shutil.which(chosen[0])
        if found is None:
            raise EnvironmentProblem(f"the C compiler {chosen[0]!r} named by $CC is not there: install it, or unset CC")
        return (found, *chosen[1:])
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found is not None:
            return (found,)
    raise EnvironmentProblem("building FMUs takes a C compiler and there is none: install gcc or clang (Debian: apt install gcc)")


def fmi_headers() -> Path:
    """Where fmpy keeps the headers of the FMI; found without importing it.

    Raises:
        EnvironmentProblem: fmpy is missing, or without them.
    """
    spec = importlib.util.find_spec("fmpy")
    for package in (spec.submodule_search_locations or ()) if spec else ():
        folder = Path(package) / "c-code"
        if (folder / "fmi3Functions.h").is_file():
            return folder
    raise EnvironmentProblem("the FMI headers that come with fmpy are missing: install fmpy again")


def _first_error(output: str) -> str:
    """The first line of a compiler's output that tells what is wrong."""
    lines = [line for line in output.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line.lower()), lines[0] if lines else "no message")


def shared_library(model: Model, version: FmiVersion) -> bytes:
    """Compile an FMU's shared library for this machine.

    Raises:
        EnvironmentProblem: there is no compiler, or it fails: with its first error.
    """
    command = compiler()
    with tempfile.TemporaryDirectory(prefix="deltaph-") as temporary:
        folder = Path(temporary)
        c_table.write_c_table(model, folder, token(model, version))
        library = folder / model
        arguments = [
            *command,
            *FLAGS,
            *("-I", str(folder), "-I", str(FMU_SRC), "-isystem", str(fmi_headers())),
            *map(str, c_files(model, version)),
            c_table.SOURCE,
            *("-o", str(library), "-lm"),
        ]
        try:
            subprocess.run(arguments, cwd=folder, env=os.environ | {"LC_ALL": "C"}, check=True, capture_output=True, text=True)
            return library.read_bytes()
        except subprocess.CalledProcessError as error:
            raise EnvironmentProblem(f"{command[0]} cannot compile the {model}: {_first_error(error.stderr)}") from error
        except OSError as error:
            raise EnvironmentProblem(f"{command[0]} cannot compile the {model}: {error}") from error
