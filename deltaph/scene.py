"""What a recording shows of a scenario and its plans that is known before the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from deltaph.plan import Plan
from deltaph.scenario import Scenario
from deltaph.schedule import Operation, Schedule, schedule
from deltaph.telemetry.scene import CornerMark, Move, Scene

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
    quantities = ("joint_velocity", "joint_acceleration", "joint_torque", "tcp_speed")
    return Scene(
        title=scenario.title,
        law=scenario.law.name,
        scenario_json=scenario.json,
        moves=[_move(operation, run) for operation in operations],
        period=run.cycle_time if scenario.parts else None,
        clock=run.clock.at,
        limits=asdict(scenario.limits),
        joint_range=(parameters["robot.joint_position_min"], parameters["robot.joint_position_max"]),
        peaks={name: max(float(np.max(getattr(plan.peaks, name))) for plan in plans) for name in quantities},
        coinciding_joints=_coinciding_joints(plans),
        base_points=parameters["robot.base_radius"] * arms,
        platform_offsets=parameters["robot.platform_radius"] * arms,
        elbows=scenario.robot.elbows,
        payload=_payload(scenario, run),
    )


def corner_marks(facts: Mapping[str, Any], scene: Scene) -> list[CornerMark]:
    """Of a run's JSON report, the passes that reached their corner, in order of time.

    Of cycles, the way back passes the corners of the same move in the other order.
    """
    return [
        CornerMark(
            corner["operation"] % len(scene.moves),
            corner["side"],
            corner["planned_m"],
            corner["executed_m"],
            corner["nearest_m"],
            corner["time_s"],
        )
        for corner in facts["executed"]["corners"]
        if corner["reached"]
    ]


def _move(operation: Operation, run: Schedule) -> Move:
    plan = operation.plan
    time = plan.grid(PATH_STEP_MS)
    path = plan.sample(time)["tcp_position"]
    nearest = [int(np.argmin(np.linalg.norm(path - vertex, axis=1))) for vertex in plan.vertices]
    corners = [phase for phase in plan.phases if phase.name in ("pick_corner", "place_corner")]
    times = [np.linspace(phase.start, phase.start + phase.duration, 101) for phase in corners]
    from_pick = slice(None, None, -1 if operation.move.is_return else 1)
    return Move(
        name=operation.move.name if operation.move.part else "",
        start=(operation.clock_ms - plan.dwell_ms) / 1000.0,
        right_angle_path=np.array([plan.task.pick, *plan.vertices, plan.task.place])[from_pick],
        corner_deviation=np.array(plan.task.corner_deviation)[from_pick],
        planned_path=path,
        corner_paths=[plan.sample(t)["tcp_position"] for t in times][from_pick] if len(corners) == 2 else (),
        corner_times=np.array([run.clock.reaches(operation.clock_ms + 1e3 * time[k]) / 1e3 for k in nearest])[from_pick],
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
