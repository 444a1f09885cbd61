"""The platforms an FMU can have a library for, by the names the FMI has for them."""

from __future__ import annotations

import platform
from collections.abc import Collection
from typing import NamedTuple

from deltaph.errors import DeltaphError, EnvironmentProblem
from deltaph.fmu.model_description import FmiVersion

_SYSTEMS = {"Linux": "linux", "Darwin": "darwin", "Windows": "windows"}
_ARCHITECTURES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_EXTENSIONS = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}
_FMI2_FOLDERS = {"x86_64-linux": "linux64", "x86_64-darwin": "darwin64", "x86_64-windows": "win64"}


class Platform(NamedTuple):
    """A platform.

    Attributes:
        name: the platform tuple of FMI 3.0, such as `x86_64-linux`.
        target: what zig calls it, with the oldest system the library runs on; empty where it is not cross-compiled for.
    """

    name: str
    target: str = ""

    @property
    def extension(self) -> str:
        """Of shared libraries, with its dot."""
        return _EXTENSIONS[self.name.split("-")[1]]

    @property
    def in_fmi_2(self) -> bool:
        """Whether FMI 2.0 has a name for it: it only names x86."""
        return self.name in _FMI2_FOLDERS

    def folder(self, version: FmiVersion) -> str:
        """The folder below `binaries`. Where FMI 2.0 has no name, its tools take the tuple."""
        return _FMI2_FOLDERS.get(self.name, self.name) if version == 2 else self.name


PLATFORMS = (
    Platform("x86_64-linux", "x86_64-linux-gnu.2.17"),
    Platform("aarch64-linux", "aarch64-linux-gnu.2.17"),
    Platform("x86_64-windows", "x86_64-windows-gnu"),
    Platform("x86_64-darwin", "x86_64-macos.11.0"),
    Platform("aarch64-darwin", "aarch64-macos.11.0"),
)
"""What `--platform all` builds. glibc 2.17 is that of CentOS 7; Windows from 10 on has the C runtime the library asks for."""


def host() -> Platform:
    """The platform this runs on.

    Raises:
        EnvironmentProblem: the FMI has no name for it that is known here.
    """
    system, machine = platform.system(), platform.machine()
    if system not in _SYSTEMS or machine.lower() not in _ARCHITECTURES:
        raise EnvironmentProblem(f"no FMU can be built for {system} on {machine}: use Linux, macOS or Windows on x86_64 or aarch64")
    name = f"{_ARCHITECTURES[machine.lower()]}-{_SYSTEMS[system]}"
    return next((known for known in PLATFORMS if known.name == name), Platform(name))


def chosen(name: str, version: FmiVersion) -> Collection[Platform]:
    """The platforms an FMU gets a library for.

    Args:
        name: `all`, or the name of one.
        version: FMI 2.0 knows three of the five.

    Raises:
        DeltaphError: the name is unknown, or FMI 2.0 has none for it.
    """
    names = [known.name for known in PLATFORMS]
    if name not in ("all", *names):
        raise DeltaphError(f"cannot build for {name!r}: choose host, all, {', '.join(names)}")
    found = [known for known in PLATFORMS if name in ("all", known.name) and (version == 3 or known.in_fmi_2)]
    if not found:
        raise DeltaphError(f"FMI 2.0 has no name for {name}: build it with --fmi 3")
    return found
