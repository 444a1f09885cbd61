"""The cell as a system description: planner and plant, connected by name (SSP 1.0)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from deltaph.fmu.model_description import GENERATION_TOOL, STOP_TIME, FmiVersion
from deltaph.fmu.terminals import JOINTS, MEMBERS
from deltaph.fmu.units import base_unit
from deltaph.variables import MODELS, Model, VariableTable, variable_table

_NAMESPACES = {
    "xmlns:ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "xmlns:ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "xmlns:ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}
PARAMETER_SET = "defaults"
"""The name of the set of parameters; Ecos applies it when asked to by this name."""

_TYPES = {"Float64": "ssc:Real", "Int32": "ssc:Integer", "Boolean": "ssc:Boolean"}


def file_name(version: FmiVersion) -> str:
    """The name of the system's file."""
    return f"DeltaCell{'-fmi2' if version == 2 else ''}.ssp"


def _connectors(component: ET.Element, table: VariableTable) -> None:
    """All variables. No enumerations: nothing is connected to them, and libcosim refuses systems that have them."""
    connectors = ET.SubElement(component, "ssd:Connectors")
    for variable in (*table.of("parameter"), *table.of("input"), *table.of("output")):
        if variable.type in _TYPES:
            connector = ET.SubElement(connectors, "ssd:Connector", {"name": variable.name, "kind": variable.causality})
            ET.SubElement(connector, _TYPES[variable.type], {"unit": variable.unit} if variable.unit else {})


def _parameters(component: ET.Element, table: VariableTable) -> None:
    """The parameters with their start values: the place to edit them without opening an FMU."""
    binding = ET.SubElement(ET.SubElement(component, "ssd:ParameterBindings"), "ssd:ParameterBinding")
    values = ET.SubElement(binding, "ssd:ParameterValues")
    parameter_set = ET.SubElement(values, "ssv:ParameterSet", {"version": "1.0", "name": PARAMETER_SET})
    parameters = ET.SubElement(parameter_set, "ssv:Parameters")
    for variable in table.of("parameter"):
        if variable.type in _TYPES:
            parameter = ET.SubElement(parameters, "ssv:Parameter", {"name": variable.name})
            unit = {"unit": variable.unit} if variable.unit else {}
            number = float(variable.start or 0) if variable.is_float else int(variable.start or 0)
            ET.SubElement(parameter, _TYPES[variable.type].replace("ssc", "ssv"), {"value": repr(number), **unit})


def _units(root: ET.Element, tables: list[VariableTable]) -> None:
    units = ET.SubElement(root, "ssd:Units")
    for name in sorted({v.unit for table in tables for v in table if v.unit}):
        unit = ET.SubElement(units, "ssc:Unit", {"name": name})
        ET.SubElement(unit, "ssc:BaseUnit", {base: str(exponent) for base, exponent in base_unit(name).items()})


def system_structure(sources: Mapping[Model, str]) -> bytes:
    """`SystemStructure.ssd`.

    Args:
        sources: component -> path of its FMU in the archive.
    """
    root = ET.Element("ssd:SystemStructureDescription", _NAMESPACES)
    root.attrib |= {"version": "1.0", "name": "DeltaCell", "generationTool": GENERATION_TOOL}
    system = ET.SubElement(root, "ssd:System", {"name": "cell"})
    elements = ET.SubElement(system, "ssd:Elements")
    tables = [variable_table(model) for model in MODELS]
    for model, table in zip(MODELS, tables, strict=True):
        component = ET.SubElement(elements, "ssd:Component", {"name": model, "source": sources[model]})
        _connectors(component, table)
        _parameters(component, table)
    connections = ET.SubElement(system, "ssd:Connections")
    for signal, reference in MEMBERS.items():
        for joint in JOINTS:
            ET.SubElement(
                connections,
                "ssd:Connection",
                {
                    "startElement": "planner",
                    "startConnector": f"joint[{joint}].{signal}",
                    "endElement": "plant",
                    "endConnector": f"joint[{joint}].{reference}",
                },
            )
    _units(root, tables)
    ET.SubElement(root, "ssd:DefaultExperiment", {"startTime": "0.0", "stopTime": repr(STOP_TIME)})
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
