"""The zero of a torque channel is an unknown of every diagnosis: corrected, named, and no reason for another effect."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.estimation.identify import Nuisance, identify
from elid_cli.model.effects import effect_classes
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.diagnosis_logs import Diagnosed, Logs

OFFSETS = (2.0, -0.7)


def offset(recording: Recording) -> Recording:
    return dataclasses.replace(recording, tau=recording.tau + np.array(OFFSETS))


def of(robot: Robot, recording: Recording) -> Diagnosis:
    return diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))


def named(found: Diagnosis) -> list[tuple[str, str | None]]:
    return [(e.effect, e.joint) for e in found.effects]


def offsets(found: Diagnosis) -> list[Nuisance]:
    return [n for n in found.nuisances if n.effect == "torque_offset"]


@pytest.fixture(scope="module")
def found(log: Logs, robot: Robot) -> Diagnosis:
    return of(robot, offset(log()))


def test_offsets_are_corrected_before_any_effect_is_judged(found: Diagnosis, diagnosed: Diagnosed) -> None:
    clean = diagnosed()
    assert named(found) == [("torque_offset", "joint1"), ("torque_offset", "joint2")]
    assert not found.unexplained
    assert not found.sufficient
    for joint, error in found.before.items():
        assert error.rms == pytest.approx(clean.before[joint].rms, rel=0.02)
    told = {n.joint: (n.parameters["offset"], n.std_error["offset"]) for n in offsets(found)}
    for joint, truth in zip(("joint1", "joint2"), OFFSETS, strict=True):
        value, deviation = told[joint]
        assert abs(value - truth) < 3 * deviation + 0.02 * abs(truth)


def test_an_offset_has_size_error_and_gain_as_an_effect_has(found: Diagnosis) -> None:
    corrected = {n.joint: n for n in offsets(found)}
    for effect, truth in zip(found.effects, OFFSETS, strict=True):
        assert effect.joint is not None
        assert effect.parameters == corrected[effect.joint].parameters
        assert effect.std_error == corrected[effect.joint].std_error
        assert abs(effect.parameters["offset"] - truth) < 4 * effect.std_error["offset"] + 0.01 * abs(truth)
        assert effect.gain > 0.5
        assert all(gain > 0.1 for gain in effect.quarters if np.isfinite(gain)), effect.quarters


def test_a_clean_log_names_no_offset(diagnosed: Diagnosed) -> None:
    assert diagnosed().effects == ()


def test_what_the_constant_could_be_is_told(found: Diagnosis) -> None:
    for joint, truth in zip(("joint1", "joint2"), OFFSETS, strict=True):
        rivals = {r.effect: r for r in found.also_possible if r.joint == joint}
        assert set(rivals) == {"asymmetric_coulomb"}
        assert rivals["asymmetric_coulomb"].instead_of == "torque_offset"
        assert rivals["asymmetric_coulomb"].parameters["difference"] == pytest.approx(truth, rel=0.1)
        assert rivals["asymmetric_coulomb"].gain > 0.5


def test_the_same_offsets_as_identification_finds(found: Diagnosis, log: Logs, robot: Robot) -> None:
    recording = offset(log())
    known = identify(robot, prepare(recording, robot))
    values = {n.joint: n.parameters["offset"] for n in known.nuisances if n.effect == "torque_offset"}
    assert set(values) == set(robot.joint_names)
    for nuisance in offsets(found):
        assert nuisance.parameters["offset"] == pytest.approx(values[nuisance.joint], abs=0.1)
    written = [(spec.effect, spec.joint) for spec in found.written_robot.effects]
    assert [w for w in written if w[0] != "torque_delay"] == [("torque_offset", joint) for joint in robot.joint_names]


def test_an_effect_beside_an_offset_is_named_once(log: Logs, robot: Robot) -> None:
    found = of(robot, offset(log("load_friction")))
    assert sorted(named(found)) == [
        ("load_friction", "joint2"), ("torque_offset", "joint1"), ("torque_offset", "joint2"),
    ]  # fmt: skip
    assert [n.joint for n in offsets(found)] == ["joint1", "joint2"]


def test_a_declared_offset_stands_for_the_channels_own(log: Logs, robot: Robot) -> None:
    declared = dataclasses.replace(robot, effects=(EffectSpec("torque_offset", "joint1", {"offset": 2.0}),))
    found = of(declared, offset(log()))
    assert named(found) == [("torque_offset", "joint2")]
    assert [n.joint for n in offsets(found)] == ["joint2"]
    assert found.state_after.named(0)["offset"] == pytest.approx(2.0, rel=0.05)
    assert effect_classes()["torque_offset"].nuisance == "offset"
