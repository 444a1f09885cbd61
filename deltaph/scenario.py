"""Scenarios: what to plan and run, in SI. Units are removed here, once; whatever is wrong with a file is said here, in one line."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from pydantic import BaseModel, ValidationError

from deltaph.complaints import sentence
from deltaph.errors import ScenarioError
from deltaph.robot import Robot
from deltaph.scenario_file import DriveSection, ExpectSection, FaultSection, RobotSection, ScenarioFile, named_robot
from deltaph.variables import variable_table

Pair = tuple[float, float]
Triple = tuple[float, float, float]


def _from_mm(value: float) -> float:
    return value / 1000.0  # correctly rounded, unlike a product with 1e-3


_UNITS = {"_mm": _from_mm, "_ms": _from_mm, "_deg": math.radians}
"""Suffixes whose unit is not SI."""

_SI_UNITS = (
    *("_Nm_s_rad", "_m_s", "_rad_s3", "_rad_s2", "_rad_s", "_1_s", "_kg_m2"),  # longer ones first
    *("_Nm", "_kg", "_rad", "_Hz", "_N", "_s"),
)
"""Suffixes that only go away."""


@dataclass(frozen=True, slots=True)
class Task:
    """A pick-and-place operation. Pairs are pick side, place side.

    Attributes:
        pick: pick point [m].
        place: place point [m].
        lift: lift heights [m].
        corner_deviation: prescribed corner deviations [m].
        dwell: rest at the pick point before the motion [s].
    """

    pick: Triple
    place: Triple
    lift: Pair
    corner_deviation: Pair
    dwell: float = 0.0

    def reversed(self) -> Task:
        """The way back."""
        return Task(self.place, self.pick, self.lift[::-1], self.corner_deviation[::-1], self.dwell)


@dataclass(frozen=True, slots=True)
class Move:
    """A task as part of a scenario: a part is taken to its place, or the gripper goes back for the next one.

    Attributes:
        name: for people, such as `part 3`.
        part: number of the part that is placed, or was placed before, from 1; 0 where there is no sequence.
        is_return: the way from a place point to a pick point.
        task: what to do.
        payload: what is carried [kg].
        declared_payload: what the planner is told [kg].
    """

    name: str
    part: int
    is_return: bool
    task: Task
    payload: float
    declared_payload: float

    def reversed(self) -> Move:
        """The same payload on the way back."""
        return replace(self, name="way back", is_return=True, task=self.task.reversed())


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
    def of_drives(cls, parameters: Mapping[str, float] = MappingProxyType({})) -> Self:
        """What motor and gear allow, with some plant parameters set: greatest speed, and peak torque after gear loss."""
        table = variable_table("plant")
        names = ("gear_ratio", "gear_efficiency", "speed_max", "torque_max")
        starts = {f"drive.{name}": float(table[f"drive.{name}"].start or 0.0) for name in names}
        gear, efficiency, speed_max, torque_max = (parameters.get(name, start) for name, start in starts.items())
        speed, torque = speed_max / gear, torque_max * efficiency * gear
        unlimited = (math.inf,) * 3
        return cls((speed,) * 3, unlimited, unlimited, (torque,) * 3, math.inf)


@dataclass(frozen=True, slots=True)
class Fault:
    """What happens during a run.

    Attributes:
        time: when [s].
        inputs: plant input -> value from then on.
    """

    time: float
    inputs: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Feed:
    """A feed override.

    Attributes:
        time: when it is set [s].
        override: speed along the path in parts of the planned one.
    """

    time: float
    override: float


@dataclass(frozen=True, slots=True)
class Scenario:
    """A parsed scenario.

    Attributes:
        title: one line.
        path: the file it came from.
        document: the file's content as parsed.
        sha256: hash of the file's content.
        moves: one, or those of a sequence, which ends where it begins.
        gains: name of the drives' gain set.
        plant: parameters of the plant that are not the robot's.
        feed: overrides in order of time.
        faults: in order of time.
        communication_step_ms: a whole number [ms].
        settle: co-simulated after arrival [s].
        cell: name of the cell in Zenoh keys.
        expect: expectations, in the file's units.
    """

    title: str
    path: Path
    document: Mapping[str, Any]
    sha256: str
    robot: Robot
    moves: tuple[Move, ...]
    law: Law
    limits: Limits
    gains: str
    plant: Mapping[str, float]
    feed: tuple[Feed, ...]
    faults: tuple[Fault, ...]
    communication_step_ms: int
    settle: float
    cell: str
    expect: ExpectSection

    @property
    def task(self) -> Task:
        """The first task."""
        return self.moves[0].task

    @property
    def payload(self) -> float:
        """Of the first move [kg]."""
        return self.moves[0].payload

    @property
    def first_payload(self) -> float:
        """What is in the gripper at the very beginning: nothing where it has to rest to grip [kg]."""
        return 0.0 if self.task.dwell else self.payload

    @property
    def declared_payload(self) -> float:
        """What the planner is told of it [kg]."""
        return self.moves[0].declared_payload

    @property
    def parts(self) -> int:
        """How many parts a sequence places; 0 where there is none."""
        return self.moves[-1].part

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
        if name == key:
            name = key.removesuffix(next((unit for unit in _SI_UNITS if key.endswith(unit)), ""))
        if isinstance(value, str):
            result[name] = value
        elif isinstance(value, Sequence):
            result[name] = tuple(convert(item) for item in value)
        else:
            result[name] = convert(value)
    return result


def _pair(value: float | Pair) -> Pair:
    return value if isinstance(value, tuple) else (value, value)


def _limits(section: BaseModel | None, plant: Mapping[str, float]) -> Limits:
    if section is None:
        return Limits.of_drives(plant)
    given = _si(section)
    joint = {
        key: value if isinstance(value := given.get(key, math.inf), tuple) else (value,) * 3
        for key in ("joint_velocity", "joint_acceleration", "joint_jerk", "joint_torque")
    }
    return Limits(**joint, tcp_speed=given.get("tcp_speed", math.inf))


def _robot(sections: Sequence[RobotSection]) -> Robot:
    """The robot that these sections say, later ones first."""
    given: dict[str, float] = {}
    for section in sections:
        values = _si(section)
        del values["name"]
        for short in ("upper_arm", "forearm"):
            if short in values:
                values[f"{short}_length"] = values.pop(short)
        given |= values
    robot = Robot.default(**given)
    robot.require_possible()
    return robot


def _drive(section: DriveSection) -> dict[str, float]:
    """Plant parameters of a section; of its gain set nothing."""
    return {f"drive.{name}": value for name, value in _si(section).items() if name != "gains"}


_OF_AXIS = {
    "torque_gain": "motor[{}].torque_gain",
    "torque_limit": "motor[{}].torque_limit",
    "encoder_offset": "encoder[{}].offset",
    "encoder_stuck": "encoder[{}].stuck",
}
"""Effect of a fault -> plant input of an axis."""


def _fault(section: FaultSection) -> Fault:
    effects = _si(section)
    time, axis = effects.pop("time"), effects.pop("axis", None)
    inputs: dict[str, float] = {}
    for name, value in effects.items():
        if name in _OF_AXIS:
            inputs |= {_OF_AXIS[name].format(i): value for i in (1, 2, 3) if axis in (None, i)}
        elif name == "tcp_force":
            inputs |= {f"tcp.force.{letter}": component for letter, component in zip("xyz", value, strict=True)}
        else:
            inputs["payload.mass" if name == "payload_mass" else name] = value
    return Fault(time, inputs)


def _task(task: Mapping[str, Any]) -> Task:
    """The task that the keys of `[task]` say, of which `lift` stands for both sides."""
    lift = (task["lift"],) * 2 if "lift" in task else (task["lift_pick"], task["lift_place"])
    return Task(task["pick"], task["place"], lift, _pair(task["corner_deviation"]), task.get("grip", 0.0))


def _moves(file: ScenarioFile) -> Iterator[Move]:
    """The one move of a scenario, or the moves of its sequence."""
    declared = file.payload.declared_mass_kg

    def carrying(name: str, part: int, task: Task, mass: float) -> Move:
        return Move(name, part, False, task, mass, mass if declared is None else declared)

    if file.sequence is None:
        yield carrying("way there", 0, _task(_si(file.task)), file.payload.mass_kg)
        return
    common = _si(file.task)
    lift = common.pop("lift", None)
    common = {"lift_pick": lift, "lift_place": lift, "payload_mass": file.payload.mass_kg} | common
    common |= {"grip": file.sequence.grip_ms / 1000.0, "release": file.sequence.release_ms / 1000.0}
    parts = [common | _si(part) for part in file.sequence.parts]
    tasks = [_task(part) for part in parts]
    last = len(parts) - 1
    for k, (part, task) in enumerate(zip(parts, tasks, strict=True)):
        if tasks[k - 1].place == task.pick:  # no way back from there: the gripper lets go and grips in one rest
            task = replace(task, dwell=parts[k - 1]["release"] + task.dwell)
        yield carrying(f"part {k + 1}", k + 1, task, part["payload_mass"])
        following = tasks[0 if k == last else k + 1]
        if task.place != following.pick:
            yield Move(f"return {k + 1}", k + 1, True, _return(task, following, part["release"]), 0.0, 0.0)


def _return(task: Task, following: Task, dwell: float) -> Task:
    """The way from where a task ends to where the next one begins: as high as the higher of the two, around the same corners."""
    level = max(task.place[2] + task.lift[1], following.pick[2] + following.lift[0])
    begin, end = (
        own if z + own == level else level - z for z, own in ((task.place[2], task.lift[1]), (following.pick[2], following.lift[0]))
    )
    return Task(task.place, following.pick, (begin, end), (task.corner_deviation[1], following.corner_deviation[0]), dwell)


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: it cannot be read, is not TOML, or is not a scenario; names file, key, value and what would be right.
    """
    try:
        content = path.read_bytes()
        text = content.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ScenarioError(f"cannot read scenario {path}: {reason}") from error
    return _parse_text(text, path, content)


