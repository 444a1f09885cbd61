"""One FMI 3.0 co-simulation slave behind fmpy's low-level API: buffers allocated once, values read and written as arrays."""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from numpy.typing import NDArray

from deltaph.errors import DeltaphError
from deltaph.variables import Model, Variable, variable_table

_MESSAGES = 100  # a cell may run for months, and plan ten times a second

_C_TYPES: dict[str, Any] = {"Float64": ctypes.c_double, "Int32": ctypes.c_int32, "Boolean": ctypes.c_bool, "Int64": ctypes.c_int64}


def _fmi_type(variable: Variable) -> str:
    """The FMI 3 type whose functions access it; enumerations are 64-bit integers there (FMI 3.0, 2.2.5)."""
    return variable.type if variable.type in _C_TYPES else "Int64"


class _Block:
    """Value references of one type with a buffer, and the call that moves them."""

    def __init__(self, call: Any, component: Any, variables: tuple[Variable, ...], fmi_type: str) -> None:
        n = len(variables)
        references = (ctypes.c_uint32 * n)(*(v.value_reference for v in variables))
        buffer = (_C_TYPES[fmi_type] * n)()
        self._call = call
        self._arguments = (component, references, n, buffer, n)
        self.values = np.frombuffer(buffer, dtype=np.dtype(_C_TYPES[fmi_type]))

    def move(self) -> None:
        self._call(*self._arguments)


class Slave:
    """A slave from instantiation to its end; a context manager.

    Attributes:
        messages: what the FMU logged last.
        outputs: Float64 outputs in table order, after `read` (n,).
        integers: all other outputs in table order, after `read` (m,).
        inputs: Float64 inputs in table order, sent by `write` (k,).
    """

    def __init__(self, model: Model, fmu: Path, directory: Path) -> None:
        """Instantiate.

        Args:
            model: which FMU it is.
            fmu: the FMU.
            directory: where to unzip it; must outlive the slave.
        """
        self.table = variable_table(model)
        self.messages: deque[str] = deque(maxlen=_MESSAGES)
        unzipped = str(fmpy.extract(str(fmu), str(directory / model)))
        description = fmpy.read_model_description(unzipped)
        self._fmu: Any = FMU3Slave(
            guid=description.guid,
            unzipDirectory=unzipped,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=model,
        )
        self._fmu.instantiate(loggingOn=True, logMessage=self._log)
        self._component = self._fmu.component

        outputs = self.table.of("output")
        floats = tuple(v for v in outputs if v.is_float)
        others = tuple(v for v in outputs if not v.is_float)
        self._floats = self._block("Get", floats, "Float64")
        self._others = []
        for fmi_type in sorted({_fmi_type(v) for v in others}):
            of_type = tuple(v for v in others if _fmi_type(v) == fmi_type)
            self._others.append((self._block("Get", of_type, fmi_type), [others.index(v) for v in of_type]))
        inputs = tuple(v for v in self.table.of("input") if v.is_float)
        self._inputs = self._block("Set", inputs, "Float64")
        self._input_columns = {v.name: column for column, v in enumerate(inputs)}
        self.outputs: NDArray[np.float64] = self._floats.values
        self.integers = np.zeros(len(others), dtype=np.int32)
        self.inputs: NDArray[np.float64] = self._inputs.values
        self.inputs[:] = [v.start or 0.0 for v in inputs]
        self._single: dict[str, _Block] = {}

        flags = [ctypes.c_bool() for _ in range(3)]
        self._after_step = (*(ctypes.byref(flag) for flag in flags), ctypes.byref(ctypes.c_double()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self._fmu.terminate()
        self._fmu.freeInstance()

    def _log(self, _environment: Any, _status: int, _category: bytes, message: bytes) -> None:
        self.messages.append(message.decode())

    def _block(self, action: str, variables: tuple[Variable, ...], fmi_type: str) -> _Block:
        return _Block(getattr(self._fmu, f"fmi3{action}{fmi_type}"), self._component, variables, fmi_type)

    def set(self, values: Mapping[str, float]) -> None:
        """Set parameters or inputs by name.

        Raises:
            DeltaphError: the FMU refuses one; says what the FMU says.
        """
        for name, value in values.items():
            block = self._single.get(name)
            if block is None:
                variable = self.table[name]
                block = self._single[name] = self._block("Set", (variable,), _fmi_type(variable))
            block.values[0] = value
            try:
                block.move()
            except FMICallException as error:
                raise DeltaphError(f"{self.table.model} refuses {name} = {value:g}: {self._last_message()}") from error
            if name in self._input_columns:
                self.inputs[self._input_columns[name]] = value

    def initialize(self, start_time: float) -> None:
        """Enter initialization mode."""
        self._fmu.enterInitializationMode(startTime=start_time)

    def start(self) -> None:
        """Leave initialization mode: outputs are the initial state.

        Raises:
            DeltaphError: the FMU cannot be initialized with its parameters; says what the FMU says.
        """
        try:
            self._fmu.exitInitializationMode()
        except FMICallException as error:
            raise DeltaphError(f"{self.table.model} cannot start: {self._last_message()}") from error

    def read(self) -> None:
        """Read all outputs into `outputs` and `integers`."""
        self._floats.move()
        for block, where in self._others:
            block.move()
            self.integers[where] = block.values

    def write(self) -> None:
        """Send `inputs`."""
        self._inputs.move()

    def step(self, time: float, size: float) -> None:
        """One communication step [s]."""
        try:
            self._fmu.fmi3DoStep(self._component, time, size, True, *self._after_step)
        except FMICallException as error:
            raise DeltaphError(f"{self.table.model} cannot step at {time:g} s: {self._last_message()}") from error

    def _last_message(self) -> str:
        return self.messages[-1] if self.messages else "it gives no reason"
