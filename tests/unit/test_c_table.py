"""The generated C."""

from types import MappingProxyType
from typing import Any

from deltaph.fmu.c_table import header, source, variable_range
from deltaph.variables import Variable, VariableTable


def variable(name: str, reference: int, **facts: Any) -> Variable:
    usual: dict[str, Any] = {
        "group": name,
        "index": None,
        "causality": "input",
        "variability": "continuous",
        "type": "Float64",
        "unit": "1",
        "start": 0.5,
        "min": None,
        "max": None,
        "description": "",
    }
    return Variable(name=name, value_reference=reference, **usual | facts)


TABLE = VariableTable(
    model="Thing",
    description="",
    variables=(
        variable("mode", 1, type="PlanMode", start=1, unit=None),
        variable("a[1]", 5, group="a", index=0, causality="output", start=None),
        variable("a[2]", 6, group="a", index=1, causality="output", start=None),
        variable("b", 9, causality="parameter", min=0.0),
    ),
    enumerations=MappingProxyType({"PlanMode": {"slow": "", "very_fast": ""}}),
    gains=MappingProxyType({}),
)


def test_header_has_doubles_first_and_names_every_item() -> None:
    text = header(TABLE)
    assert "typedef struct {\n    double a[2];\n    double b;\n    int32_t mode;\n} Variables;" in text
    assert "enum { PLAN_MODE_SLOW, PLAN_MODE_VERY_FAST };" in text


def test_source_has_a_row_per_scalar() -> None:
    text = source("planner", TABLE, "{token}")
    assert '{"mode", 1, TYPE_ENUMERATION, CAUSALITY_INPUT, offsetof(Model, v.mode), 1.0, 0.0, 1.0},' in text
    assert '{"a[2]", 6, TYPE_FLOAT64, CAUSALITY_OUTPUT, offsetof(Model, v.a[1]), 0.0, -INFINITY, INFINITY},' in text
    assert '{"b", 9, TYPE_FLOAT64, CAUSALITY_PARAMETER, offsetof(Model, v.b), 0.5, 0.0, INFINITY},' in text
    assert '"{token}"' in text
    assert '#include "planner/planner.h"' in text


def test_an_enumeration_ranges_over_its_items() -> None:
    assert variable_range(TABLE["mode"], TABLE) == (0, 1)
    assert variable_range(TABLE["b"], TABLE) == (0.0, None)
