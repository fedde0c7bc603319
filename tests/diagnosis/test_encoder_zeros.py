"""Zeros of encoders that are off, by little and by a quarter of a turn, in logs with torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, laws_of, log_of, make, recorded

CLEARLY = 4.5
"""Standard errors that no base parameter of an arm may be off by."""


@pytest.fixture(scope="module")
def made() -> Made:
    return make(529, 3, rate=250.0, duration=14.0)


def logged(made: Made, offsets: Sequence[float] = (0.0, 0.0, 0.0), laws: Laws | None = None) -> Recording:
    log = recorded(made, log_of(made, laws or Laws()), db=90.0, counts=0.0, torque=0.003, colour=0.0, seed=4)
    return replace(log, q=log.q + np.array(offsets), theta=log.theta + np.array(offsets))


def diagnosed(made: Made, log: Recording, *only: str) -> Diagnosis:
    signals = prepare(log, made.robot, SignalOptions.for_diagnosis(log.rate))
    found = diagnose(made.robot, signals, DiagnoseOptions(only=only))
    assert isinstance(found, Diagnosis)
    return found


def furthest(found: Identification, made: Made) -> float:
    """Return by how many standard errors the base parameter that is furthest off is so."""
    truth = found.base.values(made.truth.reference())
    errors = [
        abs(item.estimate - value) / item.std_error
        for item, value in zip(found.parameters, truth, strict=True)
        if item.estimate is not None and item.std_error
    ]
    assert len(errors) > 15
    return max(errors)


@pytest.mark.parametrize("size", [0.03, 0.2, -0.7, np.pi / 2])
def test_an_encoders_zero_is_found(made: Made, size: float) -> None:
    found = diagnosed(made, logged(made, (0.0, size, 0.0)))
    assert [(e.effect, e.joint) for e in found.effects] == [("encoder_zero", "j2")]
    (effect,) = found.effects
    assert abs(effect.parameters["offset"] - size) < 3 * effect.std_error["offset"] < 0.01
    assert not found.unexplained
    assert furthest(found.identified_after, made) < CLEARLY


@pytest.mark.parametrize("given", [{}, {"offset": 0.8}])
def test_a_declared_zero_leaves_no_parameter_off(made: Made, given: dict[str, float]) -> None:
    """With no value the whole circle is looked around; with one the fit begins there."""
    size = 1.0 if given else -np.pi / 2
    log = logged(made, (0.0, size, 0.0))
    robot = replace(made.robot, effects=(EffectSpec("encoder_zero", "j2", given),))
    found = identify(robot, prepare(log, robot))
    (effect,) = found.effects
    assert abs(effect.parameters["offset"] - size) < 4 * effect.std_error["offset"] < 0.02
    assert furthest(found, made) < CLEARLY


def test_an_accurate_estimate_counts_a_zero_once(made: Made) -> None:
    size = 0.6
    log = logged(made, (0.0, size, 0.0))
    robot = replace(made.robot, effects=(EffectSpec("encoder_zero", "j2", {}),))
    (effect,) = identify(robot, prepare(log, robot), EstimateOptions(accurate=True)).effects
    assert abs(effect.parameters["offset"] - size) < 0.02


def test_two_quarter_turns_are_found() -> None:
    made = make(529, 4, rate=250.0, duration=14.0)
    off = {"j2": -np.pi / 2, "j3": np.pi / 2}
    found = diagnosed(made, logged(made, [off.get(name, 0.0) for name in made.robot.joint_names]), "encoder_zero")
    assert {e.joint: e.parameters["offset"] for e in found.effects} == pytest.approx(off, abs=0.01)


def test_the_written_robot_lacks_nothing(made: Made) -> None:
    log = logged(made, (0.0, np.pi / 2, 0.0))
    written = diagnosed(made, log).written_robot
    again = diagnose(written, prepare(log, written, SignalOptions.for_diagnosis(log.rate)))
    assert again.effects == ()
    assert again.sufficient


@pytest.mark.parametrize("effect", ["gravity_direction", "payload", "link_spring"])
def test_other_effects_are_no_zeros(made: Made, effect: str) -> None:
    found = diagnosed(made, logged(made, laws=laws_of(effect, made, 1)), effect, "encoder_zero")
    assert {e.effect for e in found.effects} == {effect}
