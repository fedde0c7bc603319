"""Commands in another unit than the positions are told, with a mapping to paste."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.logs.checks.command_scale import TWO_UNITS, command_scales
from elid_cli.logs.reading import read_recording
from elid_cli.report.answers.summary import doubted
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot

T = np.linspace(0, 10, 1000)


def arm() -> Robot:
    robot = read_robot("planar2")
    return replace(robot, joints=tuple(replace(joint, transmission="rigid") for joint in robot.joints))


def warnings(tmp_path: Path, told: np.ndarray, own: np.ndarray) -> list[str]:
    """Return what is said of a log of positions and commands, (N, 2) each."""
    columns = [T, *own.T, *told.T]
    head = "t,q.joint1,q.joint2,q_des.joint1,q_des.joint2"
    np.savetxt(tmp_path / "log.csv", np.stack(columns, axis=1), delimiter=",", header=head, comments="")
    found = read_recording([str(tmp_path / "log.csv")], arm(), {"kp": {"value": 20.0}, "kd": {"value": 0.5}})
    return [line for line in found.warnings if TWO_UNITS in line]


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Return commands and the positions of drives that follow them badly, rad, (N, 2)."""
    told = np.stack([0.4 * np.sin(2 * T), 0.3 * np.sin(3 * T)], axis=1)
    own = np.stack([0.36 * np.sin(2 * T - 0.4), 0.33 * np.sin(3 * T - 0.5)], axis=1) + 0.1
    return told, own


def test_commands_in_degrees_are_told(tmp_path: Path) -> None:
    told, own = motion()
    (line,) = warnings(tmp_path, np.rad2deg(told), own)
    assert line.startswith("the commands of joint1 and joint2 go ")
    assert line.endswith('map it: q_des: {from: "q_des.{joint}", unit: deg}')
    assert doubted("Yes: it fits.", [line]).startswith("Only if")


def test_commands_of_one_joint_in_degrees_are_told(tmp_path: Path) -> None:
    told, own = motion()
    (line,) = warnings(tmp_path, told * [1.0, np.rad2deg(1.0)], own)
    assert "unit: {joint2: deg}" in line


def test_positions_in_degrees_beside_commands_in_rad_are_told(tmp_path: Path) -> None:
    told, own = motion()
    (line,) = warnings(tmp_path, told, np.rad2deg(own))
    assert "q: {from:" in line
    assert "unit: deg" in line


@pytest.mark.parametrize("size", [0.1, 0.5, 1.0, 2.0, 10.0])
def test_drives_that_follow_badly_are_not_told(size: float) -> None:
    told, own = motion()
    assert command_scales({"q_des": size * told}, own, arm()) == []
    assert (
        command_scales({"q_des": np.rad2deg(told)[::-1]}, np.random.default_rng(0).normal(size=own.shape), arm()) == []
    )
    assert command_scales({}, own, arm()) == []
