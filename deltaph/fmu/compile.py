"""Compiling an FMU's shared library: with the C compiler of the machine for this machine, with zig for any platform."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path

from deltaph.errors import EnvironmentProblem
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.platforms import Platform, host
from deltaph.fmu.translation_unit import SYSTEM_MATH, translation_unit
from deltaph.variables import Model, variable_table

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden", "-Wall", "-Wextra")
"""No contraction, no fast-math: the FMUs and the Python binding give the same bits."""


def _system_compiler() -> tuple[str, ...] | None:
    """The command `$CC` names, else the first of cc, gcc, clang; None where there is none of them."""
    try:
        chosen = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise EnvironmentProblem(f"CC={os.environ['CC']!r} is not a command: {error}") from error
    if chosen:
        found = shutil.which(chosen[0])
        if found is None:
            raise EnvironmentProblem(f"the C compiler {chosen[0]!r} named by $CC is not there: install it, or unset CC")
        return (found, *chosen[1:])
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found is not None:
            return (found,)
    return None


def _package_folder(package: str) -> Path | None:
    """Where a package lies; found without importing it."""
    spec = importlib.util.find_spec(package)
    return next((Path(folder) for folder in (spec.submodule_search_locations or ())), None) if spec else None


def _zig(platform: Platform) -> tuple[str, ...] | None:
    """The command that compiles for a platform with the package ziglang; None where either does not know the other."""
    folder = _package_folder("ziglang")
    if folder is None or not platform.target:
        return None
    return (str(folder / ("zig.exe" if os.name == "nt" else "zig")), "cc", "-target", platform.target, "-s")


def compiler(platform: Platform | None = None) -> tuple[str, ...]:
    """The command of the C compiler.

    Args:
        platform: to cross-compile for, with zig; None for this machine, with its own compiler, or zig where it has none.

    Raises:
        EnvironmentProblem: there is none.
    """
    if platform is None:
        command = _system_compiler() or _zig(host())
        if command is None:
            raise EnvironmentProblem(
                "building FMUs takes a C compiler and there is none: install gcc or clang (Debian: apt install gcc),"
                " or the package ziglang (pip install 'deltaph[cross]')"
            )
        return command
    command = _zig(platform)
    if command is None:
        raise EnvironmentProblem(f"building for {platform.name} takes the package ziglang: pip install 'deltaph[cross]'")
    return command


def fmi_headers() -> Path:
    """Where fmpy keeps the headers of the FMI; found without importing it.

    Raises:
        EnvironmentProblem: fmpy is missing, or without them.
    """
    package = _package_folder("fmpy")
    if package is not None and (package / "c-code" / "fmi3Functions.h").is_file():
        return package / "c-code"
    raise EnvironmentProblem("the FMI headers that come with fmpy are missing: install fmpy again")


def _first_error(output: str) -> str:
    """The first line of a compiler's output that tells what is wrong."""
    lines = [line for line in output.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line.lower()), lines[0] if lines else "no message")


def _link_options(library: str, extension: str) -> tuple[str, ...]:
    """What a system wants of its shared libraries besides."""
    return (f"-Wl,-install_name,@rpath/{library}",) if extension == ".dylib" else ()


def shared_library(model: Model, version: FmiVersion, platform: Platform | None = None) -> bytes:
    """Compile an FMU's shared library.

    Args:
        model: of which model.
        version: for which FMI version.
        platform: for which platform, with zig; None for this machine, with its own compiler.

    Raises:
        EnvironmentProblem: there is no compiler, or it fails: with its first error.
    """
    command = compiler(platform)
    identifier = variable_table(model).model
    with tempfile.TemporaryDirectory(prefix="deltaph-") as temporary:
        folder = Path(temporary)
        source = f"{identifier}.c"
        (folder / source).write_bytes(translation_unit(model, version))
        extension = (platform or host()).extension
        library = folder / f"{identifier}{extension}"
        arguments = [
            *command,
            *FLAGS,
            f"-D{SYSTEM_MATH}",
            *("-isystem", str(fmi_headers())),
            source,
            *("-o", library.name, "-lm"),
            *(_link_options(library.name, extension) if platform else ()),
        ]
        try:
            subprocess.run(arguments, cwd=folder, env=os.environ | {"LC_ALL": "C"}, check=True, capture_output=True, text=True)
            return library.read_bytes()
        except subprocess.CalledProcessError as error:
            raise EnvironmentProblem(f"{command[0]} cannot compile the {model}: {_first_error(error.stderr)}") from error
        except OSError as error:
            raise EnvironmentProblem(f"{command[0]} cannot compile the {model}: {error}") from error
