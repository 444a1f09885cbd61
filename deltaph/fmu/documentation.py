"""The documentation inside an FMU: one page with its equations and variables, and the licences."""

from __future__ import annotations

import html
from collections.abc import Iterable
from importlib.metadata import distribution

from markdown_it import MarkdownIt

from deltaph.errors import EnvironmentProblem
from deltaph.fmu.c_table import variable_range
from deltaph.sources import FMU_SRC
from deltaph.variables import Model, Variable, VariableTable, variable_table

_STYLE = (
    "body{font-family:sans-serif;max-width:70em;margin:2em auto}td,th{text-align:left;padding:.1em .6em;vertical-align:top}"
    "pre{background:#eceff1;padding:.6em}"
)


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


def _equations(model: Model) -> str:
    """The model's README as HTML, without its last section, which points to the page that this becomes part of."""
    text = (FMU_SRC / model / "README.md").read_text(encoding="utf-8")
    return str(MarkdownIt("commonmark").enable("table").render(text.split("\n", 1)[1].rsplit("\n## Variables\n", 1)[0]))


def index_html(model: Model) -> bytes:
    """`documentation/index.html`: what the model is, its equations, and its variables."""
    table = variable_table(model)
    lines = [
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{table.model}</title><style>{_STYLE}</style></head>',
        f"<body><h1>{table.model}</h1><p>{html.escape(table.description)}.</p>",
        _equations(model),
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


def licenses() -> dict[str, bytes]:
    """Path in the FMU -> licence: it lies beside the sources in a checkout, and in the metadata of an installed package.

    Raises:
        EnvironmentProblem: it is not there.
    """
    file = FMU_SRC.parent / "LICENSE"
    text = file.read_text(encoding="utf-8") if file.is_file() else distribution("deltaph").read_text("licenses/LICENSE")
    if not text:
        raise EnvironmentProblem("the licence of deltaph is not where it was installed: install it again")
    return {"documentation/licenses/license.txt": text.encode()}
