"""The `sources` folder of an FMU: one C file, the headers of the FMI it includes, and how to build it."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from deltaph.fmu.compile import fmi_headers
from deltaph.fmu.model_description import FmiVersion, source_name
from deltaph.fmu.translation_unit import translation_unit
from deltaph.variables import Model, VariableTable, variable_table

_HEADERS: dict[FmiVersion, tuple[str, ...]] = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def _build_description(table: VariableTable) -> bytes:
    """`buildDescription.xml` of FMI 3.0. FMI 2.0 lists its sources in the model description."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": table.model})
    sources = ET.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    ET.SubElement(sources, "SourceFile", {"name": source_name(table)})
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def sources(model: Model, version: FmiVersion) -> dict[str, bytes]:
    """Path in the FMU -> content."""
    table = variable_table(model)
    files = {source_name(table): translation_unit(model, version)}
    files |= {name: (fmi_headers() / name).read_bytes() for name in _HEADERS[version]}
    if version == 3:
        files["buildDescription.xml"] = _build_description(table)
    return {f"sources/{name}": content for name, content in files.items()}
