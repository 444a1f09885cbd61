"""An instance of an FMU behind its bare C functions: every call gives its status, FMI 2.0 and FMI 3.0 alike."""

from __future__ import annotations

import ctypes as c
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmpy import extract

from deltaph.fmu.model_description import FmiVersion
from deltaph.fmu.package import file_name
from deltaph.fmu.platforms import host
from deltaph.fmu.sources import token
from deltaph.variables import Model, Variable, variable_table

OK, WARNING, DISCARD, ERROR = range(4)

_LOGGERS = {
    2: c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p),
    3: c.CFUNCTYPE(None, c.c_void_p, c.c_int, c.c_char_p, c.c_char_p),
}
_TYPES: dict[FmiVersion, dict[str, tuple[str, Any]]] = {
    2: {"Float64": ("Real", c.c_double), "Int32": ("Integer", c.c_int), "Boolean": ("Boolean", c.c_int), "": ("Integer", c.c_int)},
    3: {
        "Float64": ("Float64", c.c_double),
        "Int32": ("Int32", c.c_int32),
        "Boolean": ("Boolean", c.c_bool),
        "": ("Int64", c.c_int64),
    },
}
"""Type of a variable -> name in the functions that access it, and C type; all others are enumerations."""


class Callbacks2(c.Structure):
    """fmi2CallbackFunctions."""

    _fields_ = [
        ("logger", _LOGGERS[2]),
        ("allocateMemory", c.c_void_p),
        ("freeMemory", c.c_void_p),
        ("stepFinished", c.c_void_p),
        ("componentEnvironment", c.c_void_p),
    ]


