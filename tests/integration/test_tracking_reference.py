"""Drives on a reference that is interpolated for every sample, as a separate simulation had it: its figures within a tenth.

The plant of these tests is stepped by one period of its drives instead of 1 ms, so that the reference comes from outside for every
sample. It arrives 1 ms late, and errors are against the late reference.
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from deltaph.fmu import compile as fmu_compile
from deltaph.fmu import package
from deltaph.fmu.model_description import FmiVersion
from deltaph.importer import plant_values
from deltaph.plan import Plan
from deltaph.scenario import Scenario, parse_scenario, template
from deltaph.slave import Slave
from deltaph.variables import Model, variable_table

FloatArray = NDArray[np.float64]
References = tuple[FloatArray, FloatArray, FloatArray]
Reference = Callable[[Scenario, Plan, FloatArray], References]

PERIOD = 125e-6
PAPER = template()
COMPARISON = PAPER.replace('name = "paper"', 'name = "comparison"')
LOADED = PAPER.replace("mass_kg = 0.0", "mass_kg = 1.0")
STIFF = PAPER.replace(
    'gains = "tuned"', 'gains = "tuned"\nposition_gain_1_s = 200.0\nvelocity_bandwidth_Hz = 200.0\nintegral_time_ms = 5.0'
)


def interpolated(_: Scenario, plan: Plan, time: FloatArray) -> References:
    """Cubic Hermite through positions and velocities at every millisecond; torques by the inverse dynamics, linear between."""
    s = plan.sample(np.arange(plan.duration_ms + 100) * 1e-3)
    i = np.floor(1e3 * time + 1e-9).astype(int)
    u, h = (1e3 * time - i)[:, None], 1e-3
    q0, q1 = s["joint_position"][i], s["joint_position"][i + 1]
    m0, m1 = h * s["joint_velocity"][i], h * s["joint_velocity"][i + 1]
    position = (2 * u**3 - 3 * u**2 + 1) * q0 + (u**3 - 2 * u**2 + u) * m0 + (3 * u**2 - 2 * u**3) * q1 + (u**3 - u**2) * m1
    velocity = ((6 * u**2 - 6 * u) * (q0 - q1) + (3 * u**2 - 4 * u + 1) * m0 + (3 * u**2 - 2 * u) * m1) / h
    torque = s["joint_torque"][i] * (1 - u) + s["joint_torque"][i + 1] * u
    return position, velocity, torque


def inertial(scenario: Scenario, plan: Plan, time: FloatArray) -> References:
    """The same with the nominal inertia's torque alone, N² J_n θ''."""
    position, velocity, _ = interpolated(scenario, plan, time)
    i = np.floor(1e3 * time + 1e-9).astype(int)
    u = (1e3 * time - i)[:, None]
    acceleration = plan.sample(np.arange(plan.duration_ms + 100) * 1e-3)["joint_acceleration"]
    drive = {v.name: v.start for v in variable_table("plant").of("parameter")} | scenario.plant
    inertia = drive["drive.gear_ratio"] ** 2 * drive["drive.nominal_inertia"]
    return position, velocity, inertia * (acceleration[i] * (1 - u) + acceleration[i + 1] * u)


def held(_: Scenario, plan: Plan, time: FloatArray) -> References:
    """The last setpoint, held for a millisecond."""
    s = plan.sample(np.floor(1e3 * time + 1e-9) * 1e-3)
    return s["joint_position"], s["joint_velocity"], s["joint_torque"]


@pytest.fixture(scope="module")
def plant_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[float], Path]:
    """The plant's FMU with its own step made one period of the drives."""
    made: dict[float, Path] = {}
    translation_unit = fmu_compile.translation_unit

    def make(period: float) -> Path:
        if period not in made:

            def changed(model: Model, version: FmiVersion) -> bytes:
                text = translation_unit(model, version)
                for pattern, value in ((rb"(#define MODEL_STEP) \S+", period), (rb"(#define DRIVE_PERIOD) \S+", period)):
                    text, count = re.subn(pattern, rb"\1 " + repr(value).encode(), text)
                    assert count == 1
                text, count = re.subn(rb"SAMPLES_PER_STEP = 8", b"SAMPLES_PER_STEP = 1", text)
                assert count == 1
                return text

            made[period] = tmp_path_factory.mktemp("plant") / "DeltaPlant.fmu"
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(fmu_compile, "translation_unit", changed)
                made[period].write_bytes(package.fmu("plant", 3, "host"))
        return made[period]

    return make


def errors(fmu: Path, folder: Path, text: str, reference: Reference, period: float = PERIOD) -> tuple[float, float]:
    """Largest tracking error of a joint [mrad] and of the tool centre point [mm]."""
    scenario = parse_scenario(text, Path("tracking.toml"))
    plan = Plan.of(scenario)
    time = np.arange(round((plan.duration + 0.05) / period)) * period
    position, velocity, torque = reference(scenario, plan, time)
    with Slave("plant", fmu, folder) as plant:
        inputs = [v.name for v in plant.table.of("input") if v.is_float]
        outputs = [v.group for v in plant.table.of("output") if v.is_float]
        columns = {
            name: [inputs.index(f"joint[{i}].{name}") for i in (1, 2, 3)] for name in ("position_ref", "velocity_ref", "torque_ff")
        }
        joints, tcp = ([k for k, group in enumerate(outputs) if group == name] for name in ("joint_position", "tcp_position"))

        def put(k: int) -> None:
            for name, values in zip(columns, (position, velocity, torque), strict=True):
                plant.inputs[columns[name]] = values[k]
            plant.write()

        plant.set(plant_values(scenario))
        plant.initialize(0.0)
        put(0)
        plant.start()
        plant.read()
        found = []
        for k, t in enumerate(time):
            found.append(plant.outputs[joints + tcp].copy())
            put(k)
            plant.step(t, period)
            plant.read()
    wanted = plan.sample(time)
    goal = wanted["joint_position"] if reference is held else position
    executed = np.array(found)
    return (
        1e3 * float(np.abs(goal - executed[:, :3]).max()),
        1e3 * float(np.linalg.norm(wanted["tcp_position"] - executed[:, 3:], axis=1).max()),
    )


# scenario, reference, errors there [mrad], [mm]
FIGURES: dict[str, tuple[str, Reference, float, float]] = {
    "held for 1 ms": (PAPER, held, 1.92, 1.04),
    "inertia": (PAPER, inertial, 0.45, 0.18),
    "comparison, inertia": (COMPARISON, inertial, 0.27, 0.10),
    "Kp 200, fv 200, Ti 5, inertia": (STIFF, inertial, 0.134, 0.055),
    "1 kg known": (LOADED, interpolated, 0.144, 0.052),
    "tuned": (PAPER, interpolated, 0.124, 0.045),
    "comparison": (COMPARISON, interpolated, 0.086, 0.028),
}


def test_errors_on_an_interpolated_reference(plant_of: Callable[[float], Path], tmp_path: Path) -> None:
    for name, (text, reference, *figures) in FIGURES.items():
        assert errors(plant_of(PERIOD), tmp_path, text, reference) == pytest.approx(figures, rel=0.1), name


def test_errors_at_other_periods_of_the_drives(plant_of: Callable[[float], Path], tmp_path: Path) -> None:
    figures = {62.5e-6: 0.165, 125e-6: 0.181, 250e-6: 0.213, 500e-6: 0.280}
    found = [errors(plant_of(period), tmp_path, PAPER, inertial, period)[1] for period in figures]
    assert found == pytest.approx(list(figures.values()), rel=0.1)
