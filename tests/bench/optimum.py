"""How far the time-optimal law is from the optimum: random tasks against the same solver, converged on 400 intervals.

    python tests/bench/optimum.py [TASKS]

Compiles a copy of the kernel with more intervals and a finer tolerance; needs a C compiler.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cffi
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from property.random_tasks import PAPERS_PEAKS, TIME_OPTIMAL, random_tasks

from deltaph import kernel
from deltaph.fmu.compile import FLAGS, compiler
from deltaph.plan import Plan
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
        ("keep(w, best.stretch * unseen, plan)", "keep(w, 1.0, plan)"),
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


def main() -> None:
    """Print durations over the optimum, peaks over limits, times."""
    robot, count = Robot.default(), int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    excess, used, times = [], [], []
    with tempfile.TemporaryDirectory(prefix="deltaph-") as folder:
        ffi, lib = converged_kernel(Path(folder))
        for task in random_tasks(count):
            begin = time.perf_counter()
            plan = Plan(robot, task, TIME_OPTIMAL, 0.0, PAPERS_PEAKS)
            times.append(1e6 * (time.perf_counter() - begin))
            excess.append(100.0 * (plan.nominal_duration / optimum(ffi, lib, robot, task, PAPERS_PEAKS) - 1.0))
            orders = enumerate(("joint_velocity", "joint_acceleration", "joint_jerk"), 1)
            used.append(max(max(getattr(plan.peaks, w)) / getattr(PAPERS_PEAKS, w)[0] / plan.speed_factor**k for k, w in orders))
    for name, values in (("duration over the optimum (%)", excess), ("greatest peak / limit", used), ("time to plan (us)", times)):
        print(f"{name:30s} median {np.median(values):.5g}  95 % {np.percentile(values, 95):.5g}  worst {max(values):.6g}")


if __name__ == "__main__":
    main()
