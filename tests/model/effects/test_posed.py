"""A pose that adds up: angles come round, ways do not."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.model.effects import effect_that
from elid_cli.model.effects.posed import Pose


def test_a_zero_of_a_turning_joint_comes_round_and_one_of_a_sliding_joint_does_not() -> None:
    kind = effect_that(moves_zero=True)
    pose = Pose(np.zeros(2), np.zeros(2), (True, False))
    for joint in (0, 1):
        for _ in range(2):
            pose = pose.moved(kind(joint), np.array([2.0]))
    assert pose.zeros == pytest.approx([4.0 - 2.0 * np.pi, 4.0])
    for joint in (0, 1):
        pose = pose.without(kind(joint))
    assert not pose
