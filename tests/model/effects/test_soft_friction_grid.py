"""Speeds of soft friction that a log is searched for: only such as reversals take several samples to pass."""

from __future__ import annotations

from dataclasses import replace

from elid_cli.model.effects.gradual_friction import SAMPLES
from elid_cli.model.effects.library.soft_friction import SoftFriction
from tests.model.effects.effect_scenes import planar, scene_of


def test_the_slower_a_log_is_sampled_the_fewer_speeds_are_tried() -> None:
    scene = scene_of(planar())
    speeds = {dt: [shape[0] for shape in SoftFriction.grid(replace(scene, dt=dt), 0)] for dt in (1e-4, 1e-2, 10.0)}
    assert len(speeds[1e-4]) == 4
    assert 0 < len(speeds[1e-2]) < 4
    assert speeds[10.0] == []
    assert SAMPLES > 1
    assert min(speeds[1e-2]) > min(speeds[1e-4])
