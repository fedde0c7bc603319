"""A stiffness by both regressions of its row: effects are no torque that the spring passes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.identify import identify
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import random_arm


@pytest.mark.parametrize("known", [True, False])
def test_a_limit_that_cuts_what_is_commanded_leaves_the_stiffness(known: bool) -> None:
    """The excess counted as torque of the spring: it was up to twice as stiff, or taken from the file's inertias."""
    robot = random_arm(np.random.default_rng(2), 2).described()
    options = SimulationOptions(
        duration=10.0, seed=2, rate=500.0, sensors=SensorOptions(noise_db=80, torque_noise_relative=0.003)
    )
    limit = float(np.quantile(np.abs(simulate(robot, options).tau[:, 1]), 0.85))
    weak = replace(robot, effects=(EffectSpec("saturation", robot.joint_names[1], {"limit": limit}),))
    log = simulate(weak, options)
    if not known:
        weak = replace(weak, joints=tuple(replace(joint, parameters={}) for joint in weak.joints))
    (item,) = (item for item in identify(weak, prepare(log, weak)).parameters if item.name == "K2")
    assert (item.verdict, item.reason) == ("supported", "")
    assert item.std_error < 0.01 * item.estimate
    assert abs(item.estimate - robot.joints[1].parameters["K"]) < 4 * item.std_error