def parse_scenario(text: str, path: Path) -> Scenario:
    """Parse the content of a scenario file; `path` only names it.

    Raises:
        ScenarioError: as `load_scenario`.
    """
    return _parse_text(text, path, text.encode())


def _parse_text(text: str, path: Path, content: bytes) -> Scenario:
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: not TOML: {error}") from error
    return _parse(document, path, hashlib.sha256(content).hexdigest())


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
        raise ScenarioError(f"{path}: {sentence(error)}") from error

    named, its_drive = named_robot(file.robot.name)
    try:
        robot = _robot((named, file.robot))
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from error
    gains = variable_table("plant").gains[file.drive.gains]
    trips = {f"trip_threshold.{name}": value for name, value in _si(file.trip).items()}
    plant = {**_drive(its_drive), **gains, **_drive(file.drive), **trips}
    return Scenario(
        title=file.title,
        path=path,
        document=document,
        sha256=sha256,
        robot=robot,
        moves=tuple(_moves(file)),
        law=Law(**_si(file.law)),
        limits=_limits(file.limits, plant),
        gains=file.drive.gains,
        plant=plant,
        feed=tuple(sorted((Feed(**_si(section)) for section in file.feed), key=lambda feed: feed.time)),
        faults=tuple(sorted(map(_fault, file.fault), key=lambda fault: fault.time)),
        communication_step_ms=round(file.run.communication_step_ms),
        settle=file.run.settle_ms / 1000.0,
        cell=file.run.cell,
        expect=file.expect,
    )


def template(name: str = "paper") -> str:
    """A scenario that comes with the package; `paper` is commented, to start from."""
    package = Path(__file__).resolve().parent
    for directory in (package / "scenarios", package.parent / "scenarios"):
        if (directory / f"{name}.toml").is_file():
            return (directory / f"{name}.toml").read_text(encoding="utf-8")
    raise FileNotFoundError(f"the scenarios are neither in {package} nor beside it: install deltaph again")
