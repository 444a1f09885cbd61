"""Rows of the golden files: every number with its tolerance and where it comes from."""

import csv
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from .delta import Robot, inverse
from .delta_dynamics import joint_torque
from .paper_law import paper_plan
from .peaks import KINDS, peaks
from .ppo import GRID, Plan
from .precision import Number, mp
from .superposition import superposition_plan

FOLDER = Path(__file__).parents[1] / "golden"
HEADER = ("case", "quantity", "value", "tolerance", "absolute", "provenance")
# About 5000 roundings in double. Rounding the inputs to double moves no value by more than 0.2 % of it.
TOLERANCE = "1e-12"
DIGITS = 30


@dataclass(frozen=True)
class Row:
    """One golden number: x passes when |x - value| <= absolute + tolerance * |value|."""

    case: str
    quantity: str
    value: Number
    provenance: str
    tolerance: str = TOLERANCE
    absolute: str = "0"

    def fields(self) -> tuple[str, ...]:
        """The row's text, in the order of `HEADER`; noise of the working precision is written as 0."""
        value = mp.mpf(self.value)
        text = "0" if abs(value) < mp.mpf("1e-38") else mp.nstr(value, DIGITS, strip_zeros=False)
        return self.case, self.quantity, text, self.tolerance, self.absolute, self.provenance


def write(path: Path, rows: list[Row]) -> None:
    """Write a golden file."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(row.fields() for row in rows)


def load(name: str) -> dict[str, Any]:
    """A TOML file of the golden folder, its decimals taken exactly (to the working precision)."""
    return tomllib.loads((FOLDER / name).read_text(), parse_float=mp.mpf)


def robot(cases: Mapping[str, Any]) -> Robot:
    """The robot of a cases file."""
    return Robot(**cases["robot"])


def plan(case: Mapping[str, Any]) -> Plan:
    """The plan of one case."""
    pick, place = tuple(case["pick"]), tuple(case["place"])
    lifts = (case["lift_pick"], case["lift_place"])
    v_b, v_max = case["corner_entry_speed"], case["traverse_speed"]
    if case["law"] == "comparison":
        return superposition_plan(pick, place, lifts, v_b, v_max, case["overlap"])
    deviations = (case["corner_deviation_pick"], case["corner_deviation_place"])
    return paper_plan(pick, place, lifts, deviations, v_b, case["corner_mid_speed"], v_max)


def plan_rows(name: str, case: Mapping[str, Any], machine: Robot) -> Iterator[Row]:
    """All rows of one case."""
    ppo = plan(case)
    paper = case["law"] == "paper"
    law = "paper 3.2" if paper else "eq. 31"
    for quantity, value in ppo.lengths.items():
        yield Row(name, quantity, value, "paper 3.1; root finding on the deviation and quadrature")
    route = f"{law}; definition by root finding or quadrature; nominal clock"
    for phase, value in ppo.durations.items():
        yield Row(name, f"duration.{phase}", value, route)
    yield Row(name, "nominal_duration", ppo.nominal_duration, f"{law}; sum of phases")
    yield Row(name, "aligned_duration", ppo.aligned_duration, "nominal duration rounded up to 1 ms")
    yield Row(name, "path_length", ppo.path_length, "quadrature of the speed or of |P'|")
    for side, value in zip(("pick", "place"), ppo.corner_deviations, strict=True):
        yield Row(name, f"corner_deviation_{side}", value, "min |P - H|; root of its derivative")
    route = "supremum over time; scan and refined stationary point; aligned clock"
    for kind, count in KINDS.items():
        for i, value in enumerate(peaks(machine, case["payload"], ppo, kind), start=1):
            quantity = f"peak.{kind}" + (f".{i}" if count == 3 else "")
            yield Row(name, quantity, value, route)
    yield from sample_rows(name, ppo, machine, case["payload"])


def sample_times(ppo: Plan) -> list[str]:
    """Aligned times [s], short decimals inside every phase: two in most, one in the outer ones."""
    times = []
    last = len(ppo.phases) - 1
    for index, (a, b) in enumerate(pairwise(ppo.starts)):
        outer = index in (0, last) or (last == 5 and index in (2, 3))
        # At most 20 ms in: a slow corner spends nearly all its time at the middle.
        parts = ("0.45",) if outer else ("0.31", "0.68")
        instants = [(b - a) * mp.mpf(part) for part in parts]
        if not outer:
            instants[0] = min(instants[0], 20 * GRID)
        for instant in instants:
            time = (a + instant) / ppo.speed_factor
            times.append(mp.nstr(mp.nint(time * 10**4) / 10**4, 8))
    return [*times, mp.nstr(mp.nint((ppo.aligned_duration - mp.mpf("0.0024")) * 10**4) / 10**4, 8)]


def sample(ppo: Plan, machine: Robot, payload: Number, time: Number) -> dict[str, dict[str, Number]]:
    """The motion at one aligned time: values by kind and component."""
    index, parameter = ppo.locate(time)
    motion = tuple(s.at_rate(ppo.speed_factor) for s in ppo.phases[index].position(parameter, 3))
    angles = inverse(machine, (motion[0], motion[1], motion[2]))
    kinds: dict[str, dict[str, Number]] = {}
    for order, kind in enumerate(("position", "velocity", "acceleration", "jerk")):
        kinds[kind] = {axis: s.derivative(order) for axis, s in zip("xyz", motion, strict=True)}
    kinds["arc_length"] = {"": ppo.arc_length(index, parameter)}
    for order, kind in enumerate(("joint_position", "joint_velocity", "joint_acceleration")):
        kinds[kind] = _by_joint([angle.derivative(order) for angle in angles])
    kinds["joint_torque"] = _by_joint(joint_torque(machine, payload, (motion[0], motion[1], motion[2])))
    return kinds


def _by_joint(values: Sequence[Number]) -> dict[str, Number]:
    return {str(i): value for i, value in enumerate(values, start=1)}


_ROUTE = {
    "position": "path at the parameter found by root finding on time",
    "velocity": "Taylor arithmetic on the position",
    "acceleration": "Taylor arithmetic on the position",
    "jerk": "Taylor arithmetic on the position",
    "arc_length": "quadrature of |P'|",
    "joint_position": "root of the loop closure",
    "joint_velocity": "Taylor arithmetic on the loop closure",
    "joint_acceleration": "Taylor arithmetic on the loop closure",
    "joint_torque": "virtual work of point masses",
}


def sample_rows(name: str, ppo: Plan, machine: Robot, payload: Number) -> Iterator[Row]:
    """Samples of one case; the absolute tolerance is 1e-12 of the kind's largest value among them."""
    samples = {time: sample(ppo, machine, payload, mp.mpf(time)) for time in sample_times(ppo)}
    for kind, route in _ROUTE.items():
        largest = max(abs(value) for kinds in samples.values() for value in kinds[kind].values())
        absolute = mp.nstr(largest * mp.mpf(TOLERANCE), 2)
        for time, kinds in samples.items():
            for part, value in kinds[kind].items():
                quantity = f"sample.{time}.{kind}" + (f".{part}" if part else "")
                yield Row(name, quantity, value, f"{route}; aligned clock", absolute=absolute)
