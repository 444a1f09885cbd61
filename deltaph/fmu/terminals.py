"""Terminals: the variables of a joint that are wired together, as one plug on planner and plant, and where the icon is."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from deltaph.fmu.icon import SIZE
from deltaph.variables import Model

JOINTS = (1, 2, 3)

MEMBERS = {"position": "position_ref", "velocity": "velocity_ref", "acceleration": "acceleration_ref", "torque": "torque_ff"}
"""Output of the planner's joint -> input of the plant's joint."""

_KIND = "deltaph.joint_setpoint"


def terminals_and_icons(model: Model) -> bytes:
    """`terminalsAndIcons.xml` of FMI 3.0. Plugs with members of the same names fit together."""
    root = ET.Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    graphics = ET.SubElement(root, "GraphicalRepresentation")
    corners = {"x1": "0", "y1": "0", "x2": str(SIZE), "y2": str(SIZE)}
    ET.SubElement(graphics, "CoordinateSystem", corners | {"suggestedScalingFactorTo_mm": "0.1"})
    ET.SubElement(graphics, "Icon", corners)
    terminals = ET.SubElement(root, "Terminals")
    for joint in JOINTS:
        attributes = {"name": f"joint[{joint}]", "matchingRule": "plug", "terminalKind": _KIND}
        terminal = ET.SubElement(terminals, "Terminal", attributes | {"description": f"Setpoint of joint {joint}"})
        for output, reference in MEMBERS.items():
            variable = f"joint[{joint}].{output if model == 'planner' else reference}"
            member = {"variableName": variable, "memberName": output, "variableKind": "signal"}
            ET.SubElement(terminal, "TerminalMemberVariable", member)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
