"""The Delta robot's parameters; their defaults are the start values of the FMUs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deltaph.errors import InfeasibleError
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
        )


@dataclass(frozen=True)
class Robot:
    """A Delta robot with three equal arms.

    Attributes:
        parameters: FMU parameter name -> value, SI; all of ROBOT_PARAMETERS.
    """

    parameters: dict[str, float]

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
