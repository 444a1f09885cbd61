"""Where the C sources and the variable tables lie: inside an installed package, or beside it in a checkout."""

from __future__ import annotations

from pathlib import Path


def _find() -> Path:
    package = Path(__file__).resolve().parent
    for candidate in (package / "fmu_src", package.parent / "fmu_src"):
        if (candidate / "kernel" / "kernel.h").is_file():
            return candidate
    raise FileNotFoundError(f"the C sources of deltaph are neither in {package} nor beside it: install deltaph again")


FMU_SRC = _find()

ROBOTS = Path(__file__).resolve().parent / "robots"
"""Where the named robots lie."""
