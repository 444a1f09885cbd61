"""The variable tables agree with the kernel, with each other and with the contract's names."""

import numpy as np
import pytest

from deltaph.kernel import enumeration
from deltaph.robot import Robot
from deltaph.variables import MODELS, variable_table


@pytest.mark.parametrize(("table", "kernel"), [("Law", "dph_law"), ("Phase", "dph_phase"), ("PlanStatus", "dph_status")])
def test_enumerations_are_the_kernels(table: str, kernel: str) -> None:
    assert variable_table("planner").items(table) == enumeration(kernel)


def test_both_fmus_share_the_robot() -> None:
    planner, plant = ({v.name: v for v in variable_table(model) if v.name.startswith("robot.")} for model in MODELS)
    assert planner == plant
    assert len(planner) == 13


def test_plant_starts_at_rest_in_its_own_inverse_kinematics() -> None:
    plant = variable_table("plant")
    start = np.array([plant[f"start.{axis}"].start for axis in "xyz"], dtype=np.float64)
    theta = Robot.default().inverse_kinematics(start)
    assert [plant[f"joint[{i}].position_ref"].start for i in (1, 2, 3)] == pytest.approx(theta.tolist(), abs=1e-15)


def test_reflected_drive_inertia_is_that_of_the_drive() -> None:
    plant = variable_table("plant")
    assert plant["robot.drive_inertia"].start == pytest.approx(
        plant["drive.gear_ratio"].start ** 2 * (1.51e-4 + 0.30e-4), rel=1e-12
    )


def test_every_float_has_a_unit_and_every_input_and_parameter_a_start() -> None:
    for model in MODELS:
        for variable in variable_table(model):
            assert (variable.unit is not None) == variable.is_float, variable.name
            assert (variable.start is None) == (variable.causality == "output"), variable.name
            assert variable.description, variable.name
            if variable.start is not None:
                assert (variable.min is None or variable.start >= variable.min) and (
                    variable.max is None or variable.start <= variable.max
                ), variable.name


def test_factory_gains_are_variables() -> None:
    plant = variable_table("plant")
    assert set(plant.gains) == {"tuned", "factory"}
    for gains in plant.gains.values():
        for name in gains:
            assert plant[name].causality == "parameter"
