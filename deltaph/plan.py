"""Plans: the kernel's, immutable, with what people ask of them."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltaph.errors import InfeasibleError
from deltaph.kernel import enumeration, ffi, lib
from deltaph.robot import Robot, raise_refusal
from deltaph.scenario import Law, Limits, Scenario, Task

FloatArray = NDArray[np.float64]


def _setpoint_dtype() -> np.dtype[np.void]:
    """The layout of the kernel's `dph_setpoint`."""
    fields: dict[str, tuple[Any, int]] = {}
    for name, field in ffi.typeof("dph_setpoint").fields:
        shape = (field.type.length,) if field.type.kind == "array" else ()
        fields[name] = (np.dtype((np.int32 if field.type.kind == "enum" else np.float64, shape)), field.offset)
    return np.dtype(
        {
            "names": list(fields),
            "formats": [dtype for dtype, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": ffi.sizeof("dph_setpoint"),
        }
    )


SETPOINT = _setpoint_dtype()
"""Structured dtype of the setpoints: joint_position (3) [rad], ... as `dph_setpoint` in the kernel's header."""


_GIVEN_SPEEDS = ("paper", "comparison")
"""Laws whose speeds are given; the others find theirs within the limits."""


@dataclass(frozen=True, slots=True)
class Phase:
    """One phase of a plan, on the aligned clock.

    Attributes:
        start: [s].
        duration: [s].
        length: arc length; for an overlapping stroke its own [m].
    """

    name: str
    start: float
    duration: float
    length: float


@dataclass(frozen=True, slots=True)
class Peaks:
    """Greatest absolute values over continuous time, on the aligned clock, SI."""

    joint_velocity: tuple[float, ...]
    joint_acceleration: tuple[float, ...]
    joint_jerk: tuple[float, ...]
    joint_torque: tuple[float, ...]
    tcp_speed: float
    tcp_acceleration: float


@dataclass(frozen=True, slots=True)
class Violation:
    """A peak beyond its limit.

    Attributes:
        quantity: such as `joint 1 velocity`.
        peak: [unit].
        limit: [unit].
        unit: of both.
    """

    quantity: str
    peak: float
    limit: float
    unit: str


def time_grid(duration_ms: int, step_ms: float) -> FloatArray:
    """Times from 0 to the end [s], `step_ms` apart; the end is always one of them."""
    count = math.ceil(duration_ms / step_ms - 1e-9)
    return np.append(np.arange(count) * step_ms, duration_ms) / 1000.0


_local = threading.local()


def _workspace() -> Any:
    """This thread's memory for the kernel to plan in."""
    if not hasattr(_local, "memory"):
        _local.memory = ffi.new("double[]", -(-lib.dph_workspace_size() // 8))
    return ffi.cast("dph_workspace *", _local.memory)


class Plan:
    """A planned pick-and-place operation on the aligned clock.

    Args:
        robot: the robot.
        task: what to do.
        law: how to move.
        payload: mass [kg].
        limits: what `paper_limited` and `time_optimal` keep; the other laws have speeds instead.

    Attributes:
        slices: of DPH_SLICE units that planning took: as many milliseconds as the planner FMU takes.

    Raises:
        InfeasibleError: the kernel refuses the task.
    """

    def __init__(self, robot: Robot, task: Task, law: Law, payload: float = 0.0, limits: Limits | None = None) -> None:
        limits = limits or Limits.of_drives()
        request = ffi.new(
            "dph_task *",
            {
                "pick": task.pick,
                "place": task.place,
                "lift": task.lift,
                "corner_deviation": task.corner_deviation,
                "dwell": task.dwell,
                "payload": payload,
                "law": enumeration("dph_law").index(law.name),
                "corner_entry_speed": law.corner_entry_speed,
                "corner_mid_speed": law.corner_mid_speed,
                "traverse_speed": law.traverse_speed,
                "overlap": law.overlap,
                "limits": {field: getattr(limits, field) for field in Limits.__dataclass_fields__},
            },
        )
        self._struct = ffi.new("dph_plan *")
        self.slices = 0
        workspace = _workspace()
        verdict = lib.dph_plan_begin(robot.struct, request, workspace, self._struct)
        while verdict.status == lib.DPH_STATUS_PLANNING:
            verdict = lib.dph_plan_continue(workspace, self._struct, lib.DPH_SLICE)
            self.slices += 1
        raise_refusal(verdict)
        self.robot = robot
        self.task = task
        self.law = law
        self.payload = payload

    @classmethod
    def of(cls, scenario: Scenario) -> Plan:
        """The plan of a scenario."""
        return cls(scenario.robot, scenario.task, scenario.law, scenario.declared_payload, scenario.limits)

    @property
    def duration(self) -> float:
        """Aligned duration [s]."""
        return float(self._struct.duration)

    @property
    def duration_ms(self) -> int:
        """Aligned duration [ms]."""
        return int(self._struct.duration_ms)

    @property
    def dwell_ms(self) -> int:
        """Rest before the motion, which begins at time 0 [ms]."""
        return int(self._struct.dwell_ms)

    @property
    def nominal_duration(self) -> float:
        """Duration before alignment [s]."""
        return float(self._struct.nominal_duration)

    @property
    def speed_factor(self) -> float:
        """Nominal over aligned duration, at most 1."""
        return float(self._struct.speed_factor)

    @property
    def length(self) -> float:
        """Arc length of the path [m]."""
        return float(self._struct.length)

    @property
    def corner_deviation(self) -> tuple[float, float]:
        """Distance of each corner's vertex from the path, pick side first [m]."""
        return tuple(self._struct.corner_deviation)

    @property
    def corner_bound(self) -> tuple[str, str]:
        """What made a corner deviation smaller than prescribed, pick side first; empty where nothing did."""
        found = []
        for bound, lift in zip(self._struct.corner_bound, self.task.lift, strict=True):
            reasons = [f"lift height {1e3 * lift:g} mm"] * (bound & 1) + [f"traverse {1e3 * self._struct.traverse:g} mm"] * (
                bound >> 1
            )
            nothing = "lift" if lift == 0.0 else "traverse" if self._struct.middle[1] else ""
            found.append(f"no {nothing}, no corner" if nothing else ", ".join(reasons))
        return found[0], found[1]

    @property
    def corner_legs(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Vertical and horizontal leg of each corner, pick side first [m]; not of the comparison law."""
        pick, place = (side.corner.corner for side in self._struct.side)
        return (pick.leg, pick.second_leg), (place.leg, place.second_leg)

    @property
    def vertices(self) -> FloatArray:
        """Vertices of the right angles, pick side first (2, 3) [m]."""
        points = np.array([self.task.pick, self.task.place])
        points[:, 2] += self.task.lift
        return points

    @property
    def direction(self) -> tuple[float, float]:
        """Horizontal unit vector from pick to place; x where one is above the other."""
        return tuple(self._struct.direction)

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases; those of the comparison law overlap (paper eq. (31))."""
        plan = self._struct
        times = np.array(list(plan.boundary)[: plan.pieces + 1]) / self.speed_factor
        if self.law.name == "comparison":
            strokes = (("lift", 0, 2, self.task.lift[0]), ("traverse", 1, 4, plan.traverse), ("lower", 3, 5, self.task.lift[1]))
            return tuple(Phase(n, float(times[a]), float(times[b] - times[a]), length) for n, a, b, length in strokes)
        names = enumeration("dph_phase")
        pieces = [i for i in range(plan.pieces) if times[i + 1] > times[i]]  # a path need not have every phase
        begins = [i for k, i in enumerate(pieces) if k == 0 or plan.phase[i] != plan.phase[pieces[k - 1]]]
        return tuple(
            Phase(
                names[plan.phase[i]],
                float(times[i]),
                float(times[end] - times[i]),
                plan.arc_boundary[end] - plan.arc_boundary[i],
            )
            for i, end in zip(begins, [*begins[1:], plan.pieces], strict=True)
        )

    @property
    def speeds(self) -> tuple[float, float, float]:
        """Of the paper's law: V_B, V_N, V_max on the nominal clock, given or found [m/s]."""
        task = self._struct.task
        return task.corner_entry_speed, task.corner_mid_speed, task.traverse_speed

    @cached_property
    def peaks(self) -> Peaks:
        """Peaks over continuous time."""
        peaks = ffi.new("dph_peaks *")
        lib.dph_plan_peaks(self._struct, peaks)
        joints = {
            name: tuple(getattr(peaks, name)) for name in ("joint_velocity", "joint_acceleration", "joint_jerk", "joint_torque")
        }
        return Peaks(**joints, tcp_speed=peaks.tcp_speed, tcp_acceleration=peaks.tcp_acceleration)

    def sample(self, time: FloatArray) -> NDArray[np.void]:
        """Setpoints (n) of dtype SETPOINT at times (n) on the aligned clock [s]."""
        time = np.ascontiguousarray(time, dtype=np.float64)
        setpoints = np.empty(time.shape, dtype=SETPOINT)
        lib.dph_plan_sample_array(
            self._struct, len(time), ffi.from_buffer("double[]", time), ffi.cast("dph_setpoint *", ffi.from_buffer(setpoints))
        )
        return setpoints

    def joints(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Joint position, velocity, acceleration, (n, 3) [rad, rad/s, rad/s^2] at times (n) on the aligned clock [s]."""
        time = np.ascontiguousarray(time, dtype=np.float64)
        joints = np.empty((3, *time.shape, 3))
        lib.dph_plan_sample_joints(
            self._struct, len(time), ffi.from_buffer("double[]", time), *(ffi.from_buffer("double[]", part) for part in joints)
        )
        return joints[0], joints[1], joints[2]

    def grid(self, step_ms: float = 1.0) -> FloatArray:
        """Times from 0 to the end [s], `step_ms` apart; the end is always one of them."""
        return time_grid(self.duration_ms, step_ms)

    def violations(self, limits: Limits) -> list[Violation]:
        """The peaks beyond their limits."""
        found = []
        for quantity, unit in (("velocity", "rad/s"), ("acceleration", "rad/s2"), ("jerk", "rad/s3"), ("torque", "N.m")):
            pairs = zip(getattr(self.peaks, f"joint_{quantity}"), getattr(limits, f"joint_{quantity}"), strict=True)
            found += [
                Violation(f"joint {i} {quantity}", peak, limit, unit)
                for i, (peak, limit) in enumerate(pairs, 1)
                if not peak <= limit
            ]
        if not self.peaks.tcp_speed <= limits.tcp_speed:
            found.append(Violation("tcp speed", self.peaks.tcp_speed, limits.tcp_speed, "m/s"))
        return found

    def require_within(self, limits: Limits) -> None:
        """Refuse a plan whose peaks go beyond the limits.

        Raises:
            InfeasibleError: names the first peak beyond its limit.
        """
        for v in self.violations(limits):
            # a law within limits proves them between its knots at points: one task in some thousand is a per mille beyond
            share = f"{100.0 * (v.peak / v.limit - 1.0):.2g} %"
            way = (
                "lower the law's speeds" if self.law.name in _GIVEN_SPEEDS else f"the law misses it by {share}, lower it by as much"
            )
            sentence = f"{v.quantity} reaches {v.peak:.5g} {v.unit}, beyond the limit of {v.limit:.5g} {v.unit}: {way}"
            raise InfeasibleError(sentence, status="limit_exceeded", required=v.peak, available=v.limit)
