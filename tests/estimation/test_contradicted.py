"""Values that equations which lack something bend, and others contradict, are marked: all that are far off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.estimation.identify import Identification, identify
from elid_cli.experiment.simulation import ControlOptions, SensorOptions, SimulationOptions, simulate
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

NONE = dict.fromkeys(("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"), 0.0)
FAR = 4.0
"""Standard errors."""


@pytest.fixture(scope="module")
def robot() -> Robot:
    """Return three links on elastic joints that swing in gravity."""
    bodies = [
        {"m": 6.0, "cx": -0.8, "cy": 0.1, "cz": 0.05, "Ixx": 0.1, "Iyy": 0.4, "Izz": 0.35, "Iyz": 0.015},
        {"m": 3.0, "cx": -0.5, "cy": 0.05, "cz": 0.02, "Ixx": 0.02, "Iyy": 0.12, "Izz": 0.12, "Ixy": 0.004},
        {"m": 1.5, "cx": -0.2, "cy": 0.02, "cz": 0.02, "Ixx": 0.01, "Iyy": 0.04, "Izz": 0.04, "Ixz": 0.003},
    ]
    drives = [
        {"Jm": 5e-5, "fs": 2.5, "fv": 3.0, "K": 9000.0},
        {"Jm": 4e-5, "fs": 1.2, "fv": 1.5, "K": 4000.0},
        {"Jm": 2e-5, "fs": 0.6, "fv": 0.8, "K": 1500.0},
    ]
    joints = [
        Joint(f"j{k + 1}", a=0.4, alpha=alpha, gear_ratio=80.0, parameters={**NONE, **body, **drive})
        for k, (body, drive, alpha) in enumerate(zip(bodies, drives, (1.2, 0.3, 0.0), strict=True))
    ]
    return Robot(name="arm", gravity=(0.0, -9.81, 0.0), joints=tuple(joints))


@pytest.fixture(scope="module")
def log(robot: Robot) -> Recording:
    sensors = SensorOptions(position_noise=2e-6, torque_noise_relative=0.001)
    control = ControlOptions(continuous=True)
    return simulate(robot, SimulationOptions(duration=6.0, rate=500.0, seed=4, sensors=sensors, control=control))


def scaled(values: Array, joint: int, factor: float) -> Array:
    return values * np.where(np.arange(values.shape[1]) == joint, factor, 1.0)


def gained(log: Recording) -> Recording:
    """Return the log with the torque of one joint too large."""
    return replace(log, tau=scaled(log.tau, 1, 1.15))


def geared(log: Recording) -> Recording:
    """Return the log with a gear ratio of one joint that is off."""
    return replace(log, theta=scaled(log.theta, 2, 0.97))


def errors(found: Identification, robot: Robot) -> Array:
    """Return by how many of its standard errors each base parameter is off, (b,)."""
    true = found.base.transform @ np.nan_to_num(robot.reference())
    values, deviations = (np.array([getattr(p, key) for p in found.parameters]) for key in ("estimate", "std_error"))
    return np.abs(np.asarray((values - true) / deviations))


@pytest.mark.parametrize("fault", [gained, geared])
def test_all_that_a_fault_bends_is_marked(
    fault: Callable[[Recording], Recording], robot: Robot, log: Recording
) -> None:
    wrong = fault(log)
    found = identify(robot, prepare(wrong, robot))
    assert found.model == "insufficient"
    off = errors(found, robot)
    far = {item.name for item, error in zip(found.parameters, off, strict=True) if error > FAR}
    marked = {item.name for item in found.parameters if item.bias_possible}
    assert far
    assert far <= marked
    assert len(marked) < len(found.parameters)


def test_nothing_is_marked_without_one(robot: Robot, log: Recording) -> None:
    found = identify(robot, prepare(log, robot))
    assert max(errors(found, robot)) < FAR
    assert not any(item.bias_possible for item in found.parameters)


def test_a_joint_that_is_hardly_predicted_has_no_value_to_trust(robot: Robot, log: Recording) -> None:
    drag = np.zeros_like(log.tau)
    drag[:, 1] = 2.0 * log.tau[:, 1].std() * np.tanh(10.0 * np.gradient(log.q[:, 1], log.dt)) ** 3
    wrong = replace(log, tau=log.tau + drag)
    found = identify(robot, prepare(wrong, robot))
    assert found.error["j2"].relative > 0.1
    assert all(item.bias_possible for item in found.parameters if item.leader.joint == 1)
    assert not all(item.bias_possible for item in found.parameters)
