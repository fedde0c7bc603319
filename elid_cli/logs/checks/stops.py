"""Joints that are commanded into the stops at their limits, and stay there: a stop is no friction, and no spring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.robot.robot import Robot

NEAR = 0.02
"""Part of the range within which of a limit, or beyond it, a joint is at its stop …"""
BEYOND = 0.02
"""… and by which its command is beyond the limit."""
TOP, FARTHER, WANTED = 0.15, 0.02, 0.25
"""Parts of the way that a joint goes: from its end within which it is on a visit there, by which a command is beyond,
and by which commands of visits to a stop differ at least."""
VISITS, MOST, GIVES = 5, 0.8, 0.25
"""Visits that commands press at least, part of all, and part of what their commands differ by that a stop yields."""
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
    found, unknown = list[str](), list[str]()
    for j, joint in enumerate(robot.joints):
        told, own = signals["q_des"][:, j], q[:, j]
        low, high = joint.limits.position or (-np.inf, np.inf)
        for end in _ends(told, own):
            if low + NEAR * (high - low) < end < high - NEAR * (high - low) or joint.limits.position is None:
                unknown.append(f"{joint.name} at {end:.3g} {'rad' if joint.revolute else 'm'}")
        if joint.limits.position is None:
            continue
        size = high - low
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
    if unknown:
        yield (
            f"{in_words(unknown)} {'goes' if len(unknown) == 1 else 'go'} no farther, however far commands go beyond: "
            "what seems to be a stop, or a limit of the drive. A stop is not modelled, and friction, springs and "
            "inertia may be found in its place; leave these stretches out"
        )


def _ends(told: Array, own: Array) -> Iterator[float]:
    """Yield the positions that a joint often comes to and never passes, though its commands do by different amounts."""
    known = np.isfinite(told) & np.isfinite(own)
    told, own = told[known], own[known]
    way = float(np.ptp(own)) if own.size else 0.0
    if not way > 0:
        return
    for side in (1.0, -1.0):
        place, wanted = side * own, side * told
        near = np.concatenate([[False], place > place.max() - TOP * way, [False]])
        starts, stops = np.flatnonzero(near[1:] & ~near[:-1]), np.flatnonzero(near[:-1] & ~near[1:])
        visits = [(place[a:b].max(), wanted[a:b].max()) for a, b in zip(starts, stops, strict=True)]
        ends, asked = np.array(visits).T
        pressed = asked > ends + FARTHER * way
        if np.count_nonzero(pressed) < max(VISITS, MOST * len(visits)):
            continue
        if np.ptp(asked[pressed]) > max(WANTED * way, np.ptp(ends[pressed]) / GIVES):
            yield side * float(np.median(ends[pressed]))
