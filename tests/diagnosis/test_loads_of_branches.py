"""A load that one arm of a tree grips is named at that arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.errors import RobotError
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import resolve
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.robot.random_robots import random_robot

PAYLOAD = effect_classes()["payload"]
GRIPPED = {"m": 0.6, "cx": 0.06, "start": 6.3}


@pytest.fixture(scope="module")
def arms() -> Robot:
    """Return a torso (axis_1) with arms that end at axis_3 and axis_5."""
    return random_robot(3, 5, "urdf", rigid=tuple(range(5)), parents=(-1, 0, 1, 0, 3))


def logged(robot: Robot, at: str | None) -> Recording:
    loaded = replace(robot, effects=(EffectSpec("payload", at, GRIPPED),))
    log = simulate(loaded, SimulationOptions(duration=14.0, rate=250.0, seed=1))
    rng = np.random.default_rng(1)
    tau = log.tau + 0.01 * log.tau.std(axis=0) * rng.normal(size=log.tau.shape)
    q = log.q + 1e-5 * rng.normal(size=log.q.shape)
    return replace(log, tau=tau, q=q, theta=q.copy())


def diagnosed(robot: Robot, log: Recording) -> Diagnosis:
    options = DiagnoseOptions(only=("payload", "contact", "stribeck"))
    return diagnose(robot, prepare(log, robot, SignalOptions.for_diagnosis(log.rate)), options)


@pytest.mark.parametrize("at", ["axis_3", "axis_5"])
def test_a_load_is_found_at_the_arm_that_grips_it(arms: Robot, at: str) -> None:
    found = diagnosed(arms, logged(arms, at))
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("payload", at)
    for name, value in GRIPPED.items():
        assert abs(effect.parameters[name] - value) < 3 * effect.std_error[name]
    assert effect.std_error["m"] < 0.01
    assert [(spec.effect, spec.joint) for spec in found.refined.effects if spec.effect == "payload"] == [
        ("payload", at)
    ]


def test_a_load_of_no_joint_is_at_the_last_body(arms: Robot) -> None:
    unnamed, named = (logged(arms, at) for at in (None, "axis_5"))
    np.testing.assert_array_equal(unnamed.tau, named.tau)


def test_a_load_at_a_body_that_carries_another_is_refused(arms: Robot) -> None:
    with pytest.raises(RobotError, match="does not apply to axis_4"):
        resolve(arms, EffectSpec("payload", "axis_4", GRIPPED))
    assert [k for k in range(arms.n) if PAYLOAD.applies(arms, k)] == [2, 4]


def test_the_only_arm_has_no_need_of_a_name(arms: Robot) -> None:
    alone = replace(arms, joints=arms.joints[:3])
    assert PAYLOAD(2, (1.0,)).joint_name(alone) is None
    assert [PAYLOAD(k, (1.0,)).joint_name(arms) for k in (2, 4)] == ["axis_3", "axis_5"]
