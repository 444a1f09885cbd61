"""Libraries for five platforms from this machine, each for the oldest system promised, and executed where that can be done."""

from __future__ import annotations

import importlib.util
import shutil
import struct
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from integration.cell_process import compile_host, run_cell
from integration.importers import TOOLS

from deltaph.fmu import build
from deltaph.fmu.compile import compiler, shared_library
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.package import file_name
from deltaph.fmu.platforms import PLATFORMS, host
from deltaph.variables import MODELS, Model, variable_table

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed: pip install 'deltaph[cross]'"
)

FOLDERS = {
    2: {"linux64": ".so", "win64": ".dll", "darwin64": ".dylib"},
    3: {
        "x86_64-linux": ".so",
        "aarch64-linux": ".so",
        "x86_64-windows": ".dll",
        "x86_64-darwin": ".dylib",
        "aarch64-darwin": ".dylib",
    },
}
ELF_MACHINE = {"x86_64-linux": 62, "aarch64-linux": 183}
PE_MACHINE = 0x8664
MACH_CPU = {"x86_64-darwin": 0x01000007, "aarch64-darwin": 0x0100000C}
SYSROOT = Path("/usr/aarch64-linux-gnu")


@pytest.fixture(scope="module")
def everywhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `deltaph build --platform all` makes."""
    directory = tmp_path_factory.mktemp("everywhere")
    build(directory, platform="all")
    return directory


@pytest.fixture(scope="module")
def libraries(everywhere: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMUs, unpacked in folders of their file names."""
    directory = tmp_path_factory.mktemp("libraries")
    for path in everywhere.glob("*.fmu"):
        with zipfile.ZipFile(path) as container:
            container.extractall(directory / path.name)
    return directory


def library(libraries: Path, model: Model, version: FmiVersion, folder: str) -> Path:
    name = f"{variable_table(model).model}{FOLDERS[version][folder]}"
    return libraries / file_name(model, version) / "binaries" / folder / name


def test_every_platform_promised_has_its_library(libraries: Path, model: Model, version: FmiVersion) -> None:
    binaries = libraries / file_name(model, version) / "binaries"
    assert sorted(path.name for path in binaries.iterdir()) == sorted(FOLDERS[version])
    for folder in FOLDERS[version]:
        assert [path.name for path in (binaries / folder).iterdir()] == [library(libraries, model, version, folder).name]


def test_libraries_are_of_the_platform_they_lie_under(libraries: Path, model: Model) -> None:
    for folder, extension in FOLDERS[3].items():
        content = library(libraries, model, 3, folder).read_bytes()
        if extension == ".so":
            assert content[:4] == b"\x7fELF"
            assert struct.unpack_from("<H", content, 18) == (ELF_MACHINE[folder],)
        elif extension == ".dll":
            (header,) = struct.unpack_from("<I", content, 60)
            assert content[header : header + 4] == b"PE\0\0"
            assert struct.unpack_from("<H", content, header + 4) == (PE_MACHINE,)
        else:
            assert struct.unpack_from("<II", content) == (0xFEEDFACF, MACH_CPU[folder])


@pytest.mark.parametrize("folder", MACH_CPU)
def test_macos_11_is_enough(libraries: Path, model: Model, folder: str) -> None:
    content = library(libraries, model, 3, folder).read_bytes()
    commands, offset = struct.unpack_from("<I", content, 16)[0], 32
    oldest = []
    for _ in range(commands):
        command, size = struct.unpack_from("<II", content, offset)
        if command == 0x32:  # LC_BUILD_VERSION
            oldest.append(struct.unpack_from("<I", content, offset + 12)[0] >> 16)
        offset += size
    assert oldest == [11]


def test_glibc_2_17_is_enough(libraries: Path, model: Model, version: FmiVersion) -> None:
    for folder in (folder for folder, extension in FOLDERS[version].items() if extension == ".so"):
        content = library(libraries, model, version, folder).read_bytes()
        versions = {tuple(map(int, part.split(b"\0")[0].split(b"."))) for part in content.split(b"\0GLIBC_")[1:]}
        assert versions
        assert max(versions) <= (2, 17)


def test_libraries_export_the_interface_alone(libraries: Path, model: Model, version: FmiVersion) -> None:
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("needs nm")
    for folder in (folder for folder, extension in FOLDERS[version].items() if extension == ".so"):
        path = library(libraries, model, version, folder)
        output = subprocess.run([nm, "-D", "--defined-only", str(path)], capture_output=True, text=True, check=True).stdout
        names = {line.split()[-1] for line in output.splitlines()}
        assert len(names) == {2: 44, 3: 75}[version]
        assert all(name.startswith(f"fmi{version}") for name in names), folder
    (windows,) = (folder for folder, extension in FOLDERS[version].items() if extension == ".dll")
    names = exported(library(libraries, model, version, windows).read_bytes())
    assert len(names) == {2: 44, 3: 75}[version]
    assert all(name.startswith(f"fmi{version}") for name in names)


