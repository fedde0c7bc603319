"""A residual well below the sensors' noise is said to be a fault."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from elid_cli.estimation.identify import identify
from elid_cli.estimation.validation.too_quiet import too_quiet
from elid_cli.signals.signals import prepare
from tests.estimation.test_unsaid_causes import identified, made_rigid
from tests.system.plain_arms import log, random_arm
from tests.system.reproduce.inverse_logs import Laws, World

ARM = random_arm(np.random.default_rng(3), 2)


def test_a_residual_below_its_noise_is_a_fault_and_a_usual_one_is_not() -> None:
    robot = ARM.described()
    found = identify(robot, prepare(log(ARM, 3), robot))
    assert too_quiet(found, found.noise) == ()
    assert not any("would leave" in warning for warning in found.warnings)
    low = [dataclasses.replace(item, ratio=0.4 if item.rows == "sum" else item.ratio) for item in found.noise]
    said = too_quiet(found, low)
    assert len(said) == 1
    assert said[0].startswith("joint1 and joint2: the residual of the whole joint is 0.4 and 0.4 of what")


def test_a_few_instants_say_nothing() -> None:
    robot = ARM.described()
    found = identify(robot, prepare(log(ARM, 3), robot))
    few = dataclasses.replace(found, settings={**found.settings, "instants": 40})
    assert too_quiet(few, [dataclasses.replace(item, ratio=0.4) for item in found.noise]) == ()


def _chattering(torque: float) -> Laws:
    """Return an arm whose drives chatter above the motion's frequencies, with a torque that repeats with the angle."""

    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        for k in range(signals["tau"].shape[1]):
            white = np.random.default_rng(k).normal(size=len(signals["tau"]) + 2)
            signals["tau"][:, k] += 0.5 * np.diff(white, 2)
            signals["tau"][:, k] += torque * np.sin(9.0 * signals["q"][:, k])

    return Laws(sensors=[read])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_torque_that_chatters_hides_nothing_that_follows_the_motion(seed: int) -> None:
    made = made_rigid(seed)
    clean, lacking = (identified(made, made.robot, _chattering(size), torque=1e-4, seed=1) for size in (0.0, 0.2))
    assert all(item.ratio < 0.5 for item in clean.noise)
    assert clean.model == "sufficient"
    assert lacking.model == "insufficient"
    assert all(error.floor is None for error in clean.error.values())  # not known: no light may be green by it
