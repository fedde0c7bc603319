"""What is asked of a robot's structure is answered once, and never for another structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.memory import Recent
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot


def test_the_last_results_are_kept_and_older_ones_made_again() -> None:
    made: list[int] = []

    def make(k: int) -> int:
        made.append(k)
        return 10 * k

    recent: Recent[int] = Recent(2)
    assert [recent.of(k, lambda k=k: make(k)) for k in (1, 2, 1, 3, 1, 2)] == [10, 20, 10, 30, 10, 20]
    assert made == [1, 2, 3, 2]


def test_values_of_parameters_do_not_change_the_rows_but_everything_else_does() -> None:
    robot = read_robot("planar2")
    first, second = robot.joints
    heavier = replace(robot, joints=(replace(first, parameters={**first.parameters, "m": 99.0}), second))
    assert Regressor(robot).estimation is Regressor(heavier).estimation
    assert find_base(Regressor(robot)) is find_base(Regressor(heavier))
    changes = (
        replace(robot, gravity=(0.0, 0.0, -9.81)),
        replace(robot, joints=(replace(first, a=0.7), second)),
        replace(robot, joints=(replace(first, gear_ratio=3.0), second)),
        replace(robot, joints=(replace(first, motor_axis=(1.0, 0.0, 0.0)), second)),
        replace(robot, joints=(replace(first, transmission="rigid"), second)),
        replace(robot, joints=(replace(first, type="prismatic"), second)),
    )
    for other in changes:
        assert Regressor(other).estimation is not Regressor(robot).estimation
        assert Regressor(other).equations is not Regressor(robot).equations
        assert find_base(Regressor(other)) is not find_base(Regressor(robot))


def test_sensors_have_rows_of_their_own() -> None:
    model = Regressor(read_robot("planar2"))
    with_sensor = model.sensed(np.array([True, False]))
    assert with_sensor is not model.estimation
    assert with_sensor is Regressor(read_robot("planar2")).sensed(np.array([True, False]))
