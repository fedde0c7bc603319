"""Joints that a robot file declares rigid and that a log shows to yield."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli.logs.reading import read_recording
from elid_cli.robot.files import read_robot

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("transmission", "told"), [("rigid", True), ("elastic", False)])
def test_a_deflection_that_follows_the_torque_is_told_of_a_rigid_joint(transmission: str, told: bool) -> None:
    robot = read_robot(ROOT / "robots" / "planar2.yaml")
    joints = (robot.joints[0], replace(robot.joints[1], transmission=transmission))
    recording = read_recording([str(ROOT / "sample_logs" / "planar2.h5")], replace(robot, joints=joints))
    said = [line for line in recording.warnings if "counts as rigid, but" in line]
    assert len(said) == told
    assert all(line.startswith(f"{robot.joints[1].name}: ") and "mrad (rms)" in line for line in said)
