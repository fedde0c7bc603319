"""Load-dependent friction in replay, against a plant that shares no code with elid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.experiment.replay.replay import replay
from elid_cli.robot.robot import EffectSpec
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, NAMES, OFFSET, VISCOUS, moved, robot

SHARE = 0.2
"""Part of the torque that the bodies need by which friction grows."""
NOISE = 1e-4


def test_the_load_of_friction_is_what_the_bodies_need_without_the_rotor(tmp_path: Path) -> None:
    """With the rotor's share of the load in it, replay was more than 0.5 mrad off."""
    recording = moved(6, 5.0, noise=NOISE, grip=lambda x, v, load: SHARE * np.abs(load))
    arm = robot(tmp_path)
    values = zip(arm.joints, ARMATURE, COULOMB, VISCOUS, strict=True)
    joints = tuple(replace(j, parameters={**j.parameters, "Ja": a, "fs": c, "fv": v}) for j, a, c, v in values)
    offsets = [EffectSpec("torque_offset", name, {"offset": value}) for name, value in zip(NAMES, OFFSET, strict=True)]
    plain = replace(arm, joints=joints, effects=tuple(offsets))
    loaded = [EffectSpec("load_friction", name, {"coefficient": SHARE}) for name in NAMES]
    off = replay(replace(plain, effects=(*offsets, *loaded)), recording)
    assert not off.left_out
    # nothing but the noise of the encoders, 0.8 of its standard deviation
    assert all(error.mean_abs < 1.2 * NOISE for error in off.error.values())
    assert replay(plain, recording).mean_abs > 2e-3
