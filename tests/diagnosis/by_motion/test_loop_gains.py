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
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, KD, NAMES, VISCOUS, moved, robot, written

TRIED = ("position_gain", "damping_gain", "torque_gain", "torque_delay")
TOO_LARGE = 0.25
TRUTH = np.stack([ARMATURE, COULOMB, VISCOUS], axis=1)


def logged(
    seed: int, duration: float, gain: str, share: float = TOO_LARGE, *, rates: bool = True, tilt: float = 0.0
) -> Recording:
    """Return a log that tells a gain of the second drive too large by a share."""
    recording = moved(seed, duration, delay=0.002, rates=rates, tilt=tilt)
    told = recording.commands[gain] * np.array([1.0, 1.0 + share, 1.0])
    return replace(recording, commands={**recording.commands, gain: told})


def diagnosed(folder: Path, recording: Recording, *more: str) -> tuple[Robot, MotionDiagnosis]:
    arm = robot(folder)
    log = read_recording([written(folder, "log.h5", recording)], arm)
    return arm, diagnose_motion(arm, prepare(log, arm), None, (*TRIED, *more))


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


def test_it_does_as_well_beside_a_tilted_base_and_friction_counts_it_there_too(tmp_path: Path) -> None:
    _, found = diagnosed(tmp_path, logged(6, 5.0, "kp", 0.2, rates=False, tilt=0.06), "gravity_direction")
    assert "gravity_direction" in {e.effect for e in found.effects}
    named = {(e.effect, e.joint) for e in (*found.effects, *found.also_possible)}
    assert {("position_gain", NAMES[1]), ("torque_gain", NAMES[1])} <= named
    assert np.abs(scores(found)).max() < 4.5
    viscous = found.fit_after.unknowns.joint_values(found.fit_after.deviation)[1, 2]
    assert viscous > 0.05 * KD[1]


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


def _slide(seconds: float = 6.0, dt: float = 0.004, fine: int = 20) -> Recording:
    """Return a log of a mass of 3 kg (and 1 kg of the drive) on a level slide, whose kd is 20 % above the drive's."""
    rng, samples, step = np.random.default_rng(3), round(seconds / dt), dt / fine
    t = dt * np.arange(samples)
    waves = [(0.05 / k, 2 * np.pi * 0.37 * k, rng.uniform(0, 6)) for k in (1, 2, 3, 5)]
    told = sum(a * np.sin(w * t + p) for a, w, p in waves)
    rate = sum(a * w * np.cos(w * t + p) for a, w, p in waves)
    x, v, seen = float(told[0]), 0.0, []
    for k in range(samples):
        seen.append(x)
        for _ in range(fine):
            push = 900.0 * (told[k] - x) + 50.0 * (rate[k] - v) - 8.0 * v
            slid = v + step * (push - 4.0 * np.sign(v)) / 4.0
            if v * slid < 0 or (v == 0 and abs(push) < 4.0):
                slid = 0.0
            x, v = x + 0.5 * step * (v + slid), slid
    q = np.array(seen)[:, None] + 1e-6 * rng.standard_normal((samples, 1))
    gains = {"kp": np.full((samples, 1), 900.0), "kd": np.full((samples, 1), 60.0)}
    commands = {"q_des": told[:, None], "dq_des": rate[:, None], **gains}
    return Recording(
        joints=("x",), dt=dt, t=t, q=q, theta=q, tau=np.full_like(q, np.nan), commands=commands,
        segments=(Segment(0, samples),), files=("slide.h5",),
    )  # fmt: skip


def test_of_gains_that_do_as_well_errors_count_what_the_other_makes_of_the_drive(tmp_path: Path) -> None:
    """Nothing of known size acts on a level slide: kd 20 % less, or kp, inertia and friction 20 % more."""
    path = tmp_path / "slide.xml"
    path.write_text(
        '<mujoco model="slide"><worldbody><body><joint name="x" type="slide" axis="1 0 0"/>'
        '<inertial pos="0 0 0" mass="3" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>'
    )
    arm = read_robot(path)
    log = read_recording([written(tmp_path, "slide.h5", _slide())], arm)
    found = diagnose_motion(arm, prepare(log, arm), None, TRIED)
    assert {"position_gain", "damping_gain"} <= {e.effect for e in (*found.effects, *found.also_possible)}
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)[0, :3]
    off = found.fit_after.values[0, :3] - np.array([1.0, 4.0, 8.0])
    assert (np.abs(off) < 4 * error).all()


def test_of_gains_as_near_the_one_that_leaves_viscous_friction_is_named(tmp_path: Path) -> None:
    # a fifth of kd is all of the joint's viscous friction: with a torque gain, there is none or less
    _, found = diagnosed(tmp_path, logged(6, 5.0, "kp", -0.2003, rates=False))
    assert [(e.effect, e.joint) for e in found.effects] == [("position_gain", NAMES[1])]
    assert np.abs(scores(found)).max() < 4.5
