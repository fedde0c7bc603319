"""Joints that are told to stand still, or that a brake holds, in logs of commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import moved, robot, written


@pytest.mark.parametrize("still", [False, True])
def test_a_joint_that_is_told_to_stand_still_is_known_roughly(tmp_path: Path, still: bool) -> None:
    arm, log = robot(tmp_path), moved(6, 6.0, noise=3e-5)
    if still:  # what it does between its commands is then none of its own
        commands = {**log.commands, "q_des": log.commands["q_des"] * [1.0, 0.0, 1.0],
                    "dq_des": log.commands["dq_des"] * [1.0, 0.0, 1.0]}  # fmt: skip
        log = replace(log, commands=commands)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    found = identify(arm, signals, EstimateOptions(fit="trajectory"))
    marked = {item.leader.joint for item in found.parameters if item.bias_possible}
    drives = found.settings["trajectory"]["joint_parameters"]  # type: ignore[index]
    assert (1 in marked) is still
    assert ({own["verdict"] for own in drives["two"].values()} == {"weak"}) is still
    assert any("two is told to stand still" in warning for warning in found.warnings) is still
    assert {own["verdict"] for own in drives["one"].values()} == {"supported"}


def test_a_joint_that_a_brake_holds_is_locked(tmp_path: Path) -> None:
    arm, log = robot(tmp_path), moved(6, 6.0, noise=3e-5)
    held = log.q * [1.0, 0.0, 1.0] + [0.0, 0.3, 0.0]
    file = written(tmp_path, "log.h5", replace(log, q=held, theta=held, dq=None))
    seen = robot_as_logged(read_robot(str(arm.source)), [file])
    assert seen.joint_names == ("one", "three")
    assert seen.held == {"two": pytest.approx(0.3)}
