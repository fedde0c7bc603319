"""Positions in another unit, told by the weight of the bodies that the robot's file describes.

How the torque that holds the bodies changes with the positions depends on how far these go: positions that are ten
times too small make a torque of the right size look too large, and another function of the positions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.logs.checks.encoder_pairs import proposed, times
from elid_cli.logs.checks.known_masses import Scale, Weighed, weight_scales
from elid_cli.logs.checks.limits import WRONG
from elid_cli.logs.checks.torque_scale import SURE
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.robot.robot import Robot

UNITS = {math.pi / 180: "deg", 2 * math.pi: "rev"}
FACTORS = (10.0, 100.0, 1000.0, 2 * math.pi, 180 / math.pi, 0.1, 0.01, 1e-3, 0.5 / math.pi, math.pi / 180)
"""What positions may have to be multiplied by."""
FURTHEST = 4 * math.pi
"""rad that no joint goes from end to end in a log, unless its positions are too large."""
BETTER = 4.0
"""Times by which the weight must explain the torque better, by what it leaves of its variance."""
NEAR = 2.0
"""Factor up to which the torque must then be of the size of the weight."""


class Found(NamedTuple):
    """What positions must be multiplied by, and those of which joints."""

    factor: float
    joints: NDArray[np.bool_]
    """(n,)"""


def position_words(found: Found, robot: Robot, plan: ReadPlan) -> str:
    """Return the sentence on positions that torques hold the described bodies' weight at."""
    best, names = found.factor, [name for name, own in zip(robot.joint_names, found.joints, strict=True) if own]
    size = f"{best:.3g} times too small" if best > 1 else f"{1 / best:.3g} times too large"
    asked = "; ".join(
        proposed(plan, side, _key(plan, side, found, robot)) for side in ("q", "theta") if side in plan.placements
    )
    whose = "positions" if _all(found, robot) else f"positions of {in_words(names)}"
    return (
        f"{whose} look {size}: at positions of that size the torques hold the weight of the described bodies, and as "
        f"they are they do not: {WRONG}; {asked}"
    )


def position_factor(log: Weighed) -> Found | None:
    """Return what makes positions those at which torques hold the described bodies' weight; None: they are, or nothing.

    Joints that go farther than any does may be the only ones in another unit.
    """
    q, robot = log.q, log.robot
    turning = np.array([joint.revolute for joint in robot.joints])
    if not turning.any() or not np.isfinite(q[:, turning]).any():
        return None
    ranges = np.where(turning, _ranges(q), 0.0)
    far = float(ranges.max())
    tried = [factor for factor in FACTORS if (factor > 1) != (far > FURTHEST) and factor * far < FURTHEST]
    if not tried:
        return None
    seen = log.scales
    if seen and all(1 / NEAR < scale.ratio < NEAR for scale in seen):
        return None
    parts = [turning, *([ranges > FURTHEST] if far > FURTHEST and (turning & (ranges <= FURTHEST)).any() else [])]
    choices = [Found(factor, part) for part in parts for factor in tried]
    now = _left(seen, robot.n)
    best, least = None, math.inf
    factors = np.array([np.where(choice.joints, choice.factor, 1.0) for choice in choices])
    for choice, scales in zip(choices, weight_scales(q, log.tau, log.dt, robot, factors), strict=True):
        margins = [SURE * s.deviation for s in scales]
        may = all(1 / NEAR - m < s.ratio < NEAR + m for s, m in zip(scales, margins, strict=True))
        if not may or not any(1 / NEAR < s.ratio < NEAR for s in scales):
            continue
        joints = [s.joint for s in scales]
        gain = float(np.sum(now[joints])) / max(float(np.sum(_left(scales, robot.n)[joints])), 1e-12)
        if gain > BETTER and 1 / gain < least:
            best, least = choice, 1 / gain
    return best


def _ranges(q: Array) -> Array:
    """Return how far each joint goes, (n,); 0 where nothing is known."""
    known = np.isfinite(q).any(axis=0)
    ranges = np.zeros(q.shape[1])
    ranges[known] = np.nanmax(q[:, known], axis=0) - np.nanmin(q[:, known], axis=0)
    return ranges


def _all(found: Found, robot: Robot) -> bool:
    return all(own or not joint.revolute for own, joint in zip(found.joints, robot.joints, strict=True))


def _key(plan: ReadPlan, side: str, found: Found, robot: Robot) -> str:
    """Return the mapping's key that makes positions larger by a factor, beside what is written of them."""
    written = set(plan.placements[side].spec.written or {}) & {"unit", "scale"}
    names = [name for name, own in zip(robot.joint_names, found.joints, strict=True) if own]
    if found.factor in UNITS and not written:
        unit = UNITS[found.factor]
        if _all(found, robot):
            return f"unit: {unit}"
        return f"unit: {{{', '.join(f'{name}: {unit}' for name in names)}}}"
    return times(plan, side, dict.fromkeys(names, found.factor), robot.joint_names)


def _left(scales: list[Scale], joints: int) -> Array:
    """Return which part of each joint's torque its weight leaves, beside friction and accelerations; 1: not shown."""
    left = np.ones(joints)
    for scale in scales:
        if math.isfinite(scale.ratio) and scale.ratio > 0:
            left[scale.joint] = 1.0 - scale.correlation**2
    return left
