"""The rate of the model's torques with one joint's motion, against the regressor's own rows a moment apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.model.effects.library.position_delay import PositionDelay
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

DT, MOMENT = 1e-3, 1e-5
GEARED = read_robot("planar2")
PLAIN = replace(GEARED, joints=tuple(replace(joint, gear_ratio=None, motor_axis=None) for joint in GEARED.joints))


def swung(late: float, joint: int) -> Motion:
    """Return smooth motion of two joints, one of them read `late` seconds later."""
    t = np.tile(DT * np.arange(800)[:, None], (1, 2))
    t[:, joint] += late
    rate, size = np.array([5.0, 8.0]), np.array([0.7, 0.4])
    q, theta = size * np.sin(rate * t), size * np.sin(rate * t + 0.01)
    dq, dtheta = size * rate * np.cos(rate * t), size * rate * np.cos(rate * t + 0.01)
    return Motion(DT * np.arange(800), q, dq, -(rate**2) * q, theta, dtheta, -(rate**2) * theta)


@pytest.mark.parametrize("robot", [GEARED, PLAIN], ids=["geared", "gears unknown"])
@pytest.mark.parametrize("joint", [0, 1])
def test_columns_are_the_rate_of_the_models_torques(robot: Robot, joint: int) -> None:
    model = Regressor(robot)
    parameters = np.array([1.0 + 0.1 * k if p.kind != "fs" else 0.0 for k, p in enumerate(model.names)])
    stiffness = np.array([parameters[model.names.index(p)] for p in model.names if p.kind == "K"])
    still = swung(0.0, joint)
    nothing = np.zeros_like(still.q)
    scene = Scene(robot, still, DT, nothing, nothing, nothing, parameters, 0.8, stiffness)
    columns = PositionDelay(joint, ()).columns(scene)
    before, after = (model.dense(swung(m, joint), model.equations) @ parameters for m in (-MOMENT, MOMENT))
    for plan, rate in zip(model.equations.rows, (after - before) / (2 * MOMENT), strict=True):
        found = columns.get(EquationRow(plan.row.kind, plan.row.joint), np.zeros((1, 800)))[0]
        inner = slice(5, -5)
        assert np.abs(found - rate)[inner].max() < 2e-3 * max(np.abs(rate).max(), 1.0), plan.row
