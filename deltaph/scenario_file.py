"""The form of a scenario file: every key with its unit, unknown keys refused. `deltaph schema` prints it as JSON Schema."""

from __future__ import annotations

import tomllib
from typing import Annotated, Any, Literal, Self

from annotated_types import Ge, Gt, Le, MinLen
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, model_validator

from deltaph.sources import ROBOTS
from deltaph.variables import variable_table

Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
# TOML has arrays, not tuples: these alone are not strict.
Point = Annotated[tuple[float, float, float], Strict(False)]
PerJoint = Positive | Annotated[tuple[Positive, Positive, Positive], Strict(False)]
Share = Annotated[float, Ge(0), Le(1)]
Dwell = Annotated[float, Ge(0), Le(600_000)]
PerCorner = Positive | Annotated[tuple[Positive, Positive], Strict(False)]

_LEAST_LAST_OVERRIDE = 0.01
"""A motion of 0.3 s takes 30 s with it."""

_LAWS = variable_table("planner").items("Law")
_GAINS = tuple(variable_table("plant").gains)
_STATUS = variable_table("planner").items("PlanStatus")
_TRIPS = variable_table("plant").items("Trip")
_ROBOTS = ("default", *sorted(path.stem for path in ROBOTS.glob("*.toml")))


def _one_of(*choices: str) -> AfterValidator:
    def check(value: str) -> str:
        if value not in choices:
            raise ValueError(f"{value!r} is not one of {', '.join(choices)}")
        return value

    return AfterValidator(check)


