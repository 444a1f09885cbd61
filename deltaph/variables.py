"""The variable tables of the FMUs, read from `fmu_src/<fmu>/variables.toml`: the single truth everything else is generated from."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

from deltaph.sources import FMU_SRC

Causality = Literal["parameter", "input", "output"]
Variability = Literal["fixed", "continuous", "discrete"]
Model = Literal["planner", "plant"]

MODELS: tuple[Model, ...] = get_args(Model)
_AXES = "x|y|z"
_ENTRY_KEYS = {"name", "value_reference", "causality", "variability", "type", "unit", "start", "min", "max", "description"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """One scalar variable of an FMU.

    Attributes:
        name: structured name, such as `joint[1].position`.
        group: name of the C array or scalar it belongs to, such as `joint_position`.
        index: position in the group, or None where the group is a scalar.
        value_reference: the same in FMI 2 and FMI 3.
        type: Float64, Int32, Boolean, or the name of an enumeration.
        unit: SI unit, or None for what is not Float64.
        start: start value; None for outputs.
    """

    name: str
    group: str
    index: int | None
    value_reference: int
    causality: Causality
    variability: Variability
    type: str
    unit: str | None
    start: float | int | None
    min: float | None
    max: float | None
    description: str

    @property
    def is_float(self) -> bool:
        """Whether it is a Float64; all others are 32-bit integers in C and on the wire."""
        return self.type == "Float64"


@dataclass(frozen=True, slots=True)
class VariableTable:
    """The variables of one FMU, sorted by value reference; `time` (value reference 0) is not among them.

    Attributes:
        model: model identifier.
        description: one sentence on the model.
        variables: all of them.
        enumerations: name -> item -> description, numbered from 0 in this order.
        gains: name of a gain set -> variable -> value; empty for the planner.
    """

    model: str
    description: str
    variables: tuple[Variable, ...]
    enumerations: Mapping[str, Mapping[str, str]]
    gains: Mapping[str, Mapping[str, float]]

    def __getitem__(self, name: str) -> Variable:
        for variable in self.variables:
            if variable.name == name:
                return variable
        raise KeyError(f"{self.model} has no variable {name!r}")

    def __iter__(self) -> Iterator[Variable]:
        return iter(self.variables)

    def of(self, causality: Causality) -> tuple[Variable, ...]:
        """The variables of one causality, sorted by value reference."""
        return tuple(variable for variable in self.variables if variable.causality == causality)

    def items(self, enumeration: str) -> tuple[str, ...]:
        """The items of an enumeration; an item's number is its position."""
        return tuple(self.enumerations[enumeration])


def _scalars(entry: Mapping[str, Any], where: Path) -> Iterator[Variable]:
    """The scalar variables that one entry of the file stands for."""
    unknown = set(entry) - _ENTRY_KEYS
    if unknown:
        raise ValueError(f"{where}: unknown key {sorted(unknown)[0]!r} in {entry.get('name')!r}")
    name: str = entry["name"]
    causality: Causality = entry["causality"]
    kind: str = entry.get("type", "Float64")
    group = re.sub(r"\W", "_", name.replace("[i]", "").removesuffix("." + _AXES))
    if "[i]" in name:
        names = [name.replace("[i]", f"[{i}]") for i in (1, 2, 3)]
    elif name.endswith(_AXES):
        names = [name.removesuffix(_AXES) + axis for axis in _AXES.split("|")]
    else:
        names = [name]
    default: Variability = "fixed" if causality == "parameter" else "continuous" if kind == "Float64" else "discrete"
    start = entry.get("start")
    for offset, scalar in enumerate(names):
        yield Variable(
            name=scalar,
            group=group,
            index=offset if len(names) > 1 else None,
            value_reference=entry["value_reference"] + offset,
            causality=causality,
            variability=entry.get("variability", default),
            type=kind,
            unit=entry["unit"] if kind == "Float64" else None,
            start=start[offset] if isinstance(start, list) else start,
            min=entry.get("min"),
            max=entry.get("max"),
            description=entry["description"],
        )


@cache
def variable_table(model: Model) -> VariableTable:
    """The variable table of an FMU.

    Raises:
        ValueError: the file names an unknown key, an unknown type, or uses a name or a value reference twice.
    """
    path = FMU_SRC / model / "variables.toml"
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    entries = list(data["variable"])
    for include in data["include"]:
        entries += tomllib.loads((path.parent / include).read_text(encoding="utf-8"))["variable"]
    variables = sorted((v for entry in entries for v in _scalars(entry, path)), key=lambda v: v.value_reference)
    for what in ("name", "value_reference"):
        seen = [getattr(v, what) for v in variables]
        twice = {value for value in seen if seen.count(value) > 1}
        if twice:
            raise ValueError(f"{path}: {what} {sorted(twice)[0]!r} is used twice")
    types = {"Float64", "Int32", "Boolean", *data["enumerations"]}
    for variable in variables:
        if variable.type not in types:
            raise ValueError(f"{path}: {variable.name} has the unknown type {variable.type!r}")
    return VariableTable(
        model=data["model"],
        description=data["description"],
        variables=tuple(variables),
        enumerations=MappingProxyType(data["enumerations"]),
        gains=MappingProxyType(data.get("gains", {})),
    )
