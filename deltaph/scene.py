"""What a recording shows of a scenario and its plans that is known before the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from deltaph.checks import deviation_tolerance
from deltaph.plan import Plan
from deltaph.scenario import Scenario, Task
from deltaph.schedule import Operation, Schedule, schedule
from deltaph.telemetry.scene import CornerMark, Move, Scene
from deltaph.variables import variable_table

PATH_STEP_MS = 0.25
"""Between two points of a drawn path: at 5 m/s 1.25 mm, whose chord is within 0.02 mm of a corner of 10 mm radius."""


def scene_of(scenario: Scenario) -> Scene:
    """The scene of a scenario, for the recorder, which knows no kinematics. Cycles repeat it.

    The ways between parts are drawn from their pick side on, too: a corner above a pick point is one, whichever way it is passed.

    Raises:
        InfeasibleError: a task cannot be planned.
    """
    run = schedule(scenario)
    operations = run.operations
    plans = [operation.plan for operation in operations]
    parameters = scenario.robot.parameters
    angle = np.radians([0.0, 120.0, 240.0])
    arms = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(3)])
    return Scene(
        title=scenario.title,
        law=scenario.law.name,
        scenario_json=scenario.json,
        moves=[_move_of(operation, run) for operation in operations],
        period=run.period if scenario.parts else None,
        clock=run.clock.at,
        tolerance=deviation_tolerance(scenario),
        limits={**asdict(scenario.limits), "motor_torque": scenario.plant.get("drive.torque_max", _torque_max())},
        joint_range=(parameters["robot.joint_position_min"], parameters["robot.joint_position_max"]),
        peaks=_peaks(plans),
        coinciding_joints=_coinciding_joints(plans),
        base_points=parameters["robot.base_radius"] * arms,
        platform_offsets=parameters["robot.platform_radius"] * arms,
        elbows=scenario.robot.elbows,
        payload=_payload(scenario, run),
    )


def served_scene(scenario: Scenario, facts: Mapping[str, Any] | None = None) -> Scene:
    """The scene of a cell that serves.

    Args:
        scenario: of its robot and law; its task, which may never run, only says where to look.
        facts: the cell's JSON report, which tells the newest plans that arrived: they are planned again, and are the moves.
    """
    scene = replace(scene_of(scenario), served=True, payload=((0.0, 0.0),), peaks={}, coinciding_joints=())
    newest = facts["plans"]["newest"] if facts is not None else []
    plans = [
        Plan(
            scenario.robot,
            Task(tuple(found["pick_m"]), tuple(found["place_m"]), tuple(found["lift_m"]), tuple(found["corner_deviation_m"])),
            scenario.law,
            found["payload_kg"],
            scenario.limits,
        )
        for found in newest
    ]
    if not plans:
        return scene
    moves = [_move(plan, f"plan {found['plan']}") for plan, found in zip(plans, newest, strict=True)]
    return replace(scene, moves=moves, peaks=_peaks(plans), coinciding_joints=_coinciding_joints(plans))


def served_marks(facts: Mapping[str, Any]) -> list[CornerMark]:
    """Of the JSON report of a cell that served, the passes of the moves of `served_scene`, in order of time."""
    newest = enumerate(facts["plans"]["newest"])
    return sorted((_mark(move, corner) for move, found in newest for corner in found["corners"]), key=lambda mark: mark.time)


def corner_marks(facts: Mapping[str, Any], scene: Scene) -> list[CornerMark]:
    """Of a run's JSON report, the passes that reached their corner, in order of time.

    Of cycles, the way back passes the corners of the same move in the other order.
    """
    corners = facts["executed"]["corners"]
    return [_mark(corner["operation"] % len(scene.moves), corner) for corner in corners if corner["reached"]]


def _mark(move: int, corner: Mapping[str, Any]) -> CornerMark:
    return CornerMark(move, corner["side"], corner["planned_m"], corner["executed_m"], corner["nearest_m"], corner["time_s"])


def _torque_max() -> float:
    """What a motor of the plant gives at most where a scenario does not say [N.m]."""
    return float(variable_table("plant")["drive.torque_max"].start or 0.0)


def _peaks(plans: Sequence[Plan]) -> dict[str, float]:
    quantities = ("joint_velocity", "joint_acceleration", "joint_torque", "tcp_speed")
    return {name: max(float(np.max(getattr(plan.peaks, name))) for plan in plans) for name in quantities}


def _move_of(operation: Operation, run: Schedule) -> Move:
    """A move of a schedule, on the scene's clock and from its pick side on."""
    plan, move = operation.plan, _move(operation.plan, operation.move.name if operation.move.part else "")
    from_pick = slice(None, None, -1 if operation.move.is_return else 1)
    return replace(
        move,
        start=(operation.clock_ms - plan.dwell_ms) / 1000.0,
        right_angle_path=move.right_angle_path[from_pick],
        corner_deviation=move.corner_deviation[from_pick],
        corner_paths=move.corner_paths[from_pick],
        corner_times=np.array([run.clock.reaches(operation.clock_ms + 1e3 * at) / 1e3 for at in move.corner_times])[from_pick],
    )


def _move(plan: Plan, name: str) -> Move:
    """As it is planned, on the clock of the plan."""
    time = plan.grid(PATH_STEP_MS)
    path = plan.sample(time)["tcp_position"]
    nearest = [int(np.argmin(np.linalg.norm(path - vertex, axis=1))) for vertex in plan.vertices]
    corners = [phase for phase in plan.phases if phase.name in ("pick_corner", "place_corner")]
    times = [np.linspace(phase.start, phase.start + phase.duration, 101) for phase in corners]
    return Move(
        name=name,
        right_angle_path=np.array([plan.task.pick, *plan.vertices, plan.task.place]),
        corner_deviation=np.array(plan.task.corner_deviation),
        planned_path=path,
        corner_paths=[plan.sample(t)["tcp_position"] for t in times] if len(corners) == 2 else (),
        corner_times=time[nearest],
    )


def _coinciding_joints(plans: Sequence[Plan]) -> tuple[int, ...]:
    """Joints that move alike in every plan, to a nanoradian: their lines cannot be told apart."""
    positions = np.concatenate([plan.joints(plan.grid())[0] for plan in plans])
    for pair in ((1, 2), (0, 2), (0, 1)):
        if np.allclose(positions[:, pair[0]], positions[:, pair[1]], rtol=0.0, atol=1e-9):
            return pair[0] + 1, pair[1] + 1
    return ()


def _payload(scenario: Scenario, run: Schedule) -> list[tuple[float, float]]:
    """What the robot really carries, as (from when on the planner's clock [s], mass [kg])."""
    faults = [(fault.time, fault.inputs["payload.mass"]) for fault in scenario.faults if "payload.mass" in fault.inputs]
    changes = sorted([*run.payload_changes, *faults], key=lambda change: change[0])
    return [(float(run.clock.at(np.array([time]))[0]), mass) for time, mass in changes]
