"""Sizes of position errors: joints that turn and joints that slide are never averaged."""

from __future__ import annotations

from dataclasses import replace

from elid_cli.robot.files import read_robot
from elid_cli.robot.position_words import largest_words, mean_words, small_unit


def test_turning_and_sliding_joints_are_told_apart() -> None:
    robot = read_robot("planar2")
    first, second = robot.joint_names
    sizes = {first: 2e-4, second: 4e-4}
    assert mean_words(robot, sizes, 2) == "0.3 mrad"
    assert mean_words(robot, sizes, 2, bare=True) == "0.3"
    mixed = replace(robot, joints=(replace(robot.joints[0], type="prismatic"), robot.joints[1]))
    assert [small_unit(mixed, name) for name in mixed.joint_names] == ["mm", "mrad"]
    told = f"0.2 mm ({first}) and 0.4 mrad ({second})"
    assert mean_words(mixed, sizes, 2) == told
    assert mean_words(mixed, sizes, 2, bare=True) == told
    assert mean_words(robot, {first: 1.23456}, 3) == "1230 mrad"
    assert largest_words(robot, sizes) == f"0.4 mrad rms (at {second})"
    assert set(largest_words(mixed, sizes).split(" and ")) == {
        f"0.2 mm rms (at {first})", f"0.4 mrad rms (at {second})",
    }  # fmt: skip
