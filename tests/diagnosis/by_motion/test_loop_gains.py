"""Drives one of whose gains, kp or kd, is another one than the log holds, told by the motion of a plant of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
from elid_cli.errors import RobotError
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.experiment.replay.replay import ReplayOptions, replay
from elid_cli.logs.reading import read_recording
from elid_cli.model.effects.of_drives import declared_loop_gains
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.robot.text import text_of
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, KD, NAMES, VISCOUS, moved, robot, written

TRIED = ("position_gain", "damping_gain", "torque_gain", "torque_delay")
TOO_LARGE = 0.25
TRUTH = np.stack([ARMATURE, COULOMB, VISCOUS], axis=1)


def logged(seed: int, duration: float, gain: str, share: float = TOO_LARGE, *, rates: bool = True) -> Recording:
    """Return a log that tells a gain of the second drive too large by a share."""
    recording = moved(seed, duration, delay=0.002, rates=rates)
    told = recording.commands[gain] * np.array([1.0, 1.0 + share, 1.0])
    return replace(recording, commands={**recording.commands, gain: told})


def diagnosed(folder: Path, recording: Recording) -> tuple[Robot, MotionDiagnosis]:
    arm = robot(folder)
    log = read_recording([written(folder, "log.h5", recording)], arm)
    return arm, diagnose_motion(arm, prepare(log, arm), None, TRIED)


def scores(found: MotionDiagnosis) -> np.ndarray:
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)[:, :3]
    return np.asarray((found.fit_after.values[:, :3] - TRUTH) / error)


@pytest.mark.parametrize(("gain", "effect"), [("kp", "position_gain"), ("kd", "damping_gain")])
def test_a_gain_that_is_off_alone_is_named_and_written(tmp_path: Path, gain: str, effect: str) -> None:
    arm, found = diagnosed(tmp_path, logged(6, 5.0, gain))
    assert [(e.effect, e.joint) for e in found.effects] == [(effect, NAMES[1])]
    (own,) = found.effects
    assert abs(own.parameters["gain"] - TOO_LARGE) < 4 * own.std_error["gain"] < 0.05
    assert np.abs(scores(found)).max() < 4.5

    file, other = tmp_path / "found.yaml", logged(8, 4.0, gain)
    file.write_text(text_of(found.refined))
    again = read_robot(file)
    assert replay(again, other).mean_abs < 1.3e-4
    assert replay(again, other, ReplayOptions(engine="mujoco")).mean_abs < 1e-3
    assert replay(replace(again, effects=()), other).mean_abs > 2e-3
    known = replace(arm, effects=tuple(spec for spec in again.effects if spec.effect == effect))
    signals = prepare(read_recording([written(tmp_path, "other.h5", other)], known), known)
    # it is no effect that least squares have a column for: the torque is computed with it
    for fit in ("torque", "trajectory"):
        held = identify(known, signals, EstimateOptions(fit=fit))
        friction = next(p for p in held.parameters if p.name == "fv2")
        assert abs(friction.estimate - VISCOUS[1]) < 0.05 * KD[1], fit


def test_without_commanded_velocities_a_torque_gain_does_as_well_and_friction_counts_it(tmp_path: Path) -> None:
    _, found = diagnosed(tmp_path, logged(6, 5.0, "kp", 0.2, rates=False))
    named = {(e.effect, e.joint) for e in (*found.effects, *found.also_possible)}
    assert {("position_gain", NAMES[1]), ("torque_gain", NAMES[1])} <= named
    assert np.abs(scores(found)).max() < 4.5
    (rival,) = (r for r in found.also_possible if r.effect in ("position_gain", "torque_gain"))
    assert "commanded velocities" in rival.separate


def test_a_torque_gain_under_which_a_joint_would_drive_itself_is_none(tmp_path: Path) -> None:
    # half of kd is more than the joint's viscous friction
    _, found = diagnosed(tmp_path, logged(6, 5.0, "kp", -0.4, rates=False))
    assert [(e.effect, e.joint) for e in found.effects] == [("position_gain", NAMES[1])]
    assert not any(rival.effect == "torque_gain" for rival in found.also_possible)
    assert np.abs(scores(found)).max() < 4.5


def test_a_gain_that_leaves_none_is_refused(tmp_path: Path) -> None:
    arm = replace(robot(tmp_path), effects=(EffectSpec("damping_gain", NAMES[0], {"gain": -1.0}),))
    with pytest.raises(RobotError, match="leaves no gain"):
        declared_loop_gains(arm)
