"""What comes out: FMUs and system descriptions in a directory, or a pair of FMUs from the cache."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from zipfile import is_zipfile

from deltaph.errors import EnvironmentProblem
from deltaph.files import replace
from deltaph.fmu import package, ssp
from deltaph.fmu.compile import FLAGS, compiler
from deltaph.fmu.model_description import FmiVersion, model_description
from deltaph.fmu.platforms import chosen, host
from deltaph.fmu.sources import token
from deltaph.variables import MODELS, Model, variable_table

FMI_VERSIONS: tuple[FmiVersion, ...] = (2, 3)


def _compiled(wanted: Collection[tuple[Model, FmiVersion]], platform: str = "host") -> dict[tuple[Model, FmiVersion], bytes]:
    """FMUs, compiled side by side."""
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        return dict(zip(wanted, pool.map(lambda which: package.fmu(which[0], which[1], platform), wanted), strict=True))


def _make_directory(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EnvironmentProblem(f"cannot create the directory {directory}: {error.strerror}") from error


def _write(path: Path, content: bytes) -> None:
    replace(path, lambda temporary: temporary.write_bytes(content))


def build(directory: Path, fmi_versions: Collection[FmiVersion] = FMI_VERSIONS, platform: str = "host") -> list[Path]:
    """Build the FMUs and the system descriptions into a directory, which is created where it is missing.

    Every file is written as a whole or not at all. The same sources and the same compiler give the same bytes.

    Args:
        directory: where to.
        fmi_versions: 2, 3 or both.
        platform: `host`, with the C compiler of this machine; `all`, or the name of one, such as `aarch64-linux`, with zig.

    Returns:
        The files written.

    Raises:
        DeltaphError: there is no such platform, or not in that FMI version.
        EnvironmentProblem: there is no compiler, it fails, or the directory cannot be written.
    """
    versions = [version for version in FMI_VERSIONS if version in fmi_versions]
    for version in versions:
        for target in (None,) if platform == "host" else chosen(platform, version):
            compiler(target)
    _make_directory(directory)
    fmus = _compiled([(model, version) for version in versions for model in MODELS], platform)
    files: dict[str, bytes] = {}
    for version in versions:
        names = {model: package.file_name(model, version) for model in MODELS}
        files |= {name: fmus[model, version] for model, name in names.items()}
        sources: Mapping[Model, str] = {model: f"resources/{name}" for model, name in names.items()}
        files[ssp.file_name(version)] = package.archive(
            {"SystemStructure.ssd": ssp.system_structure(sources)} | {sources[model]: files[name] for model, name in names.items()}
        )
    written = []
    for name, content in files.items():
        _write(directory / name, content)
        written.append(directory / name)
    return written


def _content_key() -> str:
    """Changes with everything that the FMUs are made from but the compiler: sources and tables by their token."""
    digest = hashlib.sha256(repr((host().name, FLAGS)).encode())
    for model in MODELS:
        digest.update(model_description(variable_table(model), 3, token(model, 3)))
    return digest.hexdigest()[:20]


def _compiler_key(command: tuple[str, ...]) -> str:
    tool = Path(command[0]).resolve()
    status = tool.stat()
    return hashlib.sha256(repr((tool, *command[1:], status.st_size, status.st_mtime_ns)).encode()).hexdigest()[:20]


def _pair(folder: Path) -> dict[Model, Path]:
    return {model: folder / package.file_name(model, 3) for model in MODELS}


def _is_whole(paths: Mapping[Model, Path]) -> bool:
    return all(is_zipfile(path) for path in paths.values())


def cached_fmus() -> dict[Model, Path]:
    """The FMI 3.0 FMUs for this machine, built at most once per content and compiler.

    They lie in `$XDG_CACHE_HOME/deltaph` or `~/.cache/deltaph`. Processes that build at the same time do not disturb each other:
    a file appears there as a whole, and all write the same bytes. Where there is no compiler any more, those of another one serve.

    Raises:
        EnvironmentProblem: they are not there, and there is no compiler, it fails, or the cache cannot be written.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "deltaph" / _content_key()

    try:
        paths = _pair(cache / _compiler_key(compiler()))
    except EnvironmentProblem:
        made = [pair for folder in sorted(cache.glob("*")) if _is_whole(pair := _pair(folder))]
        if not made:
            raise
        return made[0]
    if _is_whole(paths):
        return paths
    try:
        _make_directory(paths["planner"].parent)
    except EnvironmentProblem as error:
        raise EnvironmentProblem(f"{error}: set XDG_CACHE_HOME to a directory that can be written") from error
    fmus = _compiled([(model, 3) for model in MODELS])
    for model, path in paths.items():
        _write(path, fmus[model, 3])
    return paths
