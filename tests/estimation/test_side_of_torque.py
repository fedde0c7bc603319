"""A torque that is of the other side of the gear is told by motor inertias that are off by the gear ratio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli import identify, prepare, read_recording, read_robot
from elid_cli.report.answers.summary import POOR, light
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from tests.system.reproduce.inverse_logs import Laws, log_of, make, recorded


@pytest.fixture(scope="module")
def robot() -> Robot:
    return read_robot("planar2")


@pytest.fixture(scope="module")
def log(robot: Robot) -> Recording:
    return read_recording(["sample_logs/planar2.csv"], robot)


def warnings(robot: Robot, log: Recording, factor: np.ndarray) -> str:
    return " ".join(identify(robot, prepare(replace(log, tau=log.tau * factor), robot)).warnings)


def test_the_side_of_a_torque_is_told_by_the_motor_inertias() -> None:
    made = make(523, 2, rate=250.0, duration=10.0)
    log = recorded(made, log_of(made, Laws()), db=90.0, counts=0.0, torque=0.002, colour=0.0, seed=1)
    robot, gears = made.truth, np.array([abs(float(joint.gear_ratio or 1.0)) for joint in made.truth.joints])
    assert np.all(gears > 10)
    said = "the motor inertia of j1 and j2 is that of the robot file"
    assert "gear ratio" not in warnings(robot, log, np.ones(2))
    assert f"{said} divided by the gear ratio" in warnings(robot, log, 1 / gears)
    assert "map tau with side: motor" in warnings(robot, log, 1 / gears)
    assert f"{said} times the gear ratio" in warnings(robot, log, gears)
    assert "gear ratio" not in warnings(robot, log, np.array([1.0, 1 / gears[1]]))
    assert "gear ratio" not in warnings(robot, log, np.full(2, 0.5))


def test_a_motors_equation_that_is_far_off_makes_a_prediction_poor(robot: Robot, log: Recording) -> None:
    error = identify(robot, prepare(log, robot)).error["joint1"]
    assert light(error).text == "good"
    off = replace(error, spring_rms=1.1 * error.torque_rms)
    assert light(off).text == POOR
    assert light(replace(off, spring_floor=off.spring_rms)).text == "good", "noise of the deflection is no error"
