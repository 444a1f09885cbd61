"""How far the time-optimal law is from the optimum, with and without a jerk limit: random tasks against a converged solution.

    python tests/bench/optimum.py [TASKS]

Compiles a copy of the kernel, whose interior-point solver has 400 intervals and a finer tolerance; needs a C compiler.
"""

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cffi
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from property.random_tasks import PAPERS_PEAKS, TIME_OPTIMAL, random_tasks

from deltaph import kernel
from deltaph.errors import InfeasibleError
from deltaph.fmu.compile import FLAGS, compiler
from deltaph.kernel import ffi, lib
from deltaph.plan import Plan, _workspace
from deltaph.robot import Robot
from deltaph.scenario import Limits, Task
from deltaph.sources import FMU_SRC

PIECES = ("DPH_PIECES = 64", "DPH_PIECES = 600")
CONVERGED = {
    "kernel.h": [PIECES],
    "path_profile.c": [("INTERVALS = 48", "INTERVALS = 400")],
    "time_optimal.c": [
        ("tolerance = 3e-3", "tolerance = 1e-5"),
        ("FIRST_ITERATIONS = 25, REPAIRS = 2", "FIRST_ITERATIONS = 60, REPAIRS = 0"),
        ("keep(w, w->best.stretch * unseen, 0, plan)", "keep(w, unseen, 0, plan)"),
        ("unseen = 1.0001", "unseen = 1.0"),
        ("has_torque ? LAY : REACH", "has_torque ? LAY : LAY"),
    ],
}


def converged_kernel(folder: Path) -> tuple[Any, Any]:
    """The kernel with the changes of CONVERGED, as a library."""
    for file in (FMU_SRC / "kernel").iterdir():
        text = file.read_text(encoding="utf-8")
        for old, new in CONVERGED.get(file.name, []):
            assert old in text, old
            text = text.replace(old, new)
        (folder / file.name).write_text(text, encoding="utf-8")
    library, sources = folder / "converged.so", map(str, sorted(folder.glob("*.c")))
    subprocess.run([*compiler(), *FLAGS, "-fvisibility=default", *sources, "-o", str(library), "-lm"], check=True)
    ffi = cffi.FFI()
    ffi.cdef(kernel._declarations().replace(*PIECES))
    return ffi, ffi.dlopen(str(library))


def optimum(ffi: Any, lib: Any, robot: Robot, task: Task, limits: Limits) -> float:
    """Duration of the converged solution [s]."""
    parameters = {name.removeprefix("robot."): value for name, value in robot.parameters.items()}
    fields = {field: getattr(task, field) for field in ("pick", "place", "lift", "corner_deviation")}
    law = {"corner_entry_speed": 1.2, "corner_mid_speed": 0.8, "traverse_speed": 2.4, "overlap": 0.5, "payload": 0.0}
    bounds = {field: getattr(limits, field) for field in Limits.__dataclass_fields__}
    request = ffi.new("dph_task *", {**fields, **law, "law": lib.DPH_LAW_TIME_OPTIMAL, "limits": bounds})
    plan, memory = ffi.new("dph_plan *"), ffi.new("double[]", lib.dph_workspace_size() // 8 + 1)
    verdict = lib.dph_plan_make(ffi.new("dph_robot *", parameters), request, ffi.cast("dph_workspace *", memory), plan)
    assert verdict.status == lib.DPH_STATUS_OK
    return float(plan.nominal_duration)


def planned_in(plan: Plan) -> float:
    """Time the kernel takes to plan a plan again [us]: path, solution, verification, alignment."""
    task, again, memory = ffi.new("dph_task *", plan._struct.task), ffi.new("dph_plan *"), _workspace()
    begin = time.perf_counter()
    verdict = lib.dph_plan_make(plan.robot.struct, task, memory, again)
    taken = time.perf_counter() - begin
    assert verdict.status == lib.DPH_STATUS_OK
    return 1e6 * taken


def measure(count: int, limits: Limits, best: Callable[[Task], float]) -> None:
    """Print durations over the optimum, peaks over limits, times, and what was not solved."""
    robot, excess, used, times, refused = Robot.default(), [], [], [], []
    names = [name for name in ("joint_velocity", "joint_acceleration", "joint_jerk") if math.isfinite(getattr(limits, name)[0])]
    for number, task in enumerate(random_tasks(count)):
        try:
            plan = Plan(robot, task, TIME_OPTIMAL, 0.0, limits)
        except InfeasibleError as refusal:
            refused.append(f"task {number}: {refusal}")
            continue
        times.append(planned_in(plan))
        excess.append(100.0 * (plan.nominal_duration / best(task) - 1.0))
        used.append(max(max(getattr(plan.peaks, n)) / getattr(limits, n)[0] / plan.speed_factor**k for k, n in enumerate(names, 1)))
    print(f"limits of {', '.join(names)}: {len(times)} of {count} solved")
    print(*refused, sep="\n", end="\n" if refused else "")
    for name, values in (("duration over the optimum (%)", excess), ("greatest peak / limit", used), ("time to plan (us)", times)):
        quantiles = (f"{q} % {np.percentile(values, q):.5g}" for q in (95, 99))
        print(f"  {name:30s} median {np.median(values):.5g}  {'  '.join(quantiles)}  worst {max(values):.6g}")


def main() -> None:
    """With and without a jerk limit."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    with tempfile.TemporaryDirectory(prefix="deltaph-") as folder:
        converged = converged_kernel(Path(folder))
        for limits in (PAPERS_PEAKS, replace(PAPERS_PEAKS, joint_jerk=(math.inf,) * 3)):
            measure(count, limits, lambda task, limits=limits: optimum(*converged, Robot.default(), task, limits))


if __name__ == "__main__":
    main()
