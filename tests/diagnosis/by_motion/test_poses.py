"""A base that is not level and wrong zeros of encoders, told by the motion of a plant that shares no code with elid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion import searched_log, whole_robot
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.poses import BaseAngles
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.trajectory.changes import Changed
from elid_cli.experiment.replay.replay import replay
from elid_cli.logs.reading import read_recording
from elid_cli.report.answers.motion_diagnosis import named_effects
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, NAMES, OFFSET, VISCOUS, moved, robot, written


def test_a_tilted_base_is_named_in_place_of_springs(tmp_path: Path) -> None:
    arm, tilt = robot(tmp_path), -0.1
    recording = moved(6, 7.0, tilt=tilt)
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "tilt.h5", recording)], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("gravity_direction", None)]
    (effect,) = found.effects
    assert effect.parameters["pitch"] == pytest.approx(tilt, rel=0.02)
    assert abs(effect.parameters["pitch"] - tilt) < 4 * effect.std_error["pitch"]
    assert "roll" not in effect.std_error  # no pendulum feels it
    assert not found.unexplained
    assert not found.other_bodies
    truth = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((found.fit_after.values - truth) / error).max() < 4
    # the robot that is written hangs in that gravity
    assert found.refined.gravity != arm.gravity
    assert replay(found.refined, recording).mean_abs < 3e-4


@pytest.mark.parametrize("steep", [False, True])
def test_the_zero_of_an_encoder_is_named_in_place_of_a_spring(tmp_path: Path, steep: bool) -> None:
    arm, zero = robot(tmp_path), 0.2 if steep else 0.05
    recording = moved(6, 7.0, tilt=np.array([0.0, zero, 0.0]))
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "zero.h5", recording)], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("encoder_zero", "two")]
    (effect,) = found.effects
    assert effect.parameters["offset"] == pytest.approx(zero, rel=0.02)
    assert abs(effect.parameters["offset"] - zero) < 4 * effect.std_error["offset"]
    assert effect.gain > 0.5
    assert not found.unexplained
    assert not found.other_bodies
    truth = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((found.fit_after.values - truth) / error).max() < 4
    assert replay(found.refined, recording).mean_abs < 3e-4


@pytest.mark.parametrize(
    ("tilt", "spec"),
    [
        (np.array([0.0, 0.2, 0.0]), EffectSpec("encoder_zero", "two", {"offset": 0.2})),
        (-0.1, EffectSpec("gravity_direction", None, {"roll": 0.0, "pitch": -0.1})),
    ],
)
def test_a_declared_zero_or_tilt_turns_the_robot_that_is_simulated(
    tmp_path: Path, tilt: np.ndarray | float, spec: EffectSpec
) -> None:
    arm = robot(tmp_path)
    known, recording = replace(arm, effects=(spec,)), moved(6, 6.0, tilt=tilt)
    signals = prepare(read_recording([written(tmp_path, "log.h5", recording)], known), known)
    found = identify(known, signals)
    assert found.estimator == "trajectory"
    assert max(error.relative for error in found.error.values()) < 0.01
    truth = np.stack([ARMATURE, COULOMB, VISCOUS], axis=1)
    values = [[found.drives[name][kind]["estimate"] for kind in ("Ja", "fs", "fv")] for name in NAMES]
    assert np.array(values) == pytest.approx(truth, rel=0.01)
    # the written robot still declares it, and moves as the log does
    again = identified_robot(found)
    assert spec in again.effects
    moved_again = replay(again, recording)
    assert moved_again.mean_abs < 2e-4
    assert not moved_again.left_out
    diagnosed = diagnose_motion(known, signals, None, ("link_spring", "encoder_zero", "gravity_direction"))
    assert not diagnosed.effects
    assert not diagnosed.unexplained
    assert replay(diagnosed.refined, recording).mean_abs < 2e-4


def test_zeros_of_two_encoders_are_found_beside_a_friction(tmp_path: Path) -> None:
    arm, only = robot(tmp_path), np.array([0.0, 0.0, 1.0])
    zeros = np.array([0.06, -0.04, 0.0])
    recording = moved(5, 7.0, tilt=zeros, grip=lambda x, v, load: 0.6 * only * np.exp(-((v / 0.2) ** 2)))
    signals = prepare(read_recording([written(tmp_path, "both.h5", recording)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("stribeck", "link_spring", "gravity_direction", "encoder_zero"))
    named = {(e.effect, e.joint): e for e in found.effects}
    assert named.keys() == {("encoder_zero", "one"), ("encoder_zero", "two"), ("stribeck", "three")}
    for joint, zero in (("one", 0.06), ("two", -0.04)):
        assert named["encoder_zero", joint].parameters["offset"] == pytest.approx(zero, rel=0.03)
    assert not found.unexplained


def test_a_tilted_base_is_found_beside_another_effect_and_a_steep_one_is_not_guessed(tmp_path: Path) -> None:
    arm, only = robot(tmp_path), np.array([0.0, 0.0, 1.0])
    recording = moved(5, 7.0, tilt=0.06, grip=lambda x, v, load: 0.6 * only * np.exp(-((v / 0.2) ** 2)))
    signals = prepare(read_recording([written(tmp_path, "both.h5", recording)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("stribeck", "link_spring", "gravity_direction"))
    assert {(e.effect, e.joint) for e in found.effects} == {("gravity_direction", None), ("stribeck", "three")}
    assert found.effects[0].parameters["pitch"] == pytest.approx(0.06, rel=0.02)
    assert named_effects(found)[0].startswith("pendulums: ")
    assert not found.unexplained
    steep = moved(5, 6.0, tilt=0.6)
    signals = prepare(read_recording([written(tmp_path, "steep.h5", steep)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("link_spring", "gravity_direction"))
    assert "gravity_direction" not in {e.effect for e in found.effects}


@dataclass(frozen=True)
class Done:
    """As much of a search's result as is asked for where a tilt is looked at."""

    after: SimpleNamespace
    tried: int = 0
    partial: bool = False
    named: tuple[()] = ()


