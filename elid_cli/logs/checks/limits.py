"""Torque, speed and position against the robot's limits: far beyond them is another unit, or another side."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.robot import Robot

BEYOND = 1.5
"""Times the limit of a torque, or of a speed, that no robot was driven at."""
OUTSIDE = 0.25
"""Part of a position's range by which a joint may be outside it: zeros differ."""
MOST = 99.5
"""Percentile that stands for the largest value, so that a glitch does not."""
WRONG = "the unit or the side (motor or joint) is wrong"
"""What every sentence on a torque or a speed beyond its limit says."""
NAMES = {"tau": "effort", "dq": "velocity"}


def beyond_limits(q: Array, tau: Array, dt: float, robot: Robot) -> Iterator[str]:
    """Yield a sentence per joint and signal that is far beyond the joint's limits.

    Parameters
    ----------
    q
        Positions of links or motors at the joint, contiguous, (N, n).
    tau
        Torques at the same instants, (N, n).
    dt
        Sample time, s.
    robot
        Its limits, of which those that are unknown are not looked at.
    """
    speed = np.diff(q, axis=0) / dt if len(q) > 1 else q
    for j, joint in enumerate(robot.joints):
        limits, turns = joint.limits, joint.revolute
        units = {"tau": "N·m" if turns else "N", "dq": "rad/s" if turns else "m/s"}
        for signal, values, limit in (("tau", tau[:, j], limits.torque), ("dq", speed[:, j], limits.velocity)):
            if not limit:
                continue
            known = np.abs(values[np.isfinite(values)])
            if not known.max(initial=0.0) > BEYOND * limit:
                continue  # as in all but a few logs: no need of the percentile
            largest = float(np.percentile(known, MOST))
            if largest > BEYOND * limit:
                yield (
                    f"{joint.name}: {signal} reaches {largest:.4g} {units[signal]}, {largest / limit:.3g} times the "
                    f"{NAMES[signal]} limit of {limit:g}: {WRONG}, or the limit is"
                )
        known = q[np.isfinite(q[:, j]), j]
        if limits.position is None or not known.size:
            continue
        low, high = limits.position
        slack = OUTSIDE * (high - low)
        if known.min() >= low - slack and known.max() <= high + slack:
            continue
        least, most = np.percentile(known, (100 - MOST, MOST)).tolist()
        if least < low - slack or most > high + slack:
            unit = "rad" if turns else "m"
            yield (
                f"{joint.name}: positions from {least:.4g} to {most:.4g} {unit} are outside its limits, {low:g} to "
                f"{high:g}: the unit, the side (motor or joint) or the zero is wrong, or the limits are"
            )
