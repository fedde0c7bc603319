"""Other zeros of encoders that a log may have been read with: further away than a fit finds that turns step by step.

A zero that is a quarter of a turn off, as where the conventions of a robot file and of a drive meet, leaves a model
that is wrong in every pose, from which no small step leads down. So a circle of zeros is tried, all parameters fitted
anew to each, and the lowest valleys of the misfit are followed to their grounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.triangles import Triangles

STARTS = 8
"""Zeros that are tried around the circle; the quarter turns are among them."""
FOLLOWED = 3
"""Valleys that are followed."""
_STEPS, _CLOSE = 8, 0.02
"""Most fits to follow a valley, and rad within which its ground is found."""


class Valley(NamedTuple):
    """A zero of one joint that fits better than its neighbours."""

    misfit: float
    joint: int
    offset: float
    """By how much further the joint's positions are read too large, rad, from 0 to 2 pi."""


def misfit(triangles: Triangles, rank: int) -> float:
    """Return minus the log-likelihood of equations at their best parameters, each row group in its own noise."""
    weights = reweighted(triangles, rank).weights
    return -sum(t.count * float(np.log(weights[t.row])) for t in triangles.items if weights.get(t.row, 0.0) > 0)


def valleys(joints: Iterable[int], here: float, cost: Callable[[int, float], float]) -> list[Valley]:
    """Return the valleys of the misfit over the zeros of single joints, lowest first, that are below the present ones.

    Parameters
    ----------
    joints
        Joints whose zeros are tried.
    here
        Misfit at the present zeros.
    cost
        Returns the misfit with a joint's zero moved, rad.
    """
    from scipy.optimize import minimize_scalar

    step, found = 2.0 * np.pi / STARTS, list[Valley]()
    for joint in joints:
        around = [here, *(cost(joint, k * step) for k in range(1, STARTS))]
        lowest = [k for k in range(1, STARTS) if around[k] <= min(around[k - 1], around[(k + 1) % STARTS])]
        found += [Valley(around[k], joint, k * step) for k in lowest if around[k] < here]
    followed = []
    for valley in sorted(found)[:FOLLOWED]:
        low, high = valley.offset - step, valley.offset + step
        ground = minimize_scalar(
            lambda offset, joint=valley.joint: cost(joint, float(offset)),
            bounds=(low, high),
            method="bounded",
            options={"maxiter": _STEPS, "xatol": _CLOSE},
        )
        best = Valley(float(ground.fun), valley.joint, float(ground.x))
        followed.append(min(valley, best))
    return sorted(followed)
