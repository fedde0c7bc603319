"""The load of a rigid joint, from any representative of the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import log, random_arm


def test_the_load_does_not_hold_a_rotor_that_shows_only_in_sums() -> None:
    arm = random_arm(np.random.default_rng(3), 2, (0, 1))
    described = arm.described()
    # without gear ratios the rotors' inertias are those at the joints, and add to the bodies'
    joints = []
    for k, joint in enumerate(described.joints):
        values = {name: value for name, value in joint.parameters.items() if name != "Jm"}
        values["Ja"] = float(arm.rotor[k] * arm.gear[k] ** 2)
        joints.append(replace(joint, gear_ratio=None, parameters=values))
    robot = replace(described, joints=tuple(joints))
    signals = prepare(log(arm, 3, 6.0), robot)
    model = Regressor(robot)
    base, reference = find_base(model), np.nan_to_num(robot.reference())
    combined = [k for k in (0, 1) if base.classes[StandardParameter("Ja", k)] == "combined"]
    assert combined
    basic = np.zeros_like(reference)
    basic[base.leaders] = base.transform @ reference
    usual, other = (scene_of(model, signals, values) for values in (reference, basic))
    assert not np.allclose(reference, basic)
    assert other.predicted == pytest.approx(usual.predicted, abs=1e-8 * np.abs(usual.predicted).max())
    # what passes the transmission is what the bodies need: without rotor and friction
    assert other.load == pytest.approx(usual.load, abs=1e-8 * np.abs(usual.load).max())
    rotor = reference[[model.index[StandardParameter("Ja", k)] for k in (0, 1)]]
    fs, fv = (reference[[model.index[StandardParameter(kind, k)] for k in (0, 1)]] for kind in ("fs", "fv"))
    directions = np.stack([usual.direction(k) for k in (0, 1)], axis=1)
    own = rotor * usual.motion.ddtheta + fv * usual.motion.dtheta + fs * directions
    close = np.abs(usual.motion.dtheta) > 0.1  # the sign of friction is not rounded alike at rest
    left = usual.predicted - own - usual.load
    assert np.abs(left[close]).max() < 1e-6 * np.abs(usual.load).max()
