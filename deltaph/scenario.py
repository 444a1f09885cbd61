"""Scenarios: what to plan and run, in SI. Units are removed here, once; whatever is wrong with a file is said here, in one line."""

from __future__ import annotations

import difflib
import hashlib
import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, get_args

from pydantic import BaseModel, ValidationError

from deltaph.errors import ScenarioError
from deltaph.robot import Robot
from deltaph.scenario_file import ExpectSection, ScenarioFile
from deltaph.variables import variable_table

Pair = tuple[float, float]
Triple = tuple[float, float, float]


def _from_mm(value: float) -> float:
    return value / 1000.0  # correctly rounded, unlike a product with 1e-3


_UNITS = {"_mm": _from_mm, "_ms": _from_mm, "_deg": math.radians}
"""Suffixes whose unit is not SI. The others (_m_s, _kg, _Nm, ...) only go away."""


@dataclass(frozen=True, slots=True)
class Task:
    """A pick-and-place operation. Pairs are pick side, place side.

    Attributes:
        pick: pick point [m].
        place: place point [m].
        lift: lift heights [m].
        corner_deviation: prescribed corner deviations [m].
    """

    pick: Triple
    place: Triple
    lift: Pair
    corner_deviation: Pair

    def reversed(self) -> Task:
        """The way back."""
        return Task(self.place, self.pick, self.lift[::-1], self.corner_deviation[::-1])


@dataclass(frozen=True, slots=True)
class Law:
    """A motion law with its speeds [m/s]; see the planner's variables."""

    name: str
    corner_entry_speed: float
    corner_mid_speed: float
    traverse_speed: float
    overlap: float


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of joints (3) and tool centre point, SI; infinite where there is none."""

    joint_velocity: Triple
    joint_acceleration: Triple
    joint_jerk: Triple
    joint_torque: Triple
    tcp_speed: float

    @classmethod
    def of_drives(cls) -> Self:
        """What motor and gear allow: greatest speed, and peak torque after gear loss."""
        plant = variable_table("plant")
        gear = float(plant["drive.gear_ratio"].start or 0.0)
        speed = float(plant["drive.speed_max"].start or 0.0) / gear
        torque = float(plant["drive.torque_max"].start or 0.0) * float(plant["drive.gear_efficiency"].start or 0.0) * gear
        unlimited = (math.inf,) * 3
        return cls((speed,) * 3, unlimited, unlimited, (torque,) * 3, math.inf)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A parsed scenario.

    Attributes:
        title: one line.
        path: the file it came from.
        document: the file's content as parsed.
        sha256: hash of the file's content.
        payload: mass [kg].
        gains: name of the drives' gain set.
        communication_step: whole number of milliseconds.
        settle: co-simulated after arrival [s].
        cell: name of the cell in Zenoh keys.
        expect: expectations, in the file's units.
    """

    title: str
    path: Path
    document: Mapping[str, Any]
    sha256: str
    robot: Robot
    task: Task
    law: Law
    limits: Limits
    payload: float
    gains: str
    communication_step_ms: int
    settle: float
    cell: str
    expect: ExpectSection

    @property
    def json(self) -> str:
        """The file's content as JSON, for telemetry and recordings."""
        return json.dumps({"file": self.path.name, "sha256": self.sha256, **self.document})


def _si(section: BaseModel) -> dict[str, Any]:
    """The keys of a section without their units and its values in SI; absent ones left out."""
    result: dict[str, Any] = {}
    for key, value in section.model_dump(exclude_none=True).items():
        name = key
        convert: Callable[[float], float] = float
        for suffix, conversion in _UNITS.items():
            if key.endswith(suffix):
                name, convert = key.removesuffix(suffix), conversion
        for suffix in ("_m_s", "_rad_s3", "_rad_s2", "_rad_s", "_Nm", "_kg_m2", "_kg"):
            name = name.removesuffix(suffix)
        if isinstance(value, str):
            result[name] = value
        elif isinstance(value, Sequence):
            result[name] = tuple(convert(item) for item in value)
        else:
            result[name] = convert(value)
    return result


def _pair(value: float | Pair) -> Pair:
    return value if isinstance(value, tuple) else (value, value)


