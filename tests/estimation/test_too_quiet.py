"""A residual well below the sensors' noise is said to be a fault."""

from __future__ import annotations

import dataclasses

import numpy as np

from elid_cli.estimation.identify import identify
from elid_cli.estimation.validation.too_quiet import too_quiet
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import log, random_arm

ARM = random_arm(np.random.default_rng(3), 2)


def test_a_residual_below_its_noise_is_a_fault_and_a_usual_one_is_not() -> None:
    robot = ARM.described()
    found = identify(robot, prepare(log(ARM, 3), robot))
    assert too_quiet(found, found.noise) == ()
    assert not any("would leave" in warning for warning in found.warnings)
    low = [dataclasses.replace(item, ratio=0.4 if item.rows == "sum" else item.ratio) for item in found.noise]
    said = too_quiet(found, low)
    assert [sentence.split(":")[0] for sentence in said] == ["joint1", "joint2"]
    assert all("whole joint is 0.4" in sentence for sentence in said)


def test_a_few_instants_say_nothing() -> None:
    robot = ARM.described()
    found = identify(robot, prepare(log(ARM, 3), robot))
    few = dataclasses.replace(found, settings={**found.settings, "instants": 40})
    assert too_quiet(few, [dataclasses.replace(item, ratio=0.4) for item in found.noise]) == ()
