"""Positions in another unit, told by the weight of the bodies that the robot's file describes.

How the torque that holds the bodies changes with the positions depends on how far these go: positions that are ten
times too small make a torque of the right size look too large, and another function of the positions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from elid_cli._types import Array
from elid_cli.logs.checks.encoder_pairs import proposed, times
from elid_cli.logs.checks.known_masses import Scale, Weighed, weight_scales
from elid_cli.logs.checks.limits import WRONG
from elid_cli.logs.checks.torque_scale import SURE
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.robot.robot import Robot

UNITS = {math.pi / 180: "unit: deg", 2 * math.pi: "unit: rev"}
FACTORS = (10.0, 100.0, 1000.0, 2 * math.pi, 180 / math.pi, 0.1, 0.01, 1e-3, 0.5 / math.pi, math.pi / 180)
"""What positions may have to be multiplied by."""
FURTHEST = 4 * math.pi
"""rad that no joint goes from end to end in a log, unless its positions are too large."""
BETTER = 4.0
"""Times by which the weight must explain the torque better, by what it leaves of its variance."""
NEAR = 2.0
"""Factor up to which the torque must then be of the size of the weight."""


def wrong_positions(log: Weighed, plan: ReadPlan) -> Iterator[str]:
    """Yield a sentence where torques hold the described bodies' weight at positions of another size.

    The plan says where they were read from.
    """
    q, robot = log.q, log.robot
    turning = np.array([joint.revolute for joint in robot.joints])
    if not turning.any() or not np.isfinite(q[:, turning]).any():
        return
    far = float(np.nanmax(np.nanmax(q[:, turning], axis=0) - np.nanmin(q[:, turning], axis=0)))
    tried = [factor for factor in FACTORS if (factor > 1) != (far > FURTHEST) and factor * far < FURTHEST]
    if not tried:
        return
    seen = log.scales
    if seen and all(1 / NEAR < scale.ratio < NEAR for scale in seen):
        return
    now = _left(seen, robot.n)
    best, least = 1.0, math.inf
    factors = np.where(turning, np.array(tried)[:, None], 1.0)
    for factor, scales in zip(tried, weight_scales(q, log.tau, log.dt, robot, factors), strict=True):
        margins = [SURE * s.deviation for s in scales]
        may = all(1 / NEAR - m < s.ratio < NEAR + m for s, m in zip(scales, margins, strict=True))
        if not may or not any(1 / NEAR < s.ratio < NEAR for s in scales):
            continue
        joints = [s.joint for s in scales]
        gain = float(np.sum(now[joints])) / max(float(np.sum(_left(scales, robot.n)[joints])), 1e-12)
        if gain > BETTER and 1 / gain < least:
            best, least = factor, 1 / gain
    if best == 1.0:
        return
    size = f"{best:.3g} times too small" if best > 1 else f"{1 / best:.3g} times too large"
    asked = "; ".join(
        proposed(plan, side, _key(plan, side, best, robot)) for side in ("q", "theta") if side in plan.placements
    )
    yield (
        f"positions look {size}: at positions of that size the torques hold the weight of the described bodies, and as "
        f"they are they do not: {WRONG}; {asked}"
    )


def _key(plan: ReadPlan, side: str, factor: float, robot: Robot) -> str:
    """Return the mapping's key that makes positions larger by a factor, beside what is written of them."""
    written = set(plan.placements[side].spec.written or {}) & {"unit", "scale"}
    if factor in UNITS and not written:
        return UNITS[factor]
    return times(plan, side, {joint.name: factor for joint in robot.joints if joint.revolute}, robot.joint_names)


def _left(scales: list[Scale], joints: int) -> Array:
    """Return which part of each joint's torque its weight leaves, beside friction and accelerations; 1: not shown."""
    left = np.ones(joints)
    for scale in scales:
        if math.isfinite(scale.ratio) and scale.ratio > 0:
            left[scale.joint] = 1.0 - scale.correlation**2
    return left
