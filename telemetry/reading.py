"""Reads recordings back: the plotted signals by entity, and what was recorded about the scenario and its summary."""

from __future__ import annotations

import json
import re
import warnings
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from deltaph.errors import EnvironmentProblem
from deltaph.telemetry.signals import PLOT

FloatArray = NDArray[np.float64]

APPLICATION_ID = "deltaph"


class Rows(NamedTuple):
    """The rows of an entity in the order of time.

    Attributes:
        nanoseconds: simulation time (n,) [ns].
        step: communication point (n,).
        values: scalars (n, series), or the names of states (n, 1).
    """

    nanoseconds: NDArray[np.int64]
    step: NDArray[np.int64]
    values: NDArray[Any]


class Reading:
    """A recording of deltaph. One that was never finished, because its writer was killed, is read as far as it goes.

    Attributes:
        path: of the file.
        rows: signals by entity without the leading slash.
        lanes: states by entity, a row where one changes.
        units: of a signal's series, as their names have it; empty where there is none.

    Raises:
        EnvironmentProblem: there is no such file, or it is no recording of deltaph.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise EnvironmentProblem(f"there is no recording {path}: write one with `deltaph run SCENARIO --record {path}`")
        self.path = path
        self.rows: dict[str, Rows] = {}
        self.lanes: dict[str, Rows] = {}
        self.units: dict[str, str] = {}
        self._properties: dict[str, dict[str, Any]] = {}
        self._text = ""  # the verdict
        found: dict[tuple[str, str], list[Any]] = {}
        for chunk in _chunks(path):
            entity, batch = chunk.entity_path.strip("/"), chunk.to_record_batch()
            if entity.startswith(PLOT):  # the same in other units
                continue
            names = batch.schema.names
            if chunk.is_static:
                self._take_static(entity, {name: batch.column(name)[-1].as_py() for name in names})
                continue
            for component in ("Scalars:scalars", "StateChange:state"):
                if component in names and "sim_time" in names:
                    found.setdefault((entity, component), []).append(batch)
        for (entity, component), batches in found.items():
            (self.rows if component == "Scalars:scalars" else self.lanes)[entity] = _joined(batches, component)
        if "scenario" not in self._properties:
            raise EnvironmentProblem(f"{path} is no recording of a run: write one with `deltaph run SCENARIO --record {path}`")

    def _take_static(self, entity: str, components: dict[str, Any]) -> None:
        if entity.startswith("__properties/"):
            self._properties[entity.partition("/")[2]] = components
        elif entity == "summary":
            self._text = str(components["TextDocument:text"][0])  # what comes later replaces it
        elif components.get("SeriesLines:names"):
            unit = re.search(r"\[([^\[\]]*)\]$", components["SeriesLines:names"][0])  # joint[1].position has brackets too
            self.units[entity] = unit.group(1) if unit else ""

    @cached_property
    def title(self) -> str:
        """Of the scenario."""
        return str(self._properties["scenario"]["title"][0])

    @cached_property
    def scenario_json(self) -> str:
        """The scenario."""
        return str(self._properties["scenario"]["json"][0])

    @cached_property
    def headlines(self) -> list[str]:
        """The verdict in short; empty where the run ended without one."""
        return [line.removeprefix("# ") for line in self._text.splitlines() if line.startswith("# ")] if self.summary else []

    @cached_property
    def summary(self) -> dict[str, Any] | None:
        """The JSON report of the run; None where it ended without one."""
        found: dict[str, Any] | None = json.loads(self._properties["summary"]["json"][0]) if "summary" in self._properties else None
        return found


def _chunks(path: Path) -> Any:
    """The chunks of a recording.

    Raises:
        EnvironmentProblem: it is none of deltaph's.
    """
    refusal = f"{path} is no recording of deltaph: write one with `deltaph run SCENARIO --record FILE.rrd`"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a missing footer: what is there is read
        try:
            reader = RrdReader(path)
            if [entry.application_id for entry in reader.recordings()] != [APPLICATION_ID]:
                raise EnvironmentProblem(refusal)
            return list(reader.stream())
        except (RuntimeError, ValueError, OSError) as error:
            raise EnvironmentProblem(refusal) from error


def _joined(batches: list[Any], component: str) -> Rows:
    """One table of the chunks of an entity, which come in any order."""
    nanoseconds = np.concatenate([b.column("sim_time").to_numpy(zero_copy_only=False).astype(np.int64) for b in batches])
    step = np.concatenate([b.column("step").to_numpy(zero_copy_only=False).astype(np.int64) for b in batches])
    values = np.concatenate([np.asarray(b.column(component).flatten()).reshape(len(b), -1) for b in batches])
    order = np.argsort(nanoseconds, kind="stable")
    return Rows(nanoseconds[order], step[order], values[order])
