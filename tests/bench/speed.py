"""Speed of the paper's case: planning, stepping, co-simulating.

    python tests/bench/speed.py

Medians on the machine at hand; the ratio compares two figures of the same run.
"""

import statistics
import time
from collections.abc import Callable
from pathlib import Path

from deltaph.execution import Trace
from deltaph.fmu import cached_fmus
from deltaph.importer import cosimulate, schedule
from deltaph.plan import Plan
from deltaph.scenario import load_scenario

ROUNDS = 200
CYCLES = 20
PAPER_US = 207.0
"""The paper's own time for one PPO at 1 kHz, positions only, on a 2.13 GHz processor."""


def median_us(work: Callable[[], object]) -> float:
    """Median duration [us]."""
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return 1e6 * statistics.median(times)


def main() -> None:
    """Print the figures."""
    scenario = load_scenario(Path(__file__).parents[2] / "scenarios" / "paper.toml")
    plan = Plan.of(scenario)
    grid = plan.grid()
    planning = median_us(lambda: Plan.of(scenario))
    both = median_us(lambda: Plan.of(scenario).sample(grid))
    print(f"{'plan one PPO':52s}{planning:8.1f} us")
    print(f"{f'plan and sample {len(grid)} setpoints, torques included':52s}{both:8.1f} us")
    print(f"{'the paper, positions only, over that':52s}{PAPER_US / both:8.1f} times")

    run = schedule(scenario, CYCLES)
    fmus = cached_fmus()
    list(cosimulate(scenario, schedule(scenario), fmus))  # warm-up
    trace = Trace(list(cosimulate(scenario, run, fmus)))
    for name in ("planner_step", "plant_step"):
        print(f"{name.replace('_', ' FMU, one ') + ' of 1 ms':52s}{1e6 * statistics.median(trace.timing_of(name)[1:]):8.1f} us")
    factor = trace.timing_of("real_time_factor")[-1]
    print(f"{f'co-simulation, {run.steps} steps, frames kept':52s}{factor:8.1f} times real time")


if __name__ == "__main__":
    main()
