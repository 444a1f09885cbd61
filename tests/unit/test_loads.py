"""Loads of both motion laws against figures that were worked out apart from this code, on the nominal clock, to 1 %."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from deltaph.kernel import ffi, lib
from deltaph.plan import Plan
from deltaph.robot import Robot
from deltaph.scenario import load_scenario

Vector = NDArray[np.float64]

SCENARIOS = Path(__file__).parents[2] / "scenarios"
POINTS = 4001  # the figures are rounded to 0.1 to 0.5 %


@dataclass(frozen=True)
class Figures:
    """Axis 1, then axes 2 and 3: torque peak and rms, torque peak without rotor and gear [N m], power extremes [W], work [J]."""

    peak: tuple[float, float]
    rms: tuple[float, float]
    bare_peak: tuple[float, float]
    power_most: tuple[float, float]
    power_least: tuple[float, float]
    work: tuple[float, float]
    rod_force: float


FIGURES = {
    ("paper", 0.0): Figures((54.8, 49.7), (17.6, 14.1), (37.4, 33.3), (67, 96), (-113, -65), (5.6, 1.3), 59),
    ("paper", 1.0): Figures((76.4, 67.6), (26.5, 19.6), (59.0, 51.1), (111, 131), (-157, -82), (9.2, 1.9), 132),
    ("comparison", 0.0): Figures((32.3, 27.7), (15.5, 12.2), (21.5, 19.2), (64, 53), (-63, -42), (5.5, 1.6), 38),
    ("comparison", 1.0): Figures((47.5, 37.8), (23.4, 17.1), (35.9, 29.3), (105, 73), (-88, -59), (8.9, 2.2), 85),
}
CASES = pytest.mark.parametrize(("law", "payload"), FIGURES, ids=[f"{law}, {payload:g} kg" for law, payload in FIGURES])


@cache
def loads(law: str, payload: float, *, rotor: bool) -> tuple[Vector, Vector, Vector, float]:
    """Joint velocities, torques and rod forces (n, 3) along a plan on its nominal clock, and its duration [s]."""
    scenario = load_scenario(SCENARIOS / f"{law}.toml")
    plan = Plan.of(scenario)
    robot = scenario.robot if rotor else Robot.default(drive_inertia=0.0)
    factor = plan.speed_factor
    setpoints = plan.sample(np.linspace(0.0, plan.duration, POINTS))
    velocity = setpoints["joint_velocity"] / factor
    torque, force = np.empty((POINTS, 3)), np.empty((POINTS, 3))
    for k, s in enumerate(setpoints):
        motion = ffi.new(
            "dph_motion *",
            {
                "theta": list(s["joint_position"]),
                "theta_d": list(velocity[k]),
                "theta_dd": list(s["joint_acceleration"] / factor**2),
                "point": list(s["tcp_position"]),
                "point_d": list(s["tcp_velocity"] / factor),
                "point_dd": list(s["tcp_acceleration"] / factor**2),
            },
        )
        lib.dph_inverse_dynamics(robot.struct, payload, motion)
        torque[k] = list(motion.torque)
        force[k] = np.array(list(getattr(motion, "lambda"))) * robot.parameters["robot.forearm_length"]
    return velocity, torque, force, plan.nominal_duration


def close(found: Vector, figures: tuple[float, float], rounding: float) -> None:
    """Axes 1 and 2 as figured, and axis 3 as axis 2."""
    assert found[2] == pytest.approx(found[1], rel=1e-9)
    assert found[:2] == pytest.approx(figures, rel=0.01, abs=rounding)


@CASES
def test_torques(law: str, payload: float) -> None:
    figures = FIGURES[law, payload]
    _, torque, force, _ = loads(law, payload, rotor=True)
    close(np.abs(torque).max(axis=0), figures.peak, 0.0)
    close(np.sqrt((torque**2).mean(axis=0)), figures.rms, 0.0)
    close(np.abs(loads(law, payload, rotor=False)[1]).max(axis=0), figures.bare_peak, 0.0)
    assert np.abs(force).max() == pytest.approx(figures.rod_force, rel=0.01)


@CASES
def test_power_and_work(law: str, payload: float) -> None:
    figures = FIGURES[law, payload]
    velocity, torque, _, duration = loads(law, payload, rotor=True)
    power = velocity * torque
    close(power.max(axis=0), figures.power_most, 0.5)  # given without decimals
    close(power.min(axis=0), figures.power_least, 0.5)
    close(np.maximum(power, 0.0).mean(axis=0) * duration, figures.work, 0.05)
