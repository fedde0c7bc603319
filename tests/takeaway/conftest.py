"""Simulated logs that the tests of this folder share."""

from __future__ import annotations

import pytest

from elid_cli.estimation.identify import Identification, identify
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare


@pytest.fixture(scope="session")
def planar() -> Robot:
    return read_robot("planar2")


@pytest.fixture(scope="session")
def clean(planar: Robot) -> Recording:
    return simulate(planar, SimulationOptions(duration=8.0, rate=500.0, seed=3))


@pytest.fixture(scope="session")
def noisy(planar: Robot) -> Recording:
    sensors = SensorOptions(position_noise=3e-5, torque_noise_relative=0.03)
    return simulate(planar, SimulationOptions(duration=8.0, rate=500.0, seed=1, sensors=sensors))


@pytest.fixture(scope="session")
def found(planar: Robot, noisy: Recording) -> Identification:
    return identify(planar, prepare(noisy, planar))
