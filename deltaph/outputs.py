"""A plan as the planner FMU emits it, and tables of outputs as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO

import numpy as np
from numpy.typing import NDArray

from deltaph.frame import Frame, columns
from deltaph.plan import Plan
from deltaph.schedule import Schedule
from deltaph.variables import Model, variable_table

FloatArray = NDArray[np.float64]


def planner_columns(plan: Plan, time: FloatArray) -> dict[str, FloatArray]:
    """Every planner output of a first, accepted plan that starts at 0, by variable name, at times [s] (n,)."""
    table = variable_table("planner")
    setpoints = plan.sample(time)
    status = {
        "plan.status": table.items("PlanStatus").index("ok"),
        "plan.required": 0.0,
        "plan.available": 0.0,
        "plan.duration": plan.duration,
        "plan.corner_deviation_pick": plan.corner_deviation[0],
        "plan.corner_deviation_place": plan.corner_deviation[1],
        "plan.count": 1,
        "plan.busy": time < plan.duration,
        "plan.refused": 0,
        "plan.cancelled": 0,
    }
    found = {}
    for variable in table.of("output"):
        if variable.name in status:
            found[variable.name] = np.broadcast_to(np.asarray(status[variable.name], dtype=np.float64), time.shape)
            continue
        values = setpoints[variable.group.removeprefix("path_")]
        found[variable.name] = (values if variable.index is None else values[:, variable.index]).astype(np.float64)
    return found


def pass_columns(run: Schedule, time: FloatArray) -> dict[str, FloatArray]:
    """Every planner output of one pass of a schedule at full feed, by variable name, at times [s] (n,).

    What `plan.*` says is about the operation that runs, and `plan.count` its number.
    """
    ms = 1000.0 * time
    ms = np.where(np.abs(ms - np.rint(ms)) < 1e-6, np.rint(ms), ms)  # the planner counts whole milliseconds
    # one that begins in the millisecond in which its plan is ready is not yet there at the beginning of that
    begins = [np.nextafter(o.begin_ms, np.inf) if o.begin_ms == o.ready_ms else o.begin_ms for o in run.planned]
    number = np.searchsorted(begins, ms, side="right") - 1
    parts = [planner_columns(o.plan, (ms[number == k] - o.start_ms) / 1000.0) for k, o in enumerate(run.planned)]
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    # in steps longer than a way the robot may have arrived before the next way can be asked for
    asked = [-1, *(run.communication_step_ms * operation.request_step for operation in run.planned[1:])]
    busy = np.any([(ms > at) & (ms < o.end_ms) for at, o in zip(asked, run.planned, strict=True)], axis=0)
    return found | {"plan.count": number + 1.0, "plan.busy": busy.astype(np.float64)}


def _integers_last(model: Model) -> list[str]:
    """Output names as a frame holds them: Float64 first."""
    outputs = variable_table(model).of("output")
    return [v.name for v in outputs if v.is_float] + [v.name for v in outputs if not v.is_float]


def frame_columns(frames: Sequence[Frame]) -> dict[str, FloatArray]:
    """Time, planner outputs under their names and plant outputs behind `plant.`, from frames."""
    found = {"time": columns(frames, "time")}
    prefixes: dict[Model, str] = {"planner": "", "plant": "plant."}
    for model, prefix in prefixes.items():
        rows = np.hstack((columns(frames, f"{model}_floats"), columns(frames, f"{model}_integers")))
        by_name = dict(zip(_integers_last(model), rows.T, strict=True))
        found |= {prefix + v.name: by_name[v.name] for v in variable_table(model).of("output")}
    return found


def write_csv(stream: IO[str], table: dict[str, FloatArray]) -> None:
    """Write columns with a header; numbers with as many digits as give the same double back."""
    stream.write(",".join(table) + "\n")
    for row in np.column_stack(list(table.values())).tolist():
        stream.write(",".join(f"{value:.17g}" for value in row) + "\n")
