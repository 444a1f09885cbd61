"""The platform this runs on, by the names the FMI has for it."""

from __future__ import annotations

import platform
from typing import NamedTuple

from deltaph.errors import EnvironmentProblem
from deltaph.fmu.model_description import FmiVersion

_SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib"), "Windows": ("windows", ".dll")}
_ARCHITECTURES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_FMI2_FOLDERS = {"x86_64-linux": "linux64", "x86_64-darwin": "darwin64", "x86_64-windows": "win64"}


class Platform(NamedTuple):
    """A platform.

    Attributes:
        name: the platform tuple of FMI 3.0, such as `x86_64-linux`.
        extension: of shared libraries, with its dot.
    """

    name: str
    extension: str

    def folder(self, version: FmiVersion) -> str:
        """The folder below `binaries`. FMI 2.0 only names x86; for others its tools take the tuple."""
        return _FMI2_FOLDERS.get(self.name, self.name) if version == 2 else self.name


def host() -> Platform:
    """The platform this runs on.

    Raises:
        EnvironmentProblem: the FMI has no name for it that is known here.
    """
    system, machine = platform.system(), platform.machine()
    if system not in _SYSTEMS or machine.lower() not in _ARCHITECTURES:
        raise EnvironmentProblem(f"no FMU can be built for {system} on {machine}: use Linux, macOS or Windows on x86_64 or aarch64")
    name, extension = _SYSTEMS[system]
    return Platform(f"{_ARCHITECTURES[machine.lower()]}-{name}", extension)