def leaving(*errors: float) -> SimpleNamespace:
    """Return a fit that leaves these errors, one for each joint."""
    return SimpleNamespace(equations=SimpleNamespace(size=np.array(errors)), above_noise=lambda _: np.array([9.0]))


@pytest.mark.parametrize(("joints", "error", "asked"), [(2, 0.85, True), (12, 0.973, False), (12, 0.93, True)])
def test_a_tilt_that_brings_the_joints_hardly_nearer_is_not_searched_with(
    monkeypatch: pytest.MonkeyPatch, joints: int, error: float, asked: bool
) -> None:
    """The search takes minutes on a quadruped: there the sum over twelve joints is no measure."""
    asks = []
    plain = leaving(*np.ones(joints))

    def search(*_: object) -> Done:
        asks.append(1)
        return Done(plain)

    fit = SimpleNamespace(values=None, unknowns=SimpleNamespace(robot=None), **vars(leaving(*np.full(joints, error))))
    turned = Turned(BaseAngles(), np.array([0.1, 0.0]), np.array([0.001, np.inf]), SimpleNamespace(n=joints), fit)  # type: ignore[arg-type]
    monkeypatch.setattr(searched_log, "search", search)
    monkeypatch.setattr(whole_robot, "tilt_of", lambda _: turned)
    for other in ("zeros_of", "late_joints", "integral_terms", "velocity_filters", "position_gains", "damping_gains"):
        monkeypatch.setattr(whole_robot, other, lambda *_: None)
    monkeypatch.setattr(whole_robot, "kinds_of_loads", lambda _: [])
    none = np.zeros(joints, dtype=bool)
    found = whole_robot.Found(Done(plain), plain, None, np.ones(joints), none, (), None, None)  # type: ignore[arg-type]
    log = searched_log.SearchedLog(None, [], ([], []), (), None)  # type: ignore[arg-type]
    found, change, rivals = whole_robot._asked_changes(found, log)
    found, _ = whole_robot._by_asked(found, log, change, rivals)
    assert not found.changes
    assert bool(asks) == asked
    assert found.done.tried == 7


