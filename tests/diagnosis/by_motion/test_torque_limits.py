"""Limits of torque that the robot file does not know, on a plant that shares no code with elid."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.torque_limits import with_limits
from elid_cli.experiment.replay.replay import replay
from elid_cli.logs.reading import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, NAMES, VISCOUS, moved, robot, written

FAST = 0.42
"""Hz/s; a motion that is soon fast reaches the limits in a short log."""


@pytest.mark.parametrize(
    ("joint", "limit", "seed", "delay"), [(1, 7.5, 3, 0.0), (0, 15.0, 4, 0.0025), (2, 3.0, 2, 0.0)]
)
def test_a_limit_is_found_with_its_error_and_the_rest_is_as_without_it(
    tmp_path: Path, joint: int, limit: float, seed: int, delay: float
) -> None:
    arm = robot(tmp_path)
    limits = np.where(np.arange(3) == joint, limit, np.inf)
    recording = moved(seed, 6.0, delay, sweep=FAST, limit=limits)
    log = written(tmp_path, "cut.h5", recording)
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("saturation", NAMES[joint])]
    (cut,) = found.effects
    assert cut.parameters["limit"] == pytest.approx(limit, rel=2e-3)
    assert abs(cut.parameters["limit"] - limit) < 4 * cut.std_error["limit"]
    assert cut.gain > 0.5
    assert not found.unexplained
    # that the computed torque is not what the bodies need is explained
    assert all("loop is taken to act all the time" in line for line in found.after.warnings)
    truth = np.stack([ARMATURE, COULOMB, VISCOUS], axis=1)
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)[:, :3]
    assert np.abs((found.fit_after.values[:, :3] - truth) / error).max() < 4
    assert found.fit_after.values[:, :3] == pytest.approx(truth, rel=0.03)
    # the robot that is written moves as the log does, one without the limit does not
    assert found.refined.joints[joint].limits.torque == pytest.approx(limit, rel=2e-3)
    unlimited = with_limits(found.refined, {joint: 1e3})
    off = [replay(one, recording).error[NAMES[joint]].mean_abs for one in (found.refined, unlimited)]
    assert off[0] < 0.2 * off[1]


def test_a_limit_is_named_written_and_asked_for_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = robot(tmp_path).source
    log = written(tmp_path, "cut.h5", moved(3, 6.0, sweep=FAST, limit=np.array([np.inf, 7.5, np.inf])))
    refined = str(tmp_path / "refined.yaml")
    assert main(["diagnose", log, "--robot", path, "--only", "saturation", "--write-robot", refined]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "saturation" in said
    assert "7.5" in said
    assert read_robot(refined).joint("two").limits.torque == pytest.approx(7.5, rel=2e-3)
    # of the robot that knows the limit nothing is missing
    assert main(["diagnose", log, "--robot", refined, "--only", "saturation", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["effects"] == []
    assert found["sufficient"]


def test_a_limit_of_the_file_that_the_drive_does_not_have_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = robot(tmp_path).source, tmp_path / "refined.xml"
    text = Path(path).read_text().replace('name="two" type', 'name="two" actuatorfrcrange="-2.5 2.5" type')
    Path(path).write_text(text)
    recording = moved(3, 10.0, sweep=0.15)
    log = written(tmp_path, "free.h5", recording)
    most = np.abs(computed(recording)[:, 1]).max()
    assert main(["diagnose", log, "--robot", path, "--write-robot", str(out), "--write-actuators",
                 str(tmp_path / "drives.json"), "--json"]) == 0  # fmt: skip
    found = json.loads(capsys.readouterr().out)
    (effect,) = found["effects"]
    assert (effect["effect"], effect["joint"]) == ("saturation", "two")
    assert effect["parameters"]["limit"] == pytest.approx(most, rel=0.05)
    assert "more than the 2.5 of the robot file" in effect["summary"]
    assert found["unexplained"] == []
    known = found["settings"]["trajectory"]["joint_parameters"]["two"]
    for kind, truth in (("Ja", ARMATURE[1]), ("fs", COULOMB[1]), ("fv", VISCOUS[1])):
        assert abs(known[kind]["estimate"] - truth) < 4 * known[kind]["std_error"]
    assert read_robot(str(out)).joint("two").limits.torque is None
    # a limit that is right, or far away, is no fault
    Path(path).write_text(text.replace("-2.5 2.5", "-40 40"))
    assert main(["diagnose", log, "--robot", path, "--only", "saturation", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["effects"] == []


@pytest.mark.parametrize(("described", "most"), [(5.0, 7.5), (9.0, 7.5), (None, 9.5)], ids=["low", "high", "peaks"])
def test_another_limit_than_the_files_is_found(tmp_path: Path, described: float | None, most: float) -> None:
    arm = robot(tmp_path)
    arm = arm if described is None else with_limits(arm, {1: described})
    log = written(tmp_path, "cut.h5", moved(3, 6.0, noise=3e-5, sweep=FAST, limit=np.array([np.inf, most, np.inf])))
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm), None, ("saturation", "velocity_filter"))
    assert [(e.effect, e.joint) for e in found.effects] == [("saturation", "two")]
    (cut,) = found.effects
    assert cut.parameters["limit"] == pytest.approx(most, rel=3e-3)
    assert (described is not None and described < most) == ("of the robot file, and no more" in cut.summary)
    truth = np.stack([ARMATURE, COULOMB, VISCOUS], axis=1)
    assert found.fit_after.values[:, :3] == pytest.approx(truth, rel=0.03)


def test_an_mjcf_that_lacks_the_delay_has_the_drives_of_a_fit_without_it_within_the_limit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = robot(tmp_path).source, tmp_path / "refined.xml"
    recording = moved(3, 6.0, 0.004, sweep=FAST, limit=np.array([np.inf, 7.5, np.inf]))
    log = written(tmp_path, "cut.h5", recording)
    assert main(["diagnose", log, "--robot", path, "--only", "saturation", "--write-robot", str(out)]) == 0
    assert "the parameters are those of a fit without" in capsys.readouterr().err
    assert "left out: the delay of the drives; the parameters are those of a fit without" in out.read_text()
    refined = read_robot(str(out))
    assert refined.joint("two").limits.torque == pytest.approx(7.5, rel=5e-3)
    for k, joint in enumerate(refined.joints):  # what commands that act late look like: friction and some inertia
        assert joint.parameters["Ja"] == pytest.approx(ARMATURE[k], rel=0.35)
        assert COULOMB[k] < joint.parameters["fs"] < 1.6 * COULOMB[k]


def test_a_limit_that_one_of_two_recordings_reaches_is_found(tmp_path: Path) -> None:
    arm, limits = robot(tmp_path), np.array([np.inf, 7.5, np.inf])
    gentle = moved(4, 5.0, limit=limits)
    assert np.abs(computed(gentle)[:, 1]).max() < 7.0
    logs = [written(tmp_path, "a.h5", moved(3, 6.0, sweep=FAST, limit=limits)), written(tmp_path, "b.h5", gentle)]
    found = diagnose_motion(arm, prepare(read_recording(logs, arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("saturation", "two")]
    assert found.effects[0].parameters["limit"] == pytest.approx(7.5, rel=3e-3)


def computed(recording: Recording) -> np.ndarray:
    told = recording.commands
    assert recording.dq is not None
    asked: np.ndarray = told["kp"] * (told["q_des"] - recording.q) - told["kd"] * recording.dq
    return asked


def test_limits_of_all_drives_that_the_motion_reaches_often_are_found_to_the_end(tmp_path: Path) -> None:
    """Limits that cut a large part of the torques, of every drive: none stands for another, and nothing is left."""
    arm, limits = robot(tmp_path), np.array([3.3, 1.6, 0.8])
    log = written(tmp_path, "cut.h5", moved(3, 6.0, 0.002, sweep=0.33, limit=limits))
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm), None, ("saturation",))
    assert [(e.effect, e.joint) for e in found.effects] == [("saturation", name) for name in NAMES]
    for effect, limit in zip(found.effects, limits, strict=True):
        assert abs(effect.parameters["limit"] - limit) < 4 * effect.std_error["limit"]
        assert effect.parameters["limit"] == pytest.approx(limit, rel=1e-3)
    assert not found.unexplained
    assert found.fit_after.values[:, :3] == pytest.approx(np.stack([ARMATURE, COULOMB, VISCOUS], axis=1), rel=0.03)
