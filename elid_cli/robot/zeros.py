"""Joints whose positions are read from another zero: the robot turned so that its geometry fits what is read."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.frames import rotation_rpy, rotation_z, rpy_of, z_to
from elid_cli.robot.robot import Convention, Joint, Robot


def with_zeros(robot: Robot, offsets: Array) -> Robot:
    """Return the robot whose joints' positions, as they are read, are too large by offsets, rad (m), (n,)."""
    joints = (
        _moved(joint, offset, robot.dh) if offset else joint
        for joint, offset in zip(robot.joints, offsets.tolist(), strict=True)
    )
    return replace(robot, joints=tuple(joints))


def zero_between(before: Robot, after: Robot, joint: int) -> float:
    """Return by how much a joint's positions are read too large in one description and not in another, rad (m).

    For descriptions as URDF and MJCF have them, whose joints move about z of their own frame.
    """
    (one, _), (other, _) = (robot.placements()[joint] for robot in (before, after))
    change = np.linalg.solve(one, other)
    if before.joints[joint].revolute:
        return -math.atan2(change[1, 0], change[0, 0])
    return -float(change[2, 3])


def _moved(joint: Joint, offset: float, convention: Convention) -> Joint:
    if convention != "urdf":
        return replace(joint, theta=joint.theta - offset) if joint.revolute else replace(joint, d=joint.d - offset)
    turn = rotation_rpy(joint.rpy)
    if not joint.revolute:
        x, y, z = (p - offset * float(a) for p, a in zip(joint.xyz, turn[:3, :3] @ joint.axis, strict=True))
        return replace(joint, xyz=(x, y, z))
    align = z_to(joint.axis)
    return replace(joint, rpy=rpy_of(turn @ align @ rotation_z(-offset) @ align.T))
