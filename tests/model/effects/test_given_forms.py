"""The form of an effect that a robot file gives, or means by giving none, is the one that is fitted."""

from __future__ import annotations

from dataclasses import replace

import pytest

from elid_cli.model.effects.declared import declared_effects
from elid_cli.model.effects.scene import Scene
from elid_cli.robot.robot import EffectSpec


@pytest.mark.parametrize(
    ("given", "exponent"),
    [
        ({}, 1.0),
        ({"exponent": 1.0}, 1.0),
        ({"exponent": 2.0}, 2.0),
        ({"exponent": 1.5}, 1.5),
        ({"exponent": -1.0}, -1.0),
    ],
)
def test_an_exponent_is_the_one_of_the_file(planar_scene: Scene, given: dict[str, float], exponent: float) -> None:
    spec = EffectSpec("stribeck", planar_scene.robot.joint_names[0], given)
    scene = replace(planar_scene, robot=replace(planar_scene.robot, effects=(spec,)))
    (item,) = declared_effects(scene.robot, scene)
    velocity, form = item.effect.shape
    assert form == exponent
    assert velocity > 0
    assert item.free == (0,)


def test_a_shape_that_the_file_gives_is_where_the_fit_begins(planar_scene: Scene) -> None:
    spec = EffectSpec("stribeck", planar_scene.robot.joint_names[0], {"velocity": 0.0123})
    scene = replace(planar_scene, robot=replace(planar_scene.robot, effects=(spec,)))
    (item,) = declared_effects(scene.robot, scene)
    assert item.effect.shape == (0.0123, 1.0)
