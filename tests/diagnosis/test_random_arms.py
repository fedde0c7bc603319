"""Diagnosis of random three-joint arms, of which only the geometry is known, on logs made by inverse dynamics.

The effects' formulas are written a second time in `tests.system.reproduce.inverse_logs`;
`tests.system.reproduce.field_trials` runs all of them over many arms, this file a few that each
need something of their own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.estimation.identify import identify
from elid_cli.estimation.validation.prediction import validate
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import Signals, prepare
from tests.system.reproduce.inverse_logs import Laws, Made, laws_of, log_of, make, recorded

RATE = 500.0


def logged(arm: int, effect: str = "", joint: int = 0) -> tuple[Made, Signals]:
    """Return an arm and its prepared log at 90 dB, with an effect or without."""
    made = make(arm, rate=RATE)
    signals = log_of(made, laws_of(effect, made, joint) if effect else Laws())
    log = recorded(made, signals, db=90.0, counts=0.0, torque=0.0, colour=0.0, seed=arm)
    return made, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE))


def found_in(arm: int, effect: str, joint: int, *only: str) -> tuple[Made, Signals, Diagnosis]:
    """Return the diagnosis of a log with one effect."""
    made, signals = logged(arm, effect, joint)
    return made, signals, diagnose(made.robot, signals, DiagnoseOptions(only=only))


def test_a_tilted_base_is_found_exactly_and_left_nothing_but_noise() -> None:
    """A tilt shows parameters that level ground hides; the model itself is turned, so it is no residual."""
    _, signals, found = found_in(1, "gravity_direction", 0, "gravity_direction", "link_spring", "payload")
    assert [e.effect for e in found.effects] == ["gravity_direction"]
    values = found.effects[0].parameters
    assert values["roll"] == pytest.approx(-0.025, abs=1e-4)
    assert values["pitch"] == pytest.approx(-0.02, abs=1e-4)
    assert not found.unexplained
    assert found.after["j3"].rms < 0.02 * found.before["j3"].rms
    # the written robot, validated on the same stretches, gives the same figures
    again = validate(found.refined, signals, found.chosen)
    assert again.error["j3"].rms == found.after["j3"].rms


@pytest.mark.parametrize("arm", [3, 6])
def test_a_tilt_is_scored_with_the_moments_that_it_brings_to_light(arm: int) -> None:
    """Most of its torque may be that of first moments which a level robot never shows: its column lacks them."""
    made = make(arm, rate=250.0, duration=10.0)
    tilted = log_of(made, laws_of("gravity_direction", made, 0))
    log = recorded(made, tilted, db=75.0, counts=0.0, torque=0.01, colour=0.0, seed=arm)
    signals = prepare(log, made.robot, SignalOptions.for_diagnosis(log.rate))
    found = diagnose(made.robot, signals, DiagnoseOptions(only=("gravity_direction", "link_spring")))
    (effect,) = found.effects
    assert effect.effect == "gravity_direction"
    for name, size in (("roll", -0.025), ("pitch", -0.02)):
        assert abs(effect.parameters[name] - size) < 3 * effect.std_error[name] < 0.02
    assert not found.unexplained


def test_a_declared_tilt_is_estimated_with_the_parameters_that_it_brings_to_light() -> None:
    """Declared without values, it is found as by the diagnosis, and the robot has two base parameters more."""
    made, signals = logged(2, "gravity_direction")
    found = identify(replace(made.robot, effects=(EffectSpec("gravity_direction", None, {}),)), signals)
    level = identify(made.robot, signals)
    assert found.base.count == level.base.count + 2
    assert found.robot.gravity == made.robot.gravity
    tilt = next(e for e in found.effects if e.effect == "gravity_direction")
    assert tilt.parameters["roll"] == pytest.approx(-0.025, abs=2e-4)
    assert tilt.parameters["pitch"] == pytest.approx(-0.02, abs=2e-4)


@pytest.mark.parametrize(("arm", "joint"), [(1, 2), (2, 1)])
def test_a_torque_gain_shows_in_the_rows_of_other_joints(arm: int, joint: int) -> None:
    """The gain's own rows fit by scaled parameters; the joints that share the bodies tell."""
    _, _, found = found_in(arm, "torque_gain", joint, "torque_gain", "torque_offset", "link_viscous")
    assert [(e.effect, e.joint) for e in found.effects] == [("torque_gain", f"j{joint + 1}")]
    assert found.effects[0].parameters["gain"] == pytest.approx(-0.08, abs=0.002)


@pytest.mark.parametrize(("effect", "exponent"), [("stribeck", 1.0), ("stribeck_gauss", 2.0)])
def test_the_form_of_a_friction_curve_is_told(effect: str, exponent: float) -> None:
    """Of two forms that explain nearly all, the one is named that leaves noise."""
    made, _, found = found_in(2, effect, 0, "stribeck", "quadratic_viscous", "load_friction")
    assert [e.effect for e in found.effects] == ["stribeck"]
    assert found.effects[0].parameters["exponent"] == exponent
    speed = made.sizes[0].speed * (0.06 if exponent == 1 else 0.08)
    assert found.effects[0].parameters["velocity"] == pytest.approx(speed, rel=0.03)
    assert not found.unexplained


def test_a_plain_arm_gets_no_effect() -> None:
    """Nothing there, nothing said; the smoothing's own errors are no structure either."""
    made, signals = logged(10)
    found = diagnose(made.robot, signals)
    assert found.sufficient
    assert not found.triage
    assert max(row.share for row in found.rows_after) < 0.01
    assert np.isfinite([row.ratio for row in found.rows_after]).all()


def test_one_of_many_reversals_is_no_contact() -> None:
    """Friction that builds up over a distance leaves a bump at every reversal; a push from outside happens once."""
    made = make(43, 2, rate=RATE)
    log = recorded(
        made, log_of(made, laws_of("presliding", made, 1)), db=90.0, counts=0.0, torque=0.0, colour=0.0, seed=43
    )
    found = diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)))
    assert "contact" not in {e.effect for e in found.effects}
    assert "j2" in {item.joint for item in found.unexplained}
