"""Velocities without any noise beside noisy positions, as simulators log them: errors still hold the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.identify import identify
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import DENSE, Sensors, log, motion, random_arm


@pytest.mark.parametrize("seed", [0, 2])
def test_exact_velocities_make_no_parameter_surer_than_it_is(seed: int) -> None:
    arm = random_arm(np.random.default_rng(3000 + seed), 2)
    recording = log(arm, seed=seed, sensors=Sensors(bits=None, noise=3e-4))
    world = motion(arm, seed, 20.0, 1000.0)
    robot = arm.described()
    found = identify(robot, prepare(replace(recording, dq=world.dq[::DENSE], dtheta=world.dtheta[::DENSE]), robot))
    supported = [item for item in found.parameters if item.verdict == "supported"]
    assert len(supported) == found.base.count
    # 12.6 and 15.6 standard errors before velocities were given a least noise
    assert max(abs(item.estimate - item.reference) / item.std_error for item in supported) < 4.0
