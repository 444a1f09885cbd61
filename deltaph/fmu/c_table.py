"""The C side of a variable table: the structure of an FMU's variables, and the table its adapter reads."""

from __future__ import annotations

import re
from itertools import groupby

from deltaph.variables import Model, Variable, VariableTable

HEADER = "model_variables.h"
SOURCE = "model_variables.c"
_NOTE = "/* Generated from variables.toml; not to be edited. */"
_C_TYPES = {"Float64": "TYPE_FLOAT64", "Int32": "TYPE_INT32", "Boolean": "TYPE_BOOLEAN"}


def _upper(name: str) -> str:
    """`PlanStatus` as `PLAN_STATUS`."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).upper()


def header(table: VariableTable) -> str:
    """`model_variables.h`: a structure with a member per group, doubles first, and a constant per item of an enumeration."""
    doubles, integers = [], []
    for group, members in groupby(table, key=lambda v: v.group):
        variables = list(members)
        shape = "" if variables[0].index is None else f"[{len(variables)}]"
        if variables[0].is_float:
            doubles.append(f"    double {group}{shape};")
        else:
            integers.append(f"    int32_t {group}{shape};")
    enumerations = [
        f"enum {{ {', '.join(f'{_upper(name)}_{item.upper()}' for item in items)} }};" for name, items in table.enumerations.items()
    ]
    lines = [
        _NOTE,
        "#ifndef MODEL_VARIABLES_H",
        "#define MODEL_VARIABLES_H",
        "",
        "#include <stdint.h>",
        "",
        "typedef struct {",
        *doubles,
        *integers,
        "} Variables;",
        "",
        *enumerations,
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _number(value: float | None, otherwise: str) -> str:
    return otherwise if value is None else repr(float(value))


def _row(variable: Variable, table: VariableTable) -> str:
    low, high = variable_range(variable, table)
    member = variable.group if variable.index is None else f"{variable.group}[{variable.index}]"
    return (
        f'    {{"{variable.name}", {variable.value_reference}, {_C_TYPES.get(variable.type, "TYPE_ENUMERATION")}, '
        f"CAUSALITY_{variable.causality.upper()}, offsetof(Model, v.{member}), {_number(variable.start, '0.0')}, "
        f"{_number(low, '-INFINITY')}, {_number(high, 'INFINITY')}}},"
    )


def variable_range(variable: Variable, table: VariableTable) -> tuple[float | None, float | None]:
    """Smallest and largest legal value, None where there is none; an enumeration ranges over its items."""
    if variable.type in table.enumerations:
        return 0, len(table.items(variable.type)) - 1
    return variable.min, variable.max


def source(model: Model, table: VariableTable, token: str) -> str:
    """`model_variables.c`: `model_info`, as fmu_src/fmi/model.h declares it."""
    lines = [
        _NOTE,
        "#include <math.h>",
        "",
        '#include "fmi/model.h"',
        f'#include "{model}/{model}.h"',
        "",
        "static const Variable variables[] = {",
        *(_row(variable, table) for variable in table),
        "};",
        "",
        "const ModelInfo model_info = {",
        f'    "{table.model}",',
        f'    "{token}",',
        "    sizeof(Model),",
        "    sizeof variables / sizeof *variables,",
        "    variables,",
        "};",
    ]
    return "\n".join(lines) + "\n"
