"""Ranges of joints, and those that are taken where the robot file gives none."""

from __future__ import annotations

from elid_cli.robot.robot import Joint

REVOLUTE_RANGE = (-1.2, 1.2)
"""Range, rad, of a revolute joint whose limits are unknown."""
PRISMATIC_RANGE = (-0.1, 0.1)
"""Range, m, of a prismatic joint whose limits are unknown."""


def range_of(joint: Joint) -> tuple[float, float]:
    """Return the range of a joint, rad or m, or a default where its limits are unknown."""
    if joint.limits.position is not None:
        return joint.limits.position
    return REVOLUTE_RANGE if joint.revolute else PRISMATIC_RANGE
