"""An effect is claimed only by motion that covers it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.scene import Scene

TURN = 2 * np.pi


def moved(plain: Scene, angle: np.ndarray, speed: np.ndarray) -> Scene:
    """Return a scene in which the first joint moves so."""
    theta, dtheta = np.zeros((2, len(angle), plain.robot.n))
    theta[:, 0], dtheta[:, 0] = angle, speed
    return dataclasses.replace(plain, motion=dataclasses.replace(plain.motion, theta=theta, dtheta=dtheta), cache={})


def waves(plain: Scene, span: float, passes: int) -> Scene:
    """Return a scene that passes an angle back and forth."""
    phase = np.linspace(0.0, np.pi * passes, 4000)
    return moved(plain, -0.5 * span * np.cos(phase), 0.5 * span * np.sin(phase))


def orders(scene: Scene, name: str = "torque_ripple") -> list[float]:
    return [shape[0] for shape in effect_classes()[name].grid(scene, 0)]


def test_no_order_of_many_periods_is_tried_on_a_part_of_a_turn_that_is_passed_twice(planar_scene: Scene) -> None:
    assert max(orders(waves(planar_scene, TURN / 3, 2))) <= 30
    assert max(orders(waves(planar_scene, TURN / 3, 6))) > 100  # each pass shows that they are of the angle
    assert max(orders(waves(planar_scene, TURN, 6))) > 49
    assert min(orders(waves(planar_scene, TURN / 3, 6))) >= 3


@pytest.mark.parametrize(("order", "passes", "possible"), [(6.0, 6, True), (2.0, 6, False), (6.0, 1, False)])
def test_a_ripple_needs_a_period_and_more_than_one_pass(
    planar_scene: Scene, order: float, passes: int, possible: bool
) -> None:
    values = {"amplitude": 1.0, "phase": 0.0, "order": order}
    assert effect_classes()["torque_ripple"].plausible(waves(planar_scene, TURN / 3, passes), 0, values) == possible


def test_friction_at_low_speed_needs_slow_passes(planar_scene: Scene) -> None:
    values = {"amplitude": 1.0, "velocity": 0.1, "exponent": 1.0}
    kind = effect_classes()["stribeck"]
    assert kind.plausible(waves(planar_scene, TURN / 3, 6), 0, values)
    speed = 1.0 + 0.5 * np.sin(np.linspace(0.0, 30.0, 4000))
    assert not kind.plausible(moved(planar_scene, np.cumsum(speed) * 1e-3, speed), 0, values)
