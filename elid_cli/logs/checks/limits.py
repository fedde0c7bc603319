"""Torque, speed and position against the robot's limits: far beyond them is another unit, or another side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.robot.robot import Joint, Robot

BEYOND = 1.5
"""Times the limit of a torque, or of a speed, that no robot was driven at."""
OUTSIDE = 0.25
"""Part of a position's range by which a joint may be outside it: zeros differ."""
MOST = 99.5
"""Percentile that stands for the largest value, so that a glitch does not."""
WRONG = "the unit or the side (motor or joint) is wrong"
"""What every sentence on a torque or a speed beyond its limit says."""
NAMES = {"tau": "effort", "dq": "velocity"}


@dataclass(frozen=True)
class _Beyond:
    """How far one joint is beyond a limit."""

    name: str
    times: float
    """In limits."""
    said: str


def beyond_limits(q: Array, tau: Array, dt: float, robot: Robot) -> Iterator[str]:
    """Yield a sentence per signal that is far beyond the limits of its joints: the farthest, and which others are.

    Parameters
    ----------
    q
        Positions of links or motors at the joint, contiguous, (N, n); not a number where a unit is known to be wrong.
    tau
        Torques at the same instants, (N, n).
    dt
        Sample time, s.
    robot
        Its limits, of which those that are unknown are not looked at.
    """
    speed = np.diff(q, axis=0) / dt if len(q) > 1 else q
    for signal, values in (("tau", tau), ("dq", speed)):
        far = [_fast(joint, signal, values[:, j]) for j, joint in enumerate(robot.joints)]
        yield from _farthest([item for item in far if item is not None], f"{WRONG}, or the limit is")
    outside = [_outside(joint, q[:, j]) for j, joint in enumerate(robot.joints)]
    why = "the unit, the side (motor or joint) or the zero is wrong, or the limits are"
    yield from _farthest([item for item in outside if item is not None], why)


def _farthest(beyond: Sequence[_Beyond], why: str) -> Iterator[str]:
    """Yield what is said of the joint that is farthest beyond its limit, with the other joints' names."""
    if not beyond:
        return
    worst = max(beyond, key=lambda item: item.times)
    others = in_words([item.name for item in beyond if item is not worst])
    also = f" ({others} {'is' if len(beyond) == 2 else 'are'} beyond as well)" if others else ""
    yield f"{worst.name}: {worst.said}{also}: {why}"


def _fast(joint: Joint, signal: str, values: Array) -> _Beyond | None:
    """Return how far torque or speed, (N,), is beyond its limit; None: not far."""
    limit = joint.limits.torque if signal == "tau" else joint.limits.velocity
    known = np.abs(values[np.isfinite(values)])
    if not limit or not known.max(initial=0.0) > BEYOND * limit:
        return None  # as in all but a few logs: no need of the percentile
    largest = float(np.percentile(known, MOST))
    if not largest > BEYOND * limit:
        return None
    unit = joint.units[1] if signal == "tau" else joint.units[0] + "/s"
    return _Beyond(
        joint.name, largest / limit,
        f"{signal} reaches {largest:.4g} {unit}, {largest / limit:.3g} times the {NAMES[signal]} limit of {limit:g}",
    )  # fmt: skip


def _outside(joint: Joint, q: Array) -> _Beyond | None:
    """Return how far positions (N,) are outside their range; None: not far."""
    known = q[np.isfinite(q)]
    if joint.limits.position is None or not known.size:
        return None
    low, high = joint.limits.position
    slack = OUTSIDE * (high - low)
    if known.min() >= low - slack and known.max() <= high + slack:
        return None
    least, most = np.percentile(known, (100 - MOST, MOST)).tolist()
    if least >= low - slack and most <= high + slack:
        return None
    said = f"positions from {least:.4g} to {most:.4g} {joint.units[0]} are outside its limits, {low:g} to {high:g}"
    return _Beyond(joint.name, max(low - least, most - high) / max(high - low, 1e-9), said)
