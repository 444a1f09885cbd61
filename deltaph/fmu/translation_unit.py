"""An FMU's C sources as one translation unit: what its binaries are compiled from, and what a source FMU carries.

Headers are put in once, where they are first included. Everything but the FMI's functions becomes static, so that a compiler that
is not told what to hide exports nothing else, and what two files call by the same name gets the file's name in front.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from deltaph.fmu import c_table
from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.sources import ELEMENTARY, c_files, token
from deltaph.sources import FMU_SRC
from deltaph.variables import Model, variable_table

SYSTEM_MATH = "SYSTEM_MATH"
"""Where this is defined, elementary functions are those of the system's libm."""

_HEAD = """\
/* {model}, FMI {version}.0: all its C sources in one file. Generated; its licence is in documentation/licenses.
 * To be compiled as C99, without contraction of floating-point expressions. It needs nothing but libc; with {system_math} defined
 * it uses the system's libm instead of its own elementary functions. Linked statically beside other FMUs, it takes
 * FMI{version}_FUNCTION_PREFIX from the compiler. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
{headers}"""

_INCLUDE = re.compile(r'^#include "([^"]+)"\n', re.MULTILINE)
_PROTOTYPE = re.compile(r"^(?!typedef\b|extern\b|static\b|else\b)(?=[A-Za-z_][\w *]*[ *]\w+\([^;{}]*\);)", re.MULTILINE)
_EXTERN = re.compile(r"^extern (?=[^;]*?(\w+)(?:\[[^\]]*\])?;)", re.MULTILINE)
_STATIC = re.compile(r"^static (?:inline )?(?:const )?(?:struct )?\w+ [*]*(?:const )?(\w+)", re.MULTILINE)
_MACRO = re.compile(r"^#define (\w+)", re.MULTILINE)


def _name(text: str) -> re.Pattern[str]:
    """This name, but not in a string and not as a member of a structure."""
    return re.compile(rf'"(?:\\.|[^"\\\n])*"|(?<![\w.>]){re.escape(text)}\b')


def _statics(text: str) -> list[str]:
    """Names with file scope of a C file."""
    names = _STATIC.findall(text)
    for line in re.findall(r"^static const \w+ \w+ = .*, \w+ = .*;", text, re.MULTILINE):
        names += re.findall(r", (\w+) =", line)
    return names


class _Unit:
    """The unit as it grows."""

    def __init__(self, generated: dict[str, str], version: FmiVersion) -> None:
        self._generated = generated
        self._seen: set[str] = set()
        self._objects: set[str] = set()
        self._standard = f"fmi{version}Functions.h"
        self.parts: list[str] = []

    def _header(self, name: str, folder: Path) -> str:
        """The text of a header that was not there yet."""
        if name == self._standard:
            return f'#include "{name}"\n'
        candidates = [path for path in (folder / name, FMU_SRC / name) if path.is_file()]
        key = str(candidates[0].resolve()) if candidates else name
        if key in self._seen:
            return ""
        self._seen.add(key)
        text = candidates[0].read_text(encoding="utf-8") if candidates else self._generated[name]
        self._objects |= set(_EXTERN.findall(text))
        text = _EXTERN.sub("static ", _PROTOTYPE.sub("static ", text))
        return self._resolved(text, candidates[0].parent if candidates else folder)

    def _resolved(self, text: str, folder: Path) -> str:
        return _INCLUDE.sub(lambda match: self._header(match[1], folder), text)

    def add(self, name: str, text: str, folder: Path, ambiguous: set[str]) -> None:
        """Append a C file."""
        stem = Path(name).stem
        for static in ambiguous.intersection(_statics(text)):
            text = _name(static).sub(lambda m: m[0] if m[0].startswith('"') else f"{stem}_{m[0]}", text)
        macros = dict.fromkeys(_MACRO.findall(text))
        text = self._resolved(text, folder)
        for known in self._objects:
            text = re.sub(rf"^const (?=\w+ {known}\b)", "static const ", text, flags=re.MULTILINE)
        undefined = "".join(f"#undef {macro}\n" for macro in macros)
        self.parts.append(f"\n/* ==== {name} ==== */\n\n{text}{undefined}")


def translation_unit(model: Model, version: FmiVersion) -> bytes:
    """The C source of an FMU, complete but for the headers of the FMI and of the standard library."""
    table = variable_table(model)
    generated = {c_table.HEADER: c_table.header(table)}
    texts = [(path.relative_to(FMU_SRC).as_posix(), path.read_text(encoding="utf-8")) for path in c_files(model, version)]
    texts.append((c_table.SOURCE, c_table.source(model, table, token(model, version))))
    counts = Counter(name for _, text in texts for name in set(_statics(text)))
    ambiguous = {name for name, count in counts.items() if count > 1}
    unit = _Unit(generated, version)
    for name, text in texts:
        unit.add(name, text, (FMU_SRC / name).parent, ambiguous)
    system_headers = sorted({line for _, text in texts for line in re.findall(r"^#include <\w+\.h>\n", text, re.MULTILINE)})
    head = _HEAD.format(model=table.model, version=version, system_math=SYSTEM_MATH, headers="".join(system_headers))
    mathematics = f"\n#if !defined({SYSTEM_MATH})\n{ELEMENTARY.read_text(encoding='utf-8')}#endif\n"
    return "".join([head, mathematics, *unit.parts]).encode()
