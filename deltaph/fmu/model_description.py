"""`modelDescription.xml` of FMI 2.0 and FMI 3.0, from a variable table."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from importlib.metadata import version as installed_version
from typing import Literal

from deltaph.fmu.c_table import variable_range
from deltaph.fmu.units import DISPLAY_UNITS, base_unit, display_unit
from deltaph.variables import Variable, VariableTable

FmiVersion = Literal[2, 3]

STEP_SIZE = 1e-3
"""The models' own step [s]: MODEL_STEP of fmu_src/fmi/model.h."""

STOP_TIME = 0.353
"""Default stop time [s]: the PPO of the start values takes 0.303 s, then 50 ms to settle."""

GENERATION_TOOL = f"deltaph {installed_version('deltaph')}"

_LOG_CATEGORIES = {
    "logEvents": "What happens: plans, trips",
    "logStatusWarning": "What is worth a look: refused requests",
    "logStatusDiscard": "Calls that were not carried out and may be repeated with other arguments",
    "logStatusError": "Wrong calls",
}


def source_name(table: VariableTable) -> str:
    """The name of the C file in a source FMU."""
    return f"{table.model}.c"


def _text(value: float | int) -> str:
    return str(value) if isinstance(value, int) else repr(value)


def _add(parent: ET.Element, tag: str, **attributes: str | float | int | None) -> ET.Element:
    """Append an element; attributes that are None are left out."""
    return ET.SubElement(parent, tag, {k: v if isinstance(v, str) else _text(v) for k, v in attributes.items() if v is not None})


def _units(root: ET.Element, table: VariableTable) -> None:
    definitions = _add(root, "UnitDefinitions")
    shown = {(v.unit, display_unit(v)) for v in table}
    for name in sorted({v.unit for v in table if v.unit} | {"s"}):
        unit = _add(definitions, "Unit", name=name)
        _add(unit, "BaseUnit", **base_unit(name))
        display = DISPLAY_UNITS.get(name)
        if display is not None and (name, display) in shown:
            _add(unit, "DisplayUnit", name=display.name, factor=display.factor)


def _enumerations(root: ET.Element, table: VariableTable, version: FmiVersion) -> None:
    definitions = _add(root, "TypeDefinitions")
    for name, items in table.enumerations.items():
        if version == 2:
            kind = _add(_add(definitions, "SimpleType", name=name), "Enumeration")
        else:
            kind = _add(definitions, "EnumerationType", name=name)
        for value, (item, description) in enumerate(items.items()):
            _add(kind, "Item", name=item, value=value, description=description)


def _type_attributes(variable: Variable, table: VariableTable) -> dict[str, str | float | int | None]:
    """What the FMI says per type: unit, range, start value, declared type."""
    display = display_unit(variable)
    low, high = variable_range(variable, table)
    number = float if variable.is_float else int
    attributes: dict[str, str | float | int | None] = {
        "declaredType": variable.type if variable.type in table.enumerations else None,
        "unit": variable.unit,
        "displayUnit": display.name if display else None,
        "min": None if low is None else number(low),
        "max": None if high is None else number(high),
    }
    if variable.causality != "output" and variable.start is not None:
        attributes["start"] = str(bool(variable.start)).lower() if variable.type == "Boolean" else number(variable.start)
    return attributes


def _attributes(variable: Variable) -> dict[str, str | float | int | None]:
    """What both versions say of a variable, whatever its type."""
    return {
        "name": variable.name,
        "valueReference": variable.value_reference,
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
        "initial": "calculated" if variable.causality == "output" else None,
    }


def _variables_2(parent: ET.Element, table: VariableTable) -> None:
    tags = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}
    for variable in table:
        scalar = _add(parent, "ScalarVariable", **_attributes(variable))
        _add(scalar, tags.get(variable.type, "Enumeration"), **_type_attributes(variable, table))


def _variables_3(parent: ET.Element, table: VariableTable) -> None:
    _add(
        parent,
        "Float64",
        name="time",
        valueReference=0,
        description="Simulation time",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    for variable in table:
        _add(
            parent,
            "Enumeration" if variable.type in table.enumerations else variable.type,
            **_attributes(variable),
            **_type_attributes(variable, table),
        )


def _structure(root: ET.Element, table: VariableTable, version: FmiVersion) -> None:
    """Every output, by its number in FMI 2.0 and its value reference in FMI 3.0. No dependencies are given: all are possible."""
    structure = _add(root, "ModelStructure")
    if version == 2:
        numbers = [number for number, variable in enumerate(table, start=1) if variable.causality == "output"]
        for name in ("Outputs", "InitialUnknowns"):
            unknowns = _add(structure, name)
            for number in numbers:
                _add(unknowns, "Unknown", index=number)
    else:
        for name in ("Output", "InitialUnknown"):
            for variable in table.of("output"):
                _add(structure, name, valueReference=variable.value_reference)


def model_description(table: VariableTable, version: FmiVersion, token: str) -> bytes:
    """The XML document. It bears no date: equal inputs give equal bytes."""
    root = ET.Element("fmiModelDescription")
    root.attrib.update(
        {
            "fmiVersion": f"{version}.0",
            "modelName": table.model,
            "guid" if version == 2 else "instantiationToken": token,
            "description": table.description,
            "license": "BSD-3-Clause",
            "generationTool": GENERATION_TOOL,
            "variableNamingConvention": "structured",
        }
    )
    capabilities: dict[str, str | float] = {
        "modelIdentifier": table.model,
        "canHandleVariableCommunicationStepSize": "true",
    }
    if version == 2:
        capabilities |= {
            "canNotUseMemoryManagementFunctions": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
        }
    else:
        capabilities |= {
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "fixedInternalStepSize": STEP_SIZE,
        }
    interface = _add(root, "CoSimulation", **capabilities)
    if version == 2:
        _add(_add(interface, "SourceFiles"), "File", name=source_name(table))
    _units(root, table)
    _enumerations(root, table, version)
    categories = _add(root, "LogCategories")
    for name, description in _LOG_CATEGORIES.items():
        _add(categories, "Category", name=name, description=description)
    _add(root, "DefaultExperiment", startTime=0.0, stopTime=STOP_TIME, stepSize=STEP_SIZE)
    variables = _add(root, "ModelVariables")
    if version == 2:
        _variables_2(variables, table)
    else:
        _variables_3(variables, table)
    _structure(root, table, version)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
