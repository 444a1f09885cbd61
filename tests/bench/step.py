"""What one doStep of the planner FMU takes while requests are planned, next to one that only plays.

    python tests/bench/step.py [DeltaPlanner.fmu]

The robot goes there and back; each way is asked for while the one before runs. The same run is repeated, and of each step the
fastest repetition counts: what a step does is the same each time, what else the machine does is not.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave
from numpy.typing import NDArray

from deltaph.fmu import cached_fmus
from deltaph.importer import planner_values, task_inputs
from deltaph.plan import Plan
from deltaph.scenario import Scenario, load_scenario
from deltaph.variables import variable_table

SCENARIOS = Path(__file__).parents[2] / "scenarios"
TABLE = variable_table("planner")
LAWS = ("paper", "time_optimal", "paper_limited")
WAYS, REPETITIONS = 20, 25
ASKED_AT = 20
"""Steps after its forerunner has begun at which the next way is asked for."""
STEP = 1e-3
WIDTHS = (12, 8, 8, 12, 8, 8, 14)


class Planner:
    """The FMU, and what of it is set and read here."""

    def __init__(self, fmu: Path, folder: str) -> None:
        description = read_model_description(str(fmu))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.slave = FMU3Slave(
            guid=description.guid,
            unzipDirectory=extract(str(fmu), folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="step",
        )
        self.slave.instantiate()

    def put(self, values: dict[str, float]) -> None:
        for name, value in values.items():
            kind = TABLE[name].type
            setter = {"Float64": self.slave.setFloat64, "Int32": self.slave.setInt32}.get(kind, self.slave.setInt64)
            setter([self.references[name]], [value if kind == "Float64" else int(value)])

    def get(self, name: str) -> int:
        getter = self.slave.getInt32 if TABLE[name].type == "Int32" else self.slave.getInt64
        return int(getter([self.references[name]])[0])


def run(planner: Planner, scenario: Scenario, duration_ms: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Times of the steps [us], and in which of them something was planned."""
    planner.slave.reset()
    planner.put(planner_values(scenario))
    planner.slave.enterInitializationMode(startTime=0.0)
    planner.slave.exitInitializationMode()
    tasks, step = (scenario.task, scenario.task.reversed()), planner.slave.doStep
    steps, asked = WAYS * duration_ms, 1
    times, planned = np.zeros(steps), np.zeros(steps, dtype=np.bool_)
    for n in range(steps):
        if n % duration_ms == ASKED_AT:
            planner.put({**task_inputs(tasks[asked % 2]), "task.trigger": asked + 1})
            asked += 1
        planned[n] = planner.get("plan.count") < asked
        begin = time.perf_counter()
        step(n * STEP, STEP)
        times[n] = 1e6 * (time.perf_counter() - begin)
    assert planner.get("plan.count") == asked
    return times, planned


def main() -> None:
    """Measure and print."""
    fmu = Path(sys.argv[1]) if len(sys.argv) > 1 else cached_fmus()["planner"]
    heads = ("plays: p50", "p99.9", "max", "plans: p50", "p99.9", "max", "steps a plan")
    print(f"{'doStep (us)':16s}" + "".join(f"{head:>{width}s}" for head, width in zip(heads, WIDTHS, strict=True)))
    with tempfile.TemporaryDirectory(prefix="deltaph-") as folder:
        planner = Planner(fmu, folder)
        for name in LAWS:
            scenario = load_scenario(SCENARIOS / f"{name}.toml")
            duration_ms = Plan.of(scenario).duration_ms
            runs = [run(planner, scenario, duration_ms) for _ in range(REPETITIONS)]
            times, planned = np.min([times for times, _ in runs], axis=0), runs[0][1]
            figures = [np.percentile(some, p) for some in (times[~planned], times[planned]) for p in (50.0, 99.9, 100.0)]
            figures.append(planned.sum() / WAYS)
            print(f"{name:16s}" + "".join(f"{figure:{width}.1f}" for figure, width in zip(figures, WIDTHS, strict=True)))


if __name__ == "__main__":
    main()
