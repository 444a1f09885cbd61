"""Recordings of any kind, read back without deltaph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rerun.chunk import RrdReader


def static_components(path: Path) -> dict[str, dict[str, Any]]:
    """The static components of a recording by entity and name; the last of each."""
    found: dict[str, dict[str, Any]] = {}
    for chunk in RrdReader(path).stream():
        if chunk.is_static:
            batch = chunk.to_record_batch()
            found.setdefault(chunk.entity_path, {}).update({name: batch.column(name)[-1].as_py() for name in batch.schema.names})
    return found


class Recording:
    """The rows and the static components of a recording, by entity."""

    def __init__(self, path: Path) -> None:
        reader = RrdReader(path)
        (self.recording,) = reader.recordings()
        self.blueprints = reader.blueprints()
        self.rows: dict[str, dict[str, NDArray[Any]]] = {}
        self.static = static_components(path)
        found: dict[str, list[Any]] = {}
        for chunk in reader.stream():
            if not chunk.is_static:
                found.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
        for entity, batches in found.items():
            columns = {
                name: [value for batch in batches for value in batch.column(name).to_pylist()]
                for name in batches[0].schema.names
                if name not in ("rerun.controls.RowId", "sim_time")
            }
            nanoseconds = np.concatenate(
                [batch.column("sim_time").to_numpy(zero_copy_only=False).astype(np.int64) for batch in batches]
            )
            order = np.argsort(nanoseconds, kind="stable")
            self.rows[entity] = {name: rows_of(values)[order] for name, values in columns.items()} | {
                "sim_time": nanoseconds[order]
            }

    def scalars(self, entity: str) -> NDArray[np.float64]:
        """Values (rows, series)."""
        return self.rows[entity]["Scalars:scalars"]


def rows_of(values: list[Any]) -> NDArray[Any]:
    """Rows of the same size as an array, others as lists."""
    try:
        return np.array(values)
    except ValueError:
        rows = np.empty(len(values), dtype=object)
        rows[:] = values
        return rows


def assert_same_rows(first: Recording, second: Recording) -> None:
    """The same entities, and the same rows but of limits, which have theirs at the ends of chunks."""
    assert first.rows.keys() == second.rows.keys()
    assert first.static.keys() == second.static.keys()
    for entity, rows in first.rows.items():
        if "limit" not in entity:
            for name, values in rows.items():
                assert np.array_equal(second.rows[entity][name], values), (entity, name)


def last_blueprint(path: Path, component: str) -> dict[str, Any]:
    """A component of the last blueprint of a recording, by the blueprint's entity."""
    reader = RrdReader(path)
    (*_, chunks) = sorted(([*reader.stream(store=entry)] for entry in reader.blueprints()), key=_newest)
    batches = [(chunk.entity_path, chunk.to_record_batch()) for chunk in chunks]
    return {entity: batch.column(component)[-1].as_py()[0] for entity, batch in batches if component in batch.schema.names}


def _newest(chunks: list[Any]) -> int:
    """Wall clock of the newest chunk of a blueprint [ns]."""
    batches = [chunk.to_record_batch() for chunk in chunks]
    return max(int(batch.column("log_time")[-1].value) for batch in batches if "log_time" in batch.schema.names)
