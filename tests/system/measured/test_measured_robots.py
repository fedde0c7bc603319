"""The loop closed on hardware: three measured logs, which stay outside the repository; absent, the tests skip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.diagnosis.refit import identified
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.prediction import validate
from elid_cli.logs import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare

DATA = Path(__file__).parents[4] / "shared" / "data"
FILES = {"emps": "emps.csv", "kr300": "kr300_A.csv", "quanser_2dsfl": "quanser_2dsfl.csv"}

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"measured logs are not at {DATA}")


def value(found: Identification, name: str) -> float:
    return float(next(e for n, e in zip(found.base.names, found.estimate, strict=True) if n.startswith(name)))


def verdict(found: Identification, name: str) -> str:
    return next(v for n, v in zip(found.base.names, found.verdict, strict=True) if n == name)


def diagnosed(name: str) -> Diagnosis:
    robot = read_robot(name)
    recording = read_recording([DATA / FILES[name]], robot, None)
    return diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))


def test_emps_gives_the_published_table_under_the_published_filtering():
    # Janot, Gautier, Brunot 2019, each with its relative standard deviation
    robot = read_robot("emps")
    recording = read_recording([DATA / FILES["emps"]], robot, None)
    options = SignalOptions(smoothing="butterworth", butterworth=100.0, order=4, cutoff=40.0, min_velocity=0.0)
    found = identify(robot, prepare(recording, robot, options), EstimateOptions(delays=False, mask=False))
    assert value(found, "m1") == pytest.approx(95.1089, abs=0.00114 * 95.1089)
    assert value(found, "fv1") == pytest.approx(203.5034, abs=0.00563 * 203.5034)
    assert value(found, "fs1") == pytest.approx(20.3935, abs=0.00496 * 20.3935)
    offset = next(n.parameters["offset"] for n in found.nuisances if n.effect == "torque_offset")
    assert offset == pytest.approx(-3.1648, abs=0.014 * 3.1648)


def test_emps_by_default_is_within_a_percent_and_predicts_better_than_published():
    robot = read_robot("emps")
    recording = read_recording([DATA / FILES["emps"]], robot, None)
    found = identify(robot, prepare(recording, robot, SignalOptions()))
    for name, published in (("m1", 95.1089), ("fv1", 203.5034), ("fs1", 20.3935)):
        assert value(found, name) == pytest.approx(published, rel=0.01)
    assert found.error["joint1"].relative < 0.0408


def test_emps_friction_is_found_asymmetric_and_the_held_out_error_below_the_published():
    found = diagnosed("emps")
    named = {e.effect for e in found.effects} | {r.effect for r in found.also_possible}
    assert {"asymmetric_coulomb", "torque_offset"} <= named  # a constant: corrected, and said to be either
    after, before = (error["joint1"].relative for error in (found.after, found.before))
    assert after <= before * (1 + 1e-12)  # the same model twice, where nothing is named
    assert before < 0.0408
    assert found.unexplained  # the flexible mode lies above the filter: said to be left, not explained away


@pytest.fixture(scope="module")
def kuka() -> Diagnosis:
    if not DATA.is_dir():
        pytest.skip("no measured logs")
    return diagnosed("kr300")


def test_kuka_encoders_of_axes_1_to_3_are_skewed_by_three_milliseconds(kuka):
    skews = {e.joint: e.parameters["skew"] for e in kuka.effects if e.effect == "encoder_skew"}
    assert set(skews) == {"joint1", "joint2", "joint3"}
    assert all(0.0027 < skew < 0.0033 for skew in skews.values())
    assert kuka.effects[0].effect == "encoder_skew"


def test_kuka_stiffnesses_come_within_a_factor_of_two_and_that_of_axis_1_is_refused(kuka):
    found = identified(kuka.state_after, kuka.after)
    assert 0.5 < value(found, "K2") / 7.52e6 < 2
    assert 0.5 < value(found, "K3") / 4.10e6 < 2
    assert verdict(found, "K1") == "refused"
    assert "too little torque" in found.reasons["K1"]


def test_kuka_error_of_the_motor_rows_falls_on_stretches_the_search_never_saw(kuka):
    for joint in ("joint2", "joint3"):
        assert kuka.after[joint].spring_rms < 0.5 * kuka.before[joint].spring_rms
    again = validate(kuka.refined, kuka.state_after.log.raw, kuka.chosen)
    for joint, error in kuka.after.items():
        assert again.error[joint].rms == pytest.approx(error.rms, rel=1e-12)


def test_quanser_first_stage_sides_with_the_impulse_test_and_the_second_is_poorly_determined():
    robot = read_robot("quanser_2dsfl")
    recording = read_recording([DATA / FILES["quanser_2dsfl"]], robot, None)
    found = identify(robot, prepare(recording, robot, SignalOptions()))
    assert 25 < value(found, "K1") < 30
    assert verdict(found, "K2") in ("weak", "refused")


def test_quanser_stiction_is_named():
    found = diagnosed("quanser_2dsfl")
    assert ("stribeck", "joint1") in {(e.effect, e.joint) for e in found.effects} | {
        (r.effect, r.joint) for r in found.also_possible
    }


@pytest.mark.parametrize("name", sorted(FILES))
def test_every_effect_that_is_named_helps_on_quarters_left_out_in_turn(name, request):
    found = request.getfixturevalue("kuka") if name == "kr300" else diagnosed(name)
    assert found.effects or name == "emps"
    for effect in found.effects:
        told = [gain for gain in effect.quarters if np.isfinite(gain)]
        assert len(told) >= 3, effect.effect
        assert min(told) > 0, effect.effect
