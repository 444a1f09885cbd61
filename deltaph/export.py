"""`deltaph export`: a recording as a table, for whatever reads CSV or Parquet."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import get_args

import numpy as np
import pyarrow
import pyarrow.parquet
from numpy.typing import NDArray

from deltaph.errors import DeltaphError
from deltaph.files import replace, write_text
from deltaph.outputs import write_csv
from deltaph.scenario import scenario_from_json
from deltaph.telemetry import MessageName, layout
from deltaph.telemetry.reading import Reading, Rows
from deltaph.telemetry.signals import is_held

FloatArray = NDArray[np.float64]

_LANES: dict[str, tuple[MessageName, str]] = {"phase": ("setpoint", "path.phase"), "trip": ("actual", "trip")}
"""Entity of states -> the message and the field they come from."""

_PREFIXES = {"setpoint": "", "actual": "plant."}
"""Of the columns, as in `run --csv`."""

_RENAMED = {"path/deviation": "path.vertex_distance"}


def export(recording: Path, entity: str | None) -> dict[str, FloatArray]:
    """The columns of a recording: `time` [s], `step`, and the signals under the names that `run --csv` has.

    Args:
        recording: of deltaph.
        entity: the only one to export, at its own rows; None joins all signals on `sim_time`, NaN where one has no row.

    Raises:
        DeltaphError: it is no recording of deltaph, or has no such entity.
    """
    reading = Reading(recording)
    tables = {name: rows for name, rows in reading.rows.items() if not name.rpartition("/")[2].startswith("limit")}
    if entity is not None:
        name = entity.strip("/")
        everything = reading.rows | reading.lanes
        if name not in everything:
            near = difflib.get_close_matches(name, everything, n=1, cutoff=0.4)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(everything))}"
            raise DeltaphError(f"{recording} has no signal {entity}: {hint}")
        rows = everything[name]
        return _index(rows.nanoseconds, rows.step) | _columns(name, _numbers(name, rows, reading))
    nanoseconds, first = np.unique(np.concatenate([rows.nanoseconds for rows in tables.values()]), return_index=True)
    columns = _index(nanoseconds, np.concatenate([rows.step for rows in tables.values()])[first])
    for name, rows in tables.items():
        values = np.full((len(nanoseconds), rows.values.shape[1]), np.nan)
        if is_held(name):
            begun = nanoseconds >= rows.nanoseconds[0]
            values[begun] = rows.values[np.searchsorted(rows.nanoseconds, nanoseconds[begun], side="right") - 1]
        else:
            values[np.searchsorted(nanoseconds, rows.nanoseconds)] = rows.values
        columns |= _columns(name, values)
    for name, rows in reading.lanes.items():
        held = np.searchsorted(rows.nanoseconds, nanoseconds, side="right") - 1  # a state lasts until the next one
        columns |= _columns(name, _numbers(name, rows, reading)[held])
    return columns


def write(columns: dict[str, FloatArray], csv: Path | None, parquet: Path | None) -> None:
    """Write a table as CSV, as Parquet, or both.

    Raises:
        EnvironmentProblem: a file cannot be written; nothing is left behind.
    """
    if csv is not None:
        write_text(csv, lambda stream: write_csv(stream, columns))
    if parquet is not None:
        replace(parquet, lambda path: pyarrow.parquet.write_table(pyarrow.table(columns), path))


def _index(nanoseconds: NDArray[np.int64], step: NDArray[np.int64]) -> dict[str, FloatArray]:
    return {"time": nanoseconds / 1e9, "step": step.astype(np.float64)}


def _numbers(entity: str, rows: Rows, reading: Reading) -> FloatArray:
    """Values of an entity (n, series); states become the numbers of their enumeration, operations count from 1."""
    if entity == "operation":
        moves = ["none", *(move.name for move in scenario_from_json(reading.scenario_json).moves)]
        return np.array([[float(moves.index(state))] for state in rows.values[:, 0]])
    if entity not in _LANES:
        return np.asarray(rows.values, dtype=np.float64)
    message, name = _LANES[entity]
    items = next(field.items for field in layout(message).fields if field.name == name)
    return np.array([[float(items.index(state))] for state in rows.values[:, 0]])


def _columns(entity: str, values: FloatArray) -> dict[str, FloatArray]:
    """The series of an entity (n, series) by name."""
    if entity in _LANES:
        message, field = _LANES[entity]
        return {_PREFIXES[message] + field: values[:, 0]}
    quantity, _, role = entity.rpartition("/")
    prefix = _PREFIXES.get(role)
    quantity = entity if prefix is None else quantity
    name = _RENAMED.get(quantity, quantity.replace("/", "."))
    group = [field.name for key in get_args(MessageName) for field in layout(key).fields if _stem(field.name) == name]
    names = list(dict.fromkeys(group))
    if len(names) != values.shape[1]:
        names = [name] if values.shape[1] == 1 else [f"{name}[{i + 1}]" for i in range(values.shape[1])]
    return {(prefix or "") + one: column for one, column in zip(names, values.T, strict=True)}


def _stem(name: str) -> str:
    """`joint[1].position` -> `joint.position`, `tcp.position.x` -> `tcp.position`."""
    head, _, tail = name.rpartition(".")
    stem = head if tail in ("x", "y", "z") else name
    return "".join(part.partition("]")[2] if i else part for i, part in enumerate(stem.split("[")))
