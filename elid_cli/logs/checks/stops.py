"""Joints that are commanded into the stops at their limits, and stay there: a stop is no friction, and no spring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.robot import Robot

NEAR = 0.02
"""Part of the range within which of a limit, or beyond it, a joint is at its stop …"""
BEYOND = 0.02
"""… and by which its command is beyond the limit."""
LEAST = 0.005
"""Part of the samples from which it is told."""


def at_stops(signals: Mapping[str, Array], q: Array, robot: Robot) -> Iterator[str]:
    """Yield a sentence on the joints that commands press against their limits.

    Parameters
    ----------
    signals
        ``q_des``, (N, n), of contiguous samples.
    q
        Positions at the same instants, (N, n).
    robot
        Its limits, of which those that are unknown are not looked at.
    """
    if "q_des" not in signals:
        return
    found = []
    for j, joint in enumerate(robot.joints):
        if joint.limits.position is None:
            continue
        low, high = joint.limits.position
        size, told, own = high - low, signals["q_des"][:, j], q[:, j]
        pressed = (told > high + BEYOND * size) & (own > high - NEAR * size)
        pressed |= (told < low - BEYOND * size) & (own < low + NEAR * size)
        # what goes on as far as it is told met no stop
        pressed &= np.abs(own - np.clip(own, low, high)) < 0.5 * np.abs(told - np.clip(told, low, high))
        share = float(np.mean(pressed)) if len(pressed) else 0.0
        if share > LEAST:
            found.append(f"{joint.name} ({100 * share:.2g} % of the samples)")
    if found:
        yield (
            f"commands press {', '.join(found)} against the limit of its position: what a stop does is not modelled, "
            "and friction, springs and inertia may be found in its place; leave these stretches out"
        )
