"""Effects whose frequency the filter does not pass."""

from __future__ import annotations

from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.estimation.regression.other_shapes import beyond_filter
from elid_cli.model.effects.declared import declared_effects
from elid_cli.robot.robot import EffectSpec
from tests.model.effects.effect_scenes import planar, scene_of


def test_a_frequency_beyond_the_filter_is_warned_of() -> None:
    robot = planar()
    mode, friction = {"inertia": 0.1, "frequency": 25.0, "damping": 0.02}, {"amplitude": 1.0, "velocity": 0.1}
    specs = EffectSpec("flexible_mode", "joint2", mode), EffectSpec("stribeck", "joint1", friction)
    robot = type(robot)(**{**vars(robot), "effects": specs})
    scene = scene_of(robot)
    effects = FittedEffects(declared_effects(robot, scene), (), scene)
    (said,) = beyond_filter(effects, robot, 20.0)
    assert said.startswith("joint2: flexible_mode came out at 25 Hz, and the filter passes 20 Hz")
    assert not beyond_filter(effects, robot, 30.0)