class FmiSlave:
    """An instance.

    Attributes:
        messages: status, category and text of what it logged.
        component: the C pointer; None where instantiation was refused.
    """

    def __init__(
        self,
        dist: Path,
        model: Model,
        version: FmiVersion,
        directory: Path,
        *,
        name: str | None = "one",
        guid: str | None = None,
        logging: bool = True,
        events: bool = False,
        model_exchange: bool = False,
    ) -> None:
        self.table = variable_table(model)
        self.version = version
        self.messages: list[tuple[int, str, str]] = []
        unzipped = directory / f"{model}{version}"
        if not unzipped.is_dir():
            extract(str(dist / file_name(model, version)), str(unzipped))
        platform = host()
        self.library = c.CDLL(str(unzipped / "binaries" / platform.folder(version) / f"{self.table.model}{platform.extension}"))
        self._logger: Any = _LOGGERS[version](self._log_2 if version == 2 else self._log_3)
        guid = token(model, version) if guid is None else guid
        encoded = None if name is None else name.encode()
        if version == 2:
            instantiate = self.library.fmi2Instantiate
            callbacks = Callbacks2(self._logger)
            kind = 0 if model_exchange else 1
            arguments: tuple[Any, ...] = (encoded, kind, guid.encode(), None, c.byref(callbacks), 0, int(logging))
        elif model_exchange:
            instantiate = self.library.fmi3InstantiateModelExchange
            arguments = (encoded, guid.encode(), None, False, logging, None, self._logger)
        else:
            instantiate = self.library.fmi3InstantiateCoSimulation
            flags = [c.c_bool(flag) for flag in (False, logging, events, True)]
            arguments = (encoded, guid.encode(), None, *flags, None, c.c_size_t(0), None, self._logger, None)
        instantiate.restype = c.c_void_p
        self.component: int | None = instantiate(*arguments)

    def _log_2(self, _environment: Any, _name: bytes, status: int, category: bytes, message: bytes) -> None:
        self.messages.append((status, category.decode(), message.decode()))

    def _log_3(self, _environment: Any, status: int, category: bytes, message: bytes) -> None:
        self.messages.append((status, category.decode(), message.decode()))

    @property
    def last(self) -> str:
        """The text of the last message."""
        return self.messages[-1][2]

    def call(self, function: str, *arguments: Any) -> int:
        """Call `fmiN<function>` on the instance."""
        return int(getattr(self.library, f"fmi{self.version}{function}")(c.c_void_p(self.component), *arguments))

    def free(self) -> None:
        """Free the instance, once."""
        getattr(self.library, f"fmi{self.version}FreeInstance")(c.c_void_p(self.component))
        self.component = None

    # ---- Life cycle -------------------------------------------------------------------------------------------------------------

    def enter(self, start: float = 0.0, stop: float | None = None) -> int:
        """To initialization mode."""
        times = (0, c.c_double(0.0), c.c_double(start), int(stop is not None), c.c_double(stop or 0.0))
        if self.version == 3:
            return self.call("EnterInitializationMode", *times)
        return max(self.call("SetupExperiment", *times), self.call("EnterInitializationMode"))

    def initialize(self, start: float = 0.0, stop: float | None = None) -> None:
        """To step mode."""
        assert self.enter(start, stop) == OK, self.messages
        assert self.call("ExitInitializationMode") == OK, self.messages

    def step(self, point: float, size: float = 1e-3) -> int:
        """Do a step; `early`, `last_time` hold what FMI 3.0 gives back."""
        times = (c.c_double(point), c.c_double(size))
        if self.version == 2:
            return self.call("DoStep", *times, 1)
        flags = [c.c_bool(True) for _ in range(3)]
        last_time = c.c_double(-1.0)
        status = self.call("DoStep", *times, c.c_bool(True), *map(c.byref, flags), c.byref(last_time))
        self.early, self.last_time = any(flag.value for flag in flags), last_time.value
        return status

    # ---- Variables --------------------------------------------------------------------------------------------------------------

    def type_of(self, variable: Variable) -> tuple[str, Any]:
        """The name in the functions that access a variable, and the C type of its values."""
        types = _TYPES[self.version]
        return types.get(variable.type, types[""])

    def access(self, function: str, references: Sequence[int], values: Any, n_values: int | None = None) -> int:
        """Call a function that gets or sets variables."""
        n = len(references)
        counts = (c.c_size_t(n if n_values is None else n_values),) if self.version == 3 else ()
        return self.call(function, (c.c_uint32 * n)(*references), c.c_size_t(n), values, *counts)

    def get(self, *names: str) -> list[float]:
        """Values, which must be readable."""
        values = []
        for variable in map(self.table.__getitem__, names):
            kind, c_type = self.type_of(variable)
            buffer = (c_type * 1)()
            assert self.access(f"Get{kind}", [variable.value_reference], buffer) == OK, self.messages
            values.append(buffer[0])
        return values

    def put(self, values: dict[str, float]) -> int:
        """Set variables of one type in one call."""
        variables = [self.table[name] for name in values]
        kind, c_type = self.type_of(variables[0])
        return self.access(f"Set{kind}", [v.value_reference for v in variables], (c_type * len(values))(*values.values()))

    def outputs(self) -> list[float]:
        """All outputs in table order."""
        return self.get(*(variable.name for variable in self.table.of("output")))

    # ---- State ------------------------------------------------------------------------------------------------------------------

    def save(self) -> c.c_void_p:
        """Get the FMU state."""
        state = c.c_void_p()
        assert self.call("GetFMUstate" if self.version == 2 else "GetFMUState", c.byref(state)) == OK
        return state

    def restore(self, state: c.c_void_p) -> int:
        """Set the FMU state."""
        return self.call("SetFMUstate" if self.version == 2 else "SetFMUState", state)

    def drop(self, state: c.c_void_p) -> int:
        """Free the FMU state."""
        return self.call("FreeFMUstate" if self.version == 2 else "FreeFMUState", c.byref(state))

    def serialize(self, state: c.c_void_p) -> bytes:
        """The bytes of an FMU state."""
        size = c.c_size_t()
        name = "FMUstate" if self.version == 2 else "FMUState"
        assert self.call(f"Serialized{name}Size", state, c.byref(size)) == OK
        buffer = (c.c_char * size.value)()
        assert self.call(f"Serialize{name}", state, buffer, size) == OK
        return bytes(buffer.raw)

    def deserialize(self, content: bytes) -> tuple[int, c.c_void_p]:
        """Status and FMU state of these bytes."""
        state = c.c_void_p()
        name = "DeSerializeFMUstate" if self.version == 2 else "DeserializeFMUState"
        return self.call(name, content, c.c_size_t(len(content)), c.byref(state)), state
