"""Transmissions that yield, of an arm whose log has the motors alone and whose file has them rigid, or no stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from elid_cli import identified_robot
from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.estimation.identify import identify
from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.simulation import ControlOptions, SensorOptions, SimulationOptions, simulate
from elid_cli.robot.robot import EffectSpec, Joint, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import DEFAULT_CUTOFF, prepare
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


def logged(scale: float, seed: int) -> tuple[Robot, Recording]:
    """Return the robot as its file has it, with known geometry and rotors, and a log of its motors."""
    elastic = arm(scale)
    sensors = SensorOptions(position_noise=2e-6, torque_noise_relative=0.002)
    options = SimulationOptions(
        duration=10.0, rate=500.0, seed=seed, sensors=sensors, control=ControlOptions(continuous=True)
    )
    log = simulate(elastic, options)
    log = replace(log, q=np.full_like(log.q, np.nan))
    plain = rigid(elastic)
    known = [replace(joint, parameters={"Jm": joint.parameters["Jm"]}) for joint in plain.joints]
    return replace(plain, joints=tuple(known)), log


def told(scale: float, seed: int, transmission: str = "rigid") -> Diagnosis:
    robot, log = logged(scale, seed)
    robot = replace(robot, joints=tuple(replace(joint, transmission=transmission) for joint in robot.joints))
    found = diagnose(robot, prepare(log, robot))
    assert isinstance(found, Diagnosis)
    return found


def right(joint: str | None, parameters: Mapping[str, float], errors: Mapping[str, float]) -> bool:
    true = 1.0 / STIFFNESS[int(str(joint)[1]) - 1]
    return abs(parameters["compliance"] - true) < 4 * errors["compliance"] < 1.2 * true


@pytest.mark.parametrize("transmission", ["rigid", "elastic"])
def test_it_is_named_at_all_joints_with_the_right_stiffness(transmission: str) -> None:
    found = told(1.0, 1, transmission)
    assert {(effect.effect, effect.joint) for effect in found.effects} == {(NAME, "j1"), (NAME, "j2")}
    assert not found.unexplained
    assert all(right(effect.joint, effect.parameters, effect.std_error) for effect in found.effects)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_declared_one_is_fitted_where_its_form_holds(seed: int) -> None:
    robot, log = logged(1.0, seed)
    declared = replace(robot, effects=tuple(EffectSpec(NAME, joint, {}) for joint in robot.joint_names))
    found, usual = (identify(one, prepare(log, one)) for one in (declared, robot))
    assert found.settings["cutoff"] < DEFAULT_CUTOFF
    assert all(right(effect.joint, effect.parameters, effect.std_error) for effect in found.effects)
    said = [validate(one, prepare(log, one)) for one in (identified_robot(found), identified_robot(usual))]
    assert said[0].settings["cutoff"] < DEFAULT_CUTOFF
    right_now, before = (max(error.relative for error in one.error.values()) for one in said)
    assert right_now < min(0.01, before)
    assert max(row.ratio or 0.0 for row in found.noise) < 1.3 < max(row.ratio or 0.0 for row in usual.noise)


def test_stiff_transmissions_are_not() -> None:
    found = told(100.0, 2)
    assert not found.effects
    assert not found.unexplained
