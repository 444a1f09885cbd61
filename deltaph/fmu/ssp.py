"""The cell as a system description: planner and plant, connected by name (SSP 1.0)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from deltaph.fmu.model_description import GENERATION_TOOL, STOP_TIME, FmiVersion
from deltaph.fmu.units import base_unit
from deltaph.variables import MODELS, Model, VariableTable, variable_table

_NAMESPACES = {
    "xmlns:ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "xmlns:ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
}
_WIRES = {"position": "position_ref", "velocity": "velocity_ref", "acceleration": "acceleration_ref", "torque": "torque_ff"}
"""Output of the planner's joint -> input of the plant's joint."""

_TYPES = {"Float64": "ssc:Real", "Int32": "ssc:Integer", "Boolean": "ssc:Boolean"}


def file_name(version: FmiVersion) -> str:
    """The name of the system's file."""
    return f"DeltaCell{'-fmi2' if version == 2 else ''}.ssp"


def _connectors(component: ET.Element, table: VariableTable) -> None:
    """Inputs and outputs. No enumerations: nothing is connected to them, and libcosim refuses systems that have them."""
    connectors = ET.SubElement(component, "ssd:Connectors")
    for variable in (*table.of("input"), *table.of("output")):
        if variable.type in _TYPES:
            connector = ET.SubElement(connectors, "ssd:Connector", {"name": variable.name, "kind": variable.causality})
            ET.SubElement(connector, _TYPES[variable.type], {"unit": variable.unit} if variable.unit else {})


def _units(root: ET.Element, tables: list[VariableTable]) -> None:
    units = ET.SubElement(root, "ssd:Units")
    for name in sorted({v.unit for table in tables for v in table if v.unit and v.causality != "parameter"}):
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
    connections = ET.SubElement(system, "ssd:Connections")
    for signal, reference in _WIRES.items():
        for joint in (1, 2, 3):
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
