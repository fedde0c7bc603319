"""Torques that the model does not predict at all are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimation.identify import identify
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.validation.unpredicted import unpredicted
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import log, random_arm


def test_swapped_torques_of_rigid_joints_are_told_and_right_ones_are_not() -> None:
    arm = random_arm(np.random.default_rng(1), 3, (0, 1, 2))
    robot, right = arm.described(), log(arm, 1, 10.0)
    swapped = replace(right, tau=right.tau[:, [0, 2, 1]])
    for recording, told in ((right, False), (swapped, True)):
        said = [w for w in identify(robot, prepare(recording, robot)).warnings if "not predicted at all" in w]
        assert bool(said) == told
    assert "joint3" in said[0]
    assert "swapped" in said[0]


def test_a_torque_that_is_noise_alone_is_none() -> None:
    def error(relative: float, floor: float | None) -> JointError:
        return JointError(relative, relative, None, None, 1.0, floor)

    assert unpredicted({"a": error(1.0, 0.8)}) == ()
    assert unpredicted({"a": error(0.5, None), "c": error(1.0, None)}) == ()
    assert "b" in unpredicted({"a": error(0.5, None), "b": error(1.2, 0.01)})[0]
