"""Transmissions that yield, of an arm whose file has them rigid and whose log has the motors alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.experiment.simulation import ControlOptions, SensorOptions, SimulationOptions, simulate
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.signals import prepare
from tests.model.effects.effect_scenes import rigid

NAME = "transmission_compliance"
STIFFNESS = (12000.0, 4000.0)


def arm(scale: float) -> Robot:
    """Return two links that swing in gravity; with a scale of 1 under load some mrad behind their motors."""
    first = {"m": 6.0, "cx": -0.8, "cy": 0.1, "cz": 0.05, "Ixx": 0.1, "Iyy": 0.4, "Izz": 0.35, "Ixy": 0.01,
             "Ixz": -0.02, "Iyz": 0.015, "Jm": 5e-5, "fs": 2.5, "fv": 3.0}  # fmt: skip
    second = {"m": 3.0, "cx": -0.5, "cy": 0.05, "cz": 0.02, "Ixx": 0.02, "Iyy": 0.12, "Izz": 0.12, "Ixy": 0.004,
              "Ixz": 0.003, "Iyz": -0.002, "Jm": 4e-5, "fs": 1.2, "fv": 1.5}  # fmt: skip
    joints = [
        Joint(f"j{k + 1}", a=0.4, alpha=alpha, gear_ratio=80.0, parameters={**body, "K": scale * K})
        for k, (body, alpha, K) in enumerate(zip((first, second), (0.6, 0.0), STIFFNESS, strict=True))
    ]
    return Robot(name="arm", gravity=(0.0, -9.81, 0.0), joints=tuple(joints))


def told(scale: float, seed: int, *, only: tuple[str, ...] = ()) -> Diagnosis:
    """Return the diagnosis of a log of the motors; of the robot, geometry and rotors are known."""
    elastic = arm(scale)
    sensors = SensorOptions(position_noise=2e-6, torque_noise_relative=0.002)
    options = SimulationOptions(
        duration=10.0, rate=500.0, seed=seed, sensors=sensors, control=ControlOptions(continuous=True)
    )
    log = simulate(elastic, options)
    log = replace(log, q=np.full_like(log.q, np.nan))
    plain = rigid(elastic)
    known = [replace(joint, parameters={"Jm": joint.parameters["Jm"]}) for joint in plain.joints]
    robot = replace(plain, joints=tuple(known))
    found = diagnose(robot, prepare(log, robot), DiagnoseOptions(only=only))
    assert isinstance(found, Diagnosis)
    return found


@pytest.mark.parametrize("seed", [1, 2])
def test_it_is_named_at_all_joints_with_the_right_stiffness(seed: int) -> None:
    found = told(1.0, seed)
    assert {(effect.effect, effect.joint) for effect in found.effects} == {(NAME, "j1"), (NAME, "j2")}
    assert not found.unexplained
    for effect in found.effects:
        value, error = effect.parameters["compliance"], effect.std_error["compliance"]
        true = 1.0 / STIFFNESS[int(effect.joint[1]) - 1]  # type: ignore[index]
        assert abs(value - true) < 4 * error
        assert error < 0.3 * true


@pytest.mark.parametrize("seed", [1, 2])
def test_stiff_transmissions_are_not(seed: int) -> None:
    found = told(100.0, seed)
    assert not found.effects
    assert not found.unexplained
