"""What runs where: the runs that `test_importers.py` makes, and the table in the README that says so.

    python tests/integration/compatibility.py

writes the table; a test holds it. A cell says yes only because a test of that name is in this suite and passes.
"""

from __future__ import annotations

from pathlib import Path

from deltaph.fmu.model_description import FmiVersion

README = Path(__file__).parents[2] / "README.md"
MARKS = "<!-- compatibility -->\n", "<!-- /compatibility -->"

RUNS: list[tuple[str, FmiVersion, str]] = [
    ("fmpy", 2, "fmu"),
    ("fmpy", 3, "fmu"),
    ("ecospy", 2, "fmu"),
    ("ecospy", 3, "fmu"),
    ("ecospy", 2, "ssp"),
    ("ecospy", 3, "ssp"),
    ("libcosimpy", 2, "fmu"),
    ("libcosimpy", 2, "ssp"),
    ("fmucontainer", 2, "fmu"),
    ("fmucontainer", 3, "fmu"),
]
"""Tool, FMI version, and whether it wires two FMUs itself or runs the system description."""

_TITLES = {
    "fmpy": ("FMPy", ""),
    "ecospy": ("Ecos (ecospy)", ""),
    "libcosimpy": ("libcosim (libcosimpy)", "it has no FMI 3.0"),
    "fmucontainer": ("fmucontainer, run in FMPy", "both packed into one FMU"),
}
_OTHER_ROWS = [
    ("`fmpy validate`, `fmutool -check`", "no finding", "no finding", "", "`test_fmu_build.py`"),
    ("`fmpy compile`, `fmutool -compile-sources`", "same outputs", "same outputs", "", "`test_source_fmu.py`"),
    ("x86_64 Linux, glibc 2.17", "executed", "executed", "", "`test_fmu_platforms.py`"),
    ("aarch64 Linux, glibc 2.17", "no name for it", "executed under qemu", "", "`test_fmu_platforms.py`"),
    ("x86_64 Windows, x86_64 macOS 11", "built", "built", "", "`test_fmu_platforms.py`; not executed"),
    ("aarch64 macOS 11", "no name for it", "built", "", "`test_fmu_platforms.py`; not executed"),
]


def _cells(tool: str) -> tuple[str, ...]:
    title, note = _TITLES[tool]
    ran = {(version, kind) for name, version, kind in RUNS if name == tool}
    versions = ["same trajectory" if (version, "fmu") in ran else "no" for version in (2, 3)]
    systems = ", ".join(f"FMI {version}.0" for version in (2, 3) if (version, "ssp") in ran) or "no"
    return (title, *versions, systems, note)


def markdown() -> str:
    """The table."""
    rows = [("", "FMI 2.0", "FMI 3.0", "SSP", ""), ("---",) * 5, *map(_cells, _TITLES), *_OTHER_ROWS]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def readme_table() -> str:
    """What stands in the README."""
    begin, end = MARKS
    return README.read_text(encoding="utf-8").split(begin)[1].split(end)[0]


def main() -> None:
    """Write it there."""
    text = README.read_text(encoding="utf-8")
    README.write_text(text.replace(readme_table(), markdown()), encoding="utf-8")


if __name__ == "__main__":
    main()
