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
DIRECTED = [name for name in HOLDING if effect_classes()[name].acts_as == "directed friction"]


def test_only_what_acts_in_the_motor_holds() -> None:
    assert {"stribeck", "load_friction", "servo_friction", "asymmetric_coulomb"} <= set(HOLDING)
    assert "link_coulomb" not in HOLDING
    assert "torque_ripple" not in HOLDING


@pytest.mark.parametrize("name", DIRECTED)
def test_a_joint_rests_between_its_frictions_of_both_directions(name: str) -> None:
    """A joint that came forwards and one that came backwards rest under the same loads."""
    forwards, backwards = (_stopped(name, sign) for sign in (1.0, -1.0))
    for k in (0, -1):
        push, grip = forwards[0][k], forwards[1][k]
        assert push + grip == pytest.approx(forwards[2][0], rel=1e-9)
        assert push - grip == pytest.approx(backwards[2][0], rel=1e-9)
        assert (backwards[0][k], backwards[1][k]) == pytest.approx((push, grip), rel=1e-9)


@pytest.mark.parametrize("name", [name for name in HOLDING if name not in DIRECTED])
def test_friction_of_a_joint_that_stopped_is_a_grip_and_no_push(name: str) -> None:
    """A joint came forwards and rests: what holds it is the friction at no speed, in no direction."""
    push, grip, column = _stopped(name)
    assert not push.any()
    moving, resting = grip[0], grip[-1]
    assert np.sign(resting) == np.sign(moving) != 0
    assert moving == pytest.approx(column[0], rel=1e-9)
    assert np.ptp(grip[len(grip) // 2 :]) == pytest.approx(0.0, abs=1e-12)


def _stopped(name: str, sign: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return push and grip of an effect on a motor that moves and then rests, (N,), and its torque as it moves."""
    robot, kind = read_robot("planar2"), effect_classes()[name]
    count = 40
    speed = np.zeros((count, 2))
    speed[: count // 2] = 0.5 * sign
    q = np.cumsum(speed, axis=0) * 0.01
    still, load = np.zeros_like(q), np.full_like(q, -3.0)  # the load drives the motor
    motion = Motion(0.01 * np.arange(count), q, speed, still, q, speed, still)
    scene = Scene(
        robot, motion, 0.01, load, load, load, np.nan_to_num(robot.reference()), count * 0.01, np.full(2, np.nan)
    )
    linear, shape = kind.coefficients(scene, 0, kind.example)
    push, grip = acting([kind(0, shape)], scene).total(np.asarray(linear))
    motor = coordinates_of(robot).motors[0]
    assert not np.delete(push, motor, axis=1).any()
    assert not np.delete(grip, motor, axis=1).any()
    (column,) = (np.asarray(linear) @ columns for columns in kind(0, shape).columns(scene).values())
    return push[:, motor], grip[:, motor], column
