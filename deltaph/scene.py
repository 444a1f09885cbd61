"""What a recording shows of a scenario and its plan that does not move."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from deltaph.plan import Plan
from deltaph.scenario import Scenario
from deltaph.telemetry import Scene


def scene_of(scenario: Scenario, plan: Plan) -> Scene:
    """The scene of a plan, for the recorder, which knows no kinematics."""
    task, parameters = plan.task, scenario.robot.parameters
    angle = np.radians([0.0, 120.0, 240.0])
    arms = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(3)])
    return Scene(
        title=scenario.title,
        law=scenario.law.name,
        scenario_json=scenario.json,
        right_angle_path=np.array([task.pick, *plan.vertices, task.place]),
        corner_deviation=np.array(task.corner_deviation),
        planned_path=plan.sample(plan.grid())["tcp_position"],
        limits=asdict(scenario.limits),
        base_points=parameters["robot.base_radius"] * arms,
        platform_offsets=parameters["robot.platform_radius"] * arms,
        elbows=scenario.robot.elbows,
    )
