"""The Delta robot's parameters; their defaults are the start values of the FMUs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deltaph.errors import InfeasibleError, ScenarioError
from deltaph.kernel import enumeration, ffi, lib, sentence
from deltaph.variables import variable_table

ROBOT_PARAMETERS = tuple(v.name for v in variable_table("planner").of("parameter") if v.name.startswith("robot."))
"""Names of the robot's FMU parameters, the same in both FMUs."""


def raise_refusal(verdict: Any) -> None:
    """Turn a refusing verdict of the kernel into an error.

    Raises:
        InfeasibleError: with the facts of the verdict.
    """
    if verdict.status != lib.DPH_STATUS_OK:
        raise InfeasibleError(
            sentence(verdict),
            status=enumeration("dph_status")[verdict.status],
            required=verdict.required,
            available=verdict.available,
            phase=enumeration("dph_phase")[verdict.phase],
            joint=verdict.joint,
        )


@dataclass(frozen=True)
class Robot:
    """A Delta robot with three equal arms.

    Attributes:
        parameters: FMU parameter name -> value, SI; all of ROBOT_PARAMETERS.
    """

    parameters: dict[str, float]

    def __getstate__(self) -> dict[str, Any]:
        return {"parameters": self.parameters}  # the kernel's struct is memory of this process

    @classmethod
    def default(cls, **changes: float) -> Self:
        """The default robot with some parameters changed, named as in the FMUs without `robot.`."""
        table = variable_table("planner")
        parameters = {name: float(table[name].start or 0.0) for name in ROBOT_PARAMETERS}
        for name, value in changes.items():
            if f"robot.{name}" not in parameters:
                raise KeyError(f"a robot has no parameter {name!r}")
            parameters[f"robot.{name}"] = value
        return cls(parameters)

    def require_possible(self) -> None:
        """Refuse what no body and no mechanism can be.

        Raises:
            ScenarioError: an inertia is not positive definite, the arms cannot span base and platform, or the joint range is empty.
        """
        value = {name.removeprefix("robot."): parameter for name, parameter in self.parameters.items()}
        # parallel axes: the rest is the inertia about its centre. Products, since a power raises beyond 1e154 m.
        least = value["upper_arm_mass"] * value["upper_arm_com"] * value["upper_arm_com"]
        if value["upper_arm_inertia"] < least:
            raise ScenarioError(
                f"robot.upper_arm_inertia_kg_m2 is {value['upper_arm_inertia']:.6g}: an arm of {value['upper_arm_mass']:g} kg with "
                f"its centre {1e3 * value['upper_arm_com']:g} mm from the shoulder has at least {least:.6g} kg m2"
            )
        mass, length, inertia = value["forearm_mass"], value["forearm_length"], value["forearm_inertia"]
        most = mass * length * length / 4.0  # all mass at the ends
        if inertia > most:
            raise ScenarioError(
                f"robot.forearm_inertia_kg_m2 is {inertia:.6g}: rods of {mass:g} kg and {1e3 * length:g} mm have at most "
                f"{most:.6g} kg m2"
            )
        reach, span = value["upper_arm_length"] + value["forearm_length"], abs(value["base_radius"] - value["platform_radius"])
        if reach <= span:
            raise ScenarioError(
                f"the robot cannot close: upper arm and forearm are {1e3 * reach:g} mm long together, base and platform are "
                f"{1e3 * span:g} mm apart"
            )
        low, high = (float(np.degrees(value[f"joint_position_{end}"])) for end in ("min", "max"))
        if low >= high:
            raise ScenarioError(f"robot.joint_position_max_deg is {high:g}: the joint range begins at {low:g} deg")

    @cached_property
    def struct(self) -> Any:
        """The kernel's `dph_robot *`."""
        return ffi.new("dph_robot *", {name.removeprefix("robot."): value for name, value in self.parameters.items()})

    def inverse_kinematics(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint positions (3) [rad] for a tool centre point (3) [m].

        Raises:
            InfeasibleError: out of reach.
        """
        theta = np.empty(3)
        start = np.ascontiguousarray(point, dtype=np.float64)
        raise_refusal(
            lib.dph_inverse_kinematics(self.struct, ffi.from_buffer("double[3]", start), ffi.from_buffer("double[3]", theta))
        )
        return theta

    def elbows(self, joint_position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Elbow positions (n, 3 arms, 3) [m] for joint positions (n, 3) [rad]."""
        theta = np.ascontiguousarray(joint_position, dtype=np.float64)
        elbows = np.empty((len(theta), 3, 3))
        lib.dph_elbows(self.struct, len(theta), ffi.from_buffer("double[]", theta), ffi.from_buffer("double[]", elbows))
        return elbows