def exported(content: bytes) -> list[str]:
    """The names a Windows library exports (PE format, Microsoft)."""
    (header,) = struct.unpack_from("<I", content, 60)
    (sections,) = struct.unpack_from("<H", content, header + 6)
    (optional,) = struct.unpack_from("<H", content, header + 20)
    rows = [struct.unpack_from("<4I", content, header + 24 + optional + 40 * k + 8) for k in range(sections)]

    def place(address: int) -> int:
        return next(address - start + raw for size, start, _, raw in rows if start <= address < start + size)

    directory = place(struct.unpack_from("<I", content, header + 24 + 112)[0])
    count, _, names = struct.unpack_from("<3I", content, directory + 24)
    starts = [place(address) for address in struct.unpack_from(f"<{count}I", content, place(names))]
    return [content[start : content.index(b"\0", start)].decode() for start in starts]


@pytest.mark.parametrize("folder", ["x86_64-darwin", "aarch64-darwin"])
def test_macos_libraries_export_the_interface_alone(libraries: Path, model: Model, folder: str) -> None:
    content = library(libraries, model, 3, folder).read_bytes()
    names = mach_exported(content) - {"__mh_dylib_header", "___dso_handle"}  # zig's linker adds these two
    assert len(names) == 75
    assert all(name.startswith("_fmi3") for name in names)


def mach_exported(content: bytes) -> set[str]:
    """The names a macOS library exports (Mach-O format, Apple)."""
    commands, offset = struct.unpack_from("<I", content, 16)[0], 32
    names = set()
    for _ in range(commands):
        command, size = struct.unpack_from("<II", content, offset)
        if command == 0x02:  # LC_SYMTAB
            symbols, count, strings, _ = struct.unpack_from("<4I", content, offset + 8)
            for k in range(count):
                start, kind = struct.unpack_from("<IB", content, symbols + 16 * k)
                if kind & 0x01 and not kind & 0x10 and kind & 0x0E:  # external, not private, defined
                    names.add(content[strings + start : content.index(b"\0", strings + start)].decode())
        offset += size
    return names


def test_the_same_sources_give_the_same_bytes(libraries: Path, model: Model) -> None:
    for platform in PLATFORMS:
        assert shared_library(model, 3, platform) == library(libraries, model, 3, platform.name).read_bytes(), platform.name


def test_fmpy_finds_no_problem(everywhere: Path, model: Model, version: FmiVersion) -> None:
    assert validate_fmu(str(everywhere / file_name(model, version))) == []


def test_one_platform_alone(tmp_path: Path) -> None:
    build(tmp_path, [3], platform="aarch64-linux")
    with zipfile.ZipFile(tmp_path / file_name("planner", 3)) as container:
        binaries = [name for name in container.namelist() if name.startswith("binaries/")]
    assert binaries == ["binaries/aarch64-linux/DeltaPlanner.so"]


def test_zig_serves_where_there_is_no_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, libraries: Path) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert shared_library("planner", 3) == library(libraries, "planner", 3, host().name).read_bytes()


@pytest.mark.skipif(host().name != "x86_64-linux", reason="runs on x86_64 Linux")
def test_this_platform_computes_the_bits_of_the_host_build(everywhere: Path, dist: Path, version: FmiVersion) -> None:
    found = np.array(list(TOOLS["fmpy"](everywhere, version, "fmu")))
    assert (found == list(TOOLS["fmpy"](dist, version, "fmu"))).all()


def test_aarch64_computes_the_same(libraries: Path, dist: Path, tmp_path: Path) -> None:
    emulator = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if emulator is None or not SYSROOT.is_dir():
        pytest.skip("needs qemu-user-static and libc6-arm64-cross")
    (platform,) = (platform for platform in PLATFORMS if platform.name == "aarch64-linux")
    compile_host(compiler(platform), tmp_path / "host")
    command = [emulator, "-L", str(SYSROOT), str(tmp_path / "host")]
    found = run_cell(command, {model: library(libraries, model, 3, platform.name) for model in MODELS})
    expected = np.array(list(TOOLS["fmpy"](dist, 3, "fmu")))
    # The same sources without contraction, but the libm of another machine: its rounding, amplified by the plant's loops.
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()
