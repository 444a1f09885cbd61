"""The documentation inside an FMU: one page with its variables, and the licence."""

from __future__ import annotations

import html
from collections.abc import Iterable
from importlib.metadata import distribution

from deltaph.fmu.c_table import variable_range
from deltaph.sources import FMU_SRC
from deltaph.variables import Variable, VariableTable

_STYLE = "body{font-family:sans-serif;max-width:70em;margin:2em auto}td,th{text-align:left;padding:.1em .6em;vertical-align:top}"


def _row(cells: Iterable[str], tag: str = "td") -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"


def _cells(variable: Variable, table: VariableTable) -> list[str]:
    numbers = [variable.start, *variable_range(variable, table)]
    return [
        variable.name,
        variable.type,
        variable.unit or "",
        *("" if number is None else f"{number:g}" for number in numbers),
        variable.description,
    ]


def index_html(table: VariableTable) -> bytes:
    """`documentation/index.html`: what the model is, and its variables."""
    lines = [
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{table.model}</title><style>{_STYLE}</style></head>',
        f"<body><h1>{table.model}</h1><p>{html.escape(table.description)}.</p>",
    ]
    for title, causality in (("Parameters", "parameter"), ("Inputs", "input"), ("Outputs", "output")):
        lines += [f"<h2>{title}</h2><table>", _row(("Name", "Type", "Unit", "Start", "Min", "Max", "Meaning"), "th")]
        lines += [_row(_cells(variable, table)) for variable in table if variable.causality == causality]
        lines.append("</table>")
    for name, items in table.enumerations.items():
        lines += [f"<h2>{html.escape(name)}</h2><table>"]
        lines += [_row((str(value), *item)) for value, item in enumerate(items.items())]
        lines.append("</table>")
    return ("\n".join(lines) + "\n</body></html>\n").encode()


def license_text() -> bytes | None:
    """The licence: beside the sources in a checkout, in the metadata of an installed package; None where it is in neither."""
    file = FMU_SRC.parent / "LICENSE"
    if file.is_file():
        return file.read_bytes()
    text = distribution("deltaph").read_text("licenses/LICENSE")
    return text.encode() if text else None