def _limits(section: BaseModel | None) -> Limits:
    if section is None:
        return Limits.of_drives()
    given = _si(section)
    joint = {
        key: value if isinstance(value := given.get(key, math.inf), tuple) else (value,) * 3
        for key in ("joint_velocity", "joint_acceleration", "joint_jerk", "joint_torque")
    }
    return Limits(**joint, tcp_speed=given.get("tcp_speed", math.inf))


def _known_keys(location: Sequence[str | int]) -> list[str]:
    """The keys that a table of the file may have."""
    model: type[BaseModel] = ScenarioFile
    for part in location:
        field = next((f for name, f in model.model_fields.items() if part in {name, f.alias}), None)
        if field is None:
            return []
        inner = [t for t in (field.annotation, *get_args(field.annotation)) if isinstance(t, type) and issubclass(t, BaseModel)]
        if not inner:
            return []
        model = inner[0]
    return [field.alias or name for name, field in model.model_fields.items()]


def _say(error: Mapping[str, Any]) -> str:
    """One of pydantic's errors as a sentence that names the key, the value and the way out."""
    location = [part for part in error["loc"] if not (isinstance(part, str) and part.startswith(("float", "tuple", "constrained")))]
    key = ".".join(str(part) for part in location)
    match error["type"]:
        case "extra_forbidden":
            known = _known_keys(location[:-1])
            near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
            return f"unknown key {key}: " + (f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}")
        case "missing":
            return f"key {key} is missing"
        case "value_error":
            return (f"{key}: " if key else "") + str(error["msg"]).removeprefix("Value error, ")
        case _:
            message = error["msg"][0].lower() + error["msg"][1:]
            return f"{key} is {error['input']!r}: {message}"


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: it cannot be read, is not TOML, or is not a scenario; names file, key, value and what would be right.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ScenarioError(f"cannot read scenario {path}: {reason}") from error
    return parse_scenario(text, path)


def parse_scenario(text: str, path: Path) -> Scenario:
    """Parse the content of a scenario file; `path` only names it.

    Raises:
        ScenarioError: as `load_scenario`.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: not TOML: {error}") from error
    return _parse(document, path, hashlib.sha256(text.encode()).hexdigest())


def scenario_from_json(text: str) -> Scenario:
    """The scenario of `Scenario.json`, as a cell publishes it.

    Raises:
        ScenarioError: it is not one.
    """
    try:
        document = json.loads(text)
        path, sha256 = Path(document.pop("file")), document.pop("sha256")
    except (ValueError, KeyError, AttributeError) as error:
        raise ScenarioError(f"the cell's scenario is not one of deltaph's: {error}") from error
    return _parse(document, path, sha256)


def _parse(document: Mapping[str, Any], path: Path, sha256: str) -> Scenario:
    try:
        file = ScenarioFile.model_validate(document)
    except ValidationError as error:
        # A misspelt key is reported as one unknown and one missing: the first of the two says more.
        errors = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise ScenarioError(f"{path}: {_say(errors[0])}{more}") from error

    task = _si(file.task)
    robot = _si(file.robot)
    for short in ("upper_arm", "forearm"):
        if short in robot:
            robot[f"{short}_length"] = robot.pop(short)
    return Scenario(
        title=file.title,
        path=path,
        document=document,
        sha256=sha256,
        robot=Robot.default(**robot),
        task=Task(
            pick=task["pick"],
            place=task["place"],
            lift=(task["lift"],) * 2 if "lift" in task else (task["lift_pick"], task["lift_place"]),
            corner_deviation=_pair(task["corner_deviation"]),
        ),
        law=Law(**_si(file.law)),
        limits=_limits(file.limits),
        payload=file.payload.mass_kg,
        gains=file.drive.gains,
        communication_step_ms=round(file.run.communication_step_ms),
        settle=file.run.settle_ms / 1000.0,
        cell=file.run.cell,
        expect=file.expect,
    )


def template() -> str:
    """A commented scenario to start from."""
    package = Path(__file__).resolve().parent
    for directory in (package / "scenarios", package.parent / "scenarios"):
        if (directory / "paper.toml").is_file():
            return (directory / "paper.toml").read_text(encoding="utf-8")
    raise FileNotFoundError(f"the scenarios are neither in {package} nor beside it: install deltaph again")
