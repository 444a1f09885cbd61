"""From data back to parameters: the payload of a recorded run, by least squares on its motor torques."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from reference.pinocchio_delta import PinocchioDelta

from deltaph.fmu import cached_fmus
from deltaph.importer import cosimulate
from deltaph.outputs import frame_columns, write_csv
from deltaph.scenario import parse_scenario, template
from deltaph.schedule import schedule
from deltaph.variables import variable_table

Vector = NDArray[np.float64]

_NAMES = ("gear_ratio", "gear_efficiency", "coulomb_friction", "viscous_friction")
GEAR, EFFICIENCY, COULOMB, VISCOUS = (float(variable_table("plant")[f"drive.{name}"].start or 0.0) for name in _NAMES)
EVERY = 3  # frames


def recorded(payload: float) -> dict[str, Vector]:
    """Columns of `deltaph run --csv` for the paper's case with a payload that the planner does not know of."""
    text = template().replace("mass_kg = 0.0", f"mass_kg = {payload}\ndeclared_mass_kg = 0.0")
    scenario = parse_scenario(text, Path("identification.toml"))
    stream = io.StringIO()
    write_csv(stream, frame_columns(list(cosimulate(scenario, schedule(scenario), cached_fmus()))))
    stream.seek(0)
    rows = list(csv.DictReader(stream))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def joint_torque(columns: dict[str, Vector]) -> Vector:
    """Joint torques (n, 3) from measured motor torques and speeds: gear and friction as the plant's README says."""
    motor, speed = (np.column_stack([columns[f"plant.motor[{i}].{name}"] for i in (1, 2, 3)]) for name in ("torque", "speed"))
    direction = np.tanh(speed)
    losses = (1.0 - EFFICIENCY) * np.abs(motor) * direction + COULOMB * direction + VISCOUS * speed
    return np.asarray(GEAR * (motor - losses))


@pytest.mark.parametrize("payload", [0.0, 0.35, 1.0])
def test_payload_is_found_in_the_motor_torques(payload: float) -> None:
    columns = recorded(payload)
    measured = joint_torque(columns)
    joints = [
        np.column_stack([columns[f"plant.joint[{i}].{name}"] for i in (1, 2, 3)])
        for name in ("position", "velocity", "acceleration")
    ]
    points = np.column_stack([columns[f"plant.tcp.position.{axis}"] for axis in "xyz"])
    robot = {
        v.name.removeprefix("robot."): float(v.start or 0.0)
        for v in variable_table("plant").of("parameter")
        if v.name.startswith("robot.")
    }
    empty, loaded = PinocchioDelta(robot, 0.0), PinocchioDelta(robot, 1.0)
    without, per_kg = [], []
    for k in range(0, len(points), EVERY):
        theta, rate, acceleration = (values[k] for values in joints)
        q = empty.configuration(theta, points[k])
        v = empty.velocity(q, rate)
        without.append(empty.inverse(q, v, acceleration))
        per_kg.append(loaded.inverse(q, v, acceleration) - without[-1])
    # torque = torque without payload + payload * torque per kg: linear in what is looked for
    regressor, left = np.concatenate(per_kg), (measured[::EVERY] - np.array(without)).ravel()
    found = float(regressor @ left / (regressor @ regressor))
    assert found == pytest.approx(payload, rel=0.01, abs=0.001)
