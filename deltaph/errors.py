"""What can go wrong, as facts. Each error knows the exit code of the command line that ends with it."""

from __future__ import annotations

from typing import ClassVar


class DeltaphError(Exception):
    """Base class: one clear sentence, and the exit code it leads to."""

    exit_code: ClassVar[int] = 2


class ScenarioError(DeltaphError):
    """A scenario file cannot be read, or says something that is not a scenario."""


class EnvironmentProblem(DeltaphError):  # noqa: N818, EnvironmentError is a builtin
    """The machine lacks something: a compiler, a free endpoint, a writable file."""


class InfeasibleError(DeltaphError):
    """The task cannot be planned.

    Attributes:
        status: the kernel's reason, an item of PlanStatus.
        required: what the task needs, in the SI unit of the refused quantity.
        available: what there is, in the same unit.
        phase: where on the path, an item of Phase; `idle` where no phase is meant.
        joint: 1 to 3; 0 where none is meant.
    """

    exit_code = 3

    def __init__(
        self, sentence: str, *, status: str, required: float, available: float, phase: str = "idle", joint: int = 0
    ) -> None:
        super().__init__(sentence)
        self.status = status
        self.required = required
        self.available = available
        self.phase = phase
        self.joint = joint