class Section(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class RobotSection(Section):
    """The robot; what is absent keeps the value of the named robot."""

    name: Annotated[str, _one_of(*_ROBOTS)] = Field(
        "default", description="named robot to start from", json_schema_extra={"enum": list(_ROBOTS)}
    )
    base_radius_mm: Positive | None = Field(None, description="shoulder axes to the vertical axis of the base")
    platform_radius_mm: NonNegative | None = Field(None, description="forearm joints to the vertical axis of the platform")
    upper_arm_mm: Positive | None = Field(None, description="shoulder axis to elbow")
    forearm_mm: Positive | None = Field(None, description="elbow to platform joint")
    upper_arm_mass_kg: NonNegative | None = None
    upper_arm_com_mm: NonNegative | None = Field(None, description="centre of mass of the upper arm from the shoulder axis")
    upper_arm_inertia_kg_m2: Positive | None = Field(None, description="about the shoulder axis")
    forearm_mass_kg: NonNegative | None = Field(None, description="the two rods of one forearm together")
    forearm_inertia_kg_m2: NonNegative | None = Field(None, description="the two rods together, transverse, about their centre")
    platform_mass_kg: Positive | None = Field(None, description="platform and gripper, without payload")
    drive_inertia_kg_m2: NonNegative | None = Field(None, description="rotor and gear, reflected to the joint")
    joint_position_min_deg: float | None = Field(None, description="from horizontal, positive downwards")
    joint_position_max_deg: float | None = None


class TaskSection(Section):
    """What to do: up, across, down. With `[sequence]`: what its parts have that do not say otherwise."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [
                {"required": ["lift_mm"], "not": {"anyOf": [{"required": ["lift_pick_mm"]}, {"required": ["lift_place_mm"]}]}},
                {"required": ["lift_pick_mm", "lift_place_mm"], "not": {"required": ["lift_mm"]}},
            ]
        }
    )

    pick_mm: Point | None = Field(
        None,
        description="pick point x, y, z in the base frame; z is up, the workspace is below 0; the parts of a sequence may say it",
    )
    place_mm: Point | None = Field(None, description="place point x, y, z in the base frame; the parts of a sequence may say it")
    lift_mm: NonNegative | None = Field(None, description="lift height above both points; 0: straight across")
    lift_pick_mm: NonNegative | None = Field(
        None, description="lift height above the pick point, where the two differ; 0: no corner"
    )
    lift_place_mm: NonNegative | None = Field(
        None, description="lift height above the place point, where the two differ; 0: no corner"
    )
    corner_deviation_mm: PerCorner = Field(
        description="greatest distance of a corner's vertex from the path; one value, or one at the pick and one at the place side"
    )

    @model_validator(mode="after")
    def _lifts(self) -> Self:
        both = (self.lift_pick_mm is not None, self.lift_place_mm is not None)
        if (self.lift_mm is not None and any(both)) or (self.lift_mm is None and not all(both)):
            raise ValueError("give either lift_mm or both lift_pick_mm and lift_place_mm")
        return self


class PartSection(Section):
    """A part of a sequence: what is different from `[task]`, `[payload]` and `[sequence]`."""

    model_config = ConfigDict(
        json_schema_extra={
            "not": {"required": ["lift_mm"], "anyOf": [{"required": ["lift_pick_mm"]}, {"required": ["lift_place_mm"]}]}
        }
    )

    pick_mm: Point | None = None
    place_mm: Point | None = None
    lift_mm: NonNegative | None = Field(None, description="lift height above both points")
    lift_pick_mm: NonNegative | None = None
    lift_place_mm: NonNegative | None = None
    corner_deviation_mm: PerCorner | None = None
    payload_mass_kg: NonNegative | None = Field(None, description="mass of the part")
    grip_ms: Dwell | None = None
    release_ms: Dwell | None = None

    @model_validator(mode="after")
    def _lifts(self) -> Self:
        if self.lift_mm is not None and (self.lift_pick_mm is not None or self.lift_place_mm is not None):
            raise ValueError("give either lift_mm or lift_pick_mm and lift_place_mm")
        return self


class SequenceSection(Section):
    """Parts that are placed one after the other. From each place the empty gripper goes to the next pick, then to the first one."""

    grip_ms: Dwell = Field(0.0, description="rest at each pick point; half-way through it the part is in the gripper")
    release_ms: Dwell = Field(0.0, description="rest at each place point; half-way through it the part is out of the gripper")
    parts: Annotated[tuple[PartSection, ...], Strict(False), MinLen(1)] = Field(
        description="one table for each part, in order; what it does not say is that of [task] and [payload]"
    )


class LawSection(Section):
    """The motion law and its speeds."""

    name: Annotated[str, _one_of(*_LAWS)] = Field("paper", description="motion law", json_schema_extra={"enum": list(_LAWS)})
    corner_entry_speed_m_s: Positive = Field(1.2, description="V_B; comparison: greatest vertical speed")
    corner_mid_speed_m_s: Positive = Field(0.8, description="V_N; unused by comparison")
    traverse_speed_m_s: Positive = Field(2.4, description="V_max; comparison: greatest horizontal speed")
    overlap: float = Field(
        0.5, ge=0, le=1, description="comparison only: share of a vertical stroke's time that overlaps the horizontal stroke"
    )


class LimitsSection(Section):
    """Limits that replace the robot's own; absent means unlimited. One value for all joints, or three."""

    joint_velocity_rad_s: PerJoint | None = None
    joint_acceleration_rad_s2: PerJoint | None = None
    joint_jerk_rad_s3: PerJoint | None = None
    joint_torque_Nm: PerJoint | None = None
    tcp_speed_m_s: Positive | None = None


class PayloadSection(Section):
    """What the gripper carries."""

    mass_kg: NonNegative = 0.0
    declared_mass_kg: NonNegative | None = Field(None, description="what the planner is told, where that is something else")


class DriveSection(Section):
    """The servo drives: a gain set, and single values that replace those of gain set and robot."""

    gains: Annotated[str, _one_of(*_GAINS)] = Field("tuned", description="named gain set", json_schema_extra={"enum": list(_GAINS)})
    gear_ratio: float | None = Field(None, ge=1, description="motor turns per joint turn")
    gear_efficiency: float | None = Field(None, ge=0.1, le=1)
    coulomb_friction_Nm: NonNegative | None = Field(None, description="at the motor")
    viscous_friction_Nm_s_rad: NonNegative | None = Field(None, description="at the motor")
    torque_max_Nm: NonNegative | None = Field(None, description="momentary peak torque of the motor")
    torque_rated_Nm: Positive | None = Field(None, description="torque that the motor stands in the long run")
    thermal_time_constant_s: Positive | None = None
    speed_max_rad_s: NonNegative | None = Field(None, description="greatest motor speed")
    torque_time_constant_ms: Positive | None = Field(None, description="lag of the torque loop")
    encoder_counts: int | None = Field(None, ge=16, le=2**30, description="per motor turn")
    nominal_inertia_kg_m2: Positive | None = Field(None, description="at the motor shaft; the velocity gain is made for it")
    position_gain_1_s: NonNegative | None = None
    velocity_bandwidth_Hz: NonNegative | None = None
    integral_time_ms: Positive | None = None
    velocity_feedforward: Share | None = None
    torque_feedforward: Share | None = None


class TripSection(Section):
    """When the plant trips; what is absent keeps its default."""

    position_deviation_rad: NonNegative | None = Field(None, description="joint angle, reference against encoder")
    overspeed: float | None = Field(None, ge=1, description="in parts of the greatest motor speed")
    overload: NonNegative | None = Field(None, description="thermal load; 1 is that of the rated torque")
    encoder_rad: NonNegative | None = Field(None, description="motor angle by which an encoder may be wrong")
    joint_range_rad: NonNegative | None = Field(None, description="angle by which a joint may leave its range")


class FaultSection(Section):
    """What happens at a time and lasts until something else is said: a fault, a disturbance, or its end."""

    time_ms: NonNegative = Field(description="takes effect at the first communication point from then on")
    axis: Literal[1, 2, 3] | None = Field(None, description="of torque and encoder faults; absent: all three")
    torque_gain: Share | None = Field(None, description="share of its torque that the motor gives; 0: none")
    torque_limit_Nm: NonNegative | None = Field(None, description="limit of the motor torque")
    encoder_offset_deg: float | None = Field(None, description="joint angle by which the encoder reads too much")
    encoder_stuck: bool | None = Field(None, description="the encoder repeats its last reading")
    payload_mass_kg: NonNegative | None = Field(None, description="what the platform really carries; what is added was at rest")
    tcp_force_N: Point | None = Field(None, description="force from outside on the platform")
    servo_on: bool | None = None
    brake: bool | None = None

    @model_validator(mode="after")
    def _effects(self) -> Self:
        given = self.model_dump(exclude_none=True, exclude={"time_ms", "axis"})
        if not given:
            raise ValueError("give what happens, such as torque_gain = 0.0")
        of_an_axis = [name for name in given if name.startswith(("torque", "encoder"))]
        if self.axis is not None and not of_an_axis:
            raise ValueError("axis goes with torque_gain, torque_limit_Nm, encoder_offset_deg or encoder_stuck")
        return self


class FeedSection(Section):
    """A feed override: from a time on the motion goes along its path more slowly, or stops on it."""

    time_ms: NonNegative = Field(description="takes effect at the first communication point from then on")
    override: Share = Field(description="speed along the path in parts of the planned one; it is approached with bounded jerk")


class RunSection(Section):
    """How to run the co-simulation."""

    communication_step_ms: float = Field(1.0, gt=0, le=1000, description="a whole multiple of 1 ms")
    settle_ms: float = Field(50.0, ge=0, le=600_000, description="co-simulated after arrival")
    cell: Annotated[str, MinLen(1)] = Field("cell1", pattern=r"^[A-Za-z0-9_.-]+$", description="name of the cell in Zenoh keys")

    @model_validator(mode="after")
    def _grid(self) -> Self:
        if self.communication_step_ms != round(self.communication_step_ms):
            raise ValueError(f"communication_step_ms is {self.communication_step_ms:g}, which is not a whole multiple of 1 ms")
        return self


class Expectation(Section):
    """A bound on a result: `equals` with a `tolerance`, or `min`, or `max`, or both."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [{"required": ["equals"]}, {"anyOf": [{"required": ["min"]}, {"required": ["max"]}]}],
            "dependentRequired": {"tolerance": ["equals"]},
        }
    )

    equals: float | None = None
    tolerance: NonNegative = 0.0
    min: float | None = None
    max: float | None = None

    @model_validator(mode="after")
    def _bounds(self) -> Self:
        if (self.equals is None) == (self.min is None and self.max is None):
            raise ValueError("give either equals, with a tolerance, or min or max")
        if self.equals is None and "tolerance" in self.model_fields_set:
            raise ValueError("tolerance goes with equals: leave it out, or widen min and max")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"nothing is at least {self.min:g} and at most {self.max:g}")
        return self

    @property
    def low(self) -> float | None:
        """Least acceptable value."""
        return self.min if self.equals is None else self.equals - self.tolerance

    @property
    def high(self) -> float | None:
        """Greatest acceptable value."""
        return self.max if self.equals is None else self.equals + self.tolerance


class ExpectSection(Section):
    """What the run must show; of a list of values, each one."""

    duration_ms: Expectation | None = None
    nominal_duration_ms: Expectation | None = None
    planned_corner_deviation_mm: Expectation | None = None
    executed_corner_deviation_mm: Expectation | None = None
    corner_excess_mm: Expectation | None = Field(None, description="executed beyond the prescribed corner deviation")
    cycle_time_ms: Expectation | None = Field(None, description="of a sequence, planned, back at the first pick point")
    parts_per_minute: Expectation | None = Field(None, description="of a sequence, planned")
    arrival_ms: Expectation | None = Field(None, description="executed: the last operation has arrived, whatever slowed it down")
    overshoot_mm: Expectation | None = None
    tracking_error_tcp_mm: Expectation | None = None
    tracking_error_joint_mrad: Expectation | None = None
    motor_torque_max_Nm: Expectation | None = None
    motor_torque_rms_Nm: Expectation | None = None
    motor_load_max: Expectation | None = Field(None, description="thermal load; 1 is that of the rated torque")
    trip: Annotated[str, _one_of(*_TRIPS)] | None = Field(
        None, description="the plant trips for this reason", json_schema_extra={"enum": list(_TRIPS)}
    )
    trip_axis: Expectation | None = None
    refused: Annotated[str, _one_of(*_STATUS)] | None = Field(
        None, description="the plan is refused for this reason", json_schema_extra={"enum": list(_STATUS)}
    )


_POINTS_WITHOUT_SEQUENCE: dict[str, Any] = {
    "if": {"not": {"required": ["sequence"]}},
    "then": {"properties": {"task": {"required": ["pick_mm", "place_mm"]}}},
}


class ScenarioFile(Section):
    """A deltaph scenario."""

    model_config = ConfigDict(json_schema_extra=_POINTS_WITHOUT_SEQUENCE)

    schema_: Literal[1] = Field(alias="schema", description="version of this form")
    title: Annotated[str, MinLen(1)]
    robot: RobotSection = RobotSection()
    task: TaskSection
    sequence: SequenceSection | None = None
    law: LawSection = LawSection()
    limits: LimitsSection | None = None
    payload: PayloadSection = PayloadSection()
    drive: DriveSection = DriveSection()
    trip: TripSection = TripSection()
    feed: Annotated[tuple[FeedSection, ...], Strict(False)] = ()
    fault: Annotated[tuple[FaultSection, ...], Strict(False)] = ()
    run: RunSection = RunSection()
    expect: ExpectSection = ExpectSection()

    @model_validator(mode="after")
    def _points(self) -> Self:
        for key in ("pick_mm", "place_mm"):
            of_task = getattr(self.task, key)
            if self.sequence is None:
                if of_task is None:
                    raise ValueError(f"key task.{key} is missing")
                continue
            lacking = [number for number, part in enumerate(self.sequence.parts, 1) if getattr(part, key) is None]
            if lacking and of_task is None:
                raise ValueError(f"part {lacking[0]} of the sequence has no {key}: say it there, or in [task] for all that do not")
            if of_task is not None and not lacking:
                raise ValueError(f"task.{key} is not used: every part of the sequence has its own; leave it out")
        return self

    @model_validator(mode="after")
    def _expectations(self) -> Self:
        for key in ("cycle_time_ms", "parts_per_minute"):
            if self.sequence is None and getattr(self.expect, key) is not None:
                raise ValueError(f"expect.{key} is of a sequence: this scenario has none")
        return self

    @model_validator(mode="after")
    def _arrives(self) -> Self:
        # of overrides at the same time the last one holds
        if self.feed and (last := sorted(self.feed, key=lambda feed: feed.time_ms)[-1].override) < _LEAST_LAST_OVERRIDE:
            raise ValueError(f"feed: the last override is {last:g}, too slow to arrive: end with at least {_LEAST_LAST_OVERRIDE:g}")
        return self


class RobotFile(Section):
    """A named robot: the tables of a scenario that say what it is."""

    robot: RobotSection
    drive: DriveSection = DriveSection()


def named_robot(name: str) -> tuple[RobotSection, DriveSection]:
    """The data of a named robot; the default one is what the variable tables start with."""
    document: dict[str, Any] = {"robot": {}}
    if name != "default":
        document = tomllib.loads((ROBOTS / f"{name}.toml").read_text(encoding="utf-8"))
    data = RobotFile.model_validate(document)
    return data.robot, data.drive
