"""Dry friction of a motor holds a joint at rest, whatever effect it is."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli import read_robot
from elid_cli.estimation.trajectory.acting import acting
from elid_cli.model.coordinates import coordinates_of
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.scene import Scene
from elid_cli.signals.motion import Motion

HOLDING = sorted(name for name, kind in effect_classes().items() if kind.holds())


def test_only_what_acts_in_the_motor_holds() -> None:
    assert {"stribeck", "load_friction", "servo_friction", "asymmetric_coulomb"} <= set(HOLDING)
    assert "link_coulomb" not in HOLDING
    assert "torque_ripple" not in HOLDING


@pytest.mark.parametrize("name", HOLDING)
def test_friction_of_a_joint_that_stopped_is_a_grip_and_no_push(name: str) -> None:
    """A joint came forwards and rests: what holds it is the friction at no speed, in no direction."""
    robot, kind = read_robot("planar2"), effect_classes()[name]
    count = 40
    speed = np.zeros((count, 2))
    speed[: count // 2] = 0.5
    q = np.cumsum(speed, axis=0) * 0.01
    still, load = np.zeros_like(q), np.full_like(q, -3.0)  # the load drives the motor
    motion = Motion(0.01 * np.arange(count), q, speed, still, q, speed, still)
    scene = Scene(
        robot, motion, 0.01, load, load, load, np.nan_to_num(robot.reference()), count * 0.01, np.full(2, np.nan)
    )
    linear, shape = kind.coefficients(scene, 0, kind.example)
    push, grip = acting([kind(0, shape)], scene).total(np.asarray(linear))
    assert not push.any()
    motor = coordinates_of(robot).motors[0]
    assert not np.delete(grip, motor, axis=1).any()
    moving, resting = grip[count // 2 - 1, motor], grip[-1, motor]
    assert np.sign(resting) == np.sign(moving) != 0
    assert np.ptp(grip[count // 2 :, motor]) == pytest.approx(0.0, abs=1e-12)