class Turned(Changed):
    """A change of a robot that nothing else is known of."""

    @property
    def robot(self) -> None:  # type: ignore[override]
        """Return none."""

    def gain(self, before: object) -> float:
        """Return some."""
        return 0.5


def test_a_tilt_and_a_late_drive_are_both_found(tmp_path: Path) -> None:
    arm, late = robot(tmp_path), np.array([0.001, 0.001, 0.005])
    recording = moved(7, 7.5, delay=late, tilt=0.05)
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "both.h5", recording)], arm), arm))
    named = {(e.effect, e.joint): e for e in found.effects}
    assert named.keys() == {("gravity_direction", None), ("torque_delay", "three")}
    assert named["gravity_direction", None].parameters["pitch"] == pytest.approx(0.05, rel=0.02)
    delay = named["torque_delay", "three"]
    assert abs(delay.parameters["delay"] - 0.005) < 4 * delay.std_error["delay"]
    assert not found.unexplained
    assert replay(found.refined, recording).mean_abs < 3e-4


def test_coarse_encoders_show_a_late_drive_as_well(tmp_path: Path) -> None:
    arm, late = robot(tmp_path), np.array([0.002, 0.002, 0.006])
    recording = moved(7, 9.0, delay=late, noise=1e-3)
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "late.h5", recording)], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("torque_delay", "three")]
    (effect,) = found.effects
    assert abs(effect.parameters["delay"] - 0.006) < 4 * effect.std_error["delay"]


def test_a_drive_that_acts_later_than_the_others_is_named_with_its_delay(tmp_path: Path) -> None:
    arm, late = robot(tmp_path), np.array([0.001, 0.001, 0.006])
    recording = moved(7, 10.0, sweep=0.15, delay=late)
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "late.h5", recording)], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("torque_delay", "three")]
    assert found.effects[0].parameters["delay"] == pytest.approx(0.006, abs=5e-5)
    assert not found.unexplained
    delays = {n.joint: n.parameters["delay"] for n in found.after.nuisances if n.effect == "torque_delay"}
    assert [delays[name] for name in NAMES] == pytest.approx(late, abs=5e-5)
    truth = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((found.fit_after.values - truth) / error).max() < 4
    assert replay(found.refined, recording).mean_abs < 3e-4
    # so does a fit that nobody asked about effects
    plain = identify(
        arm, prepare(read_recording([str(tmp_path / "late.h5")], arm), arm), EstimateOptions(fit="trajectory")
    )
    delays = {n.joint: n.parameters["delay"] for n in plain.nuisances if n.effect == "torque_delay"}
    assert [delays[name] for name in NAMES] == pytest.approx(late, abs=5e-5)
    assert not plain.settings["trajectory"]["beyond_noise"]  # type: ignore[index]


def test_a_declared_delay_that_is_wrong_is_not_believed(tmp_path: Path) -> None:
    arm, recording = robot(tmp_path), moved(6, 6.0, delay=0.001)
    known = replace(arm, effects=(EffectSpec("torque_delay", "three", {"delay": 0.006}),))
    signals = prepare(read_recording([written(tmp_path, "log.h5", recording)], known), known)
    found = diagnose_motion(known, signals, None, ("torque_delay", "link_spring"))
    assert not found.effects
    delays = {n.joint: n.parameters["delay"] for n in found.after.nuisances if n.effect == "torque_delay"}
    assert [delays[name] for name in NAMES] == pytest.approx([0.001] * 3, abs=5e-5)
    assert replay(found.refined, recording).mean_abs < 3e-4
