"""Errors of simulated positions, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.robot import Robot

FARTHEST = 100.0
"""rad (m) from the measured motion; a simulation that is farther off has run away, and how far says nothing."""


@dataclass(frozen=True)
class PositionError:
    """Simulated minus measured position of a joint, rad (m)."""

    rms: float
    mean_abs: float
    offset: float
    """Constant part: the mean."""


def position_errors(robot: Robot, difference: Array) -> Mapping[str, PositionError]:
    """Return the error of every joint from differences (M, n) of positions, rad (m); NaN where nothing was measured.

    A simulation that ran away leaves an infinite error.
    """
    found = {}
    for k, name in enumerate(robot.joint_names):
        e = difference[:, k][~np.isnan(difference[:, k])]
        size = np.where(np.abs(e) < FARTHEST, e, np.inf)
        if len(size):
            found[name] = PositionError(
                float(np.sqrt(np.mean(size**2))), float(np.mean(np.abs(size))), float(np.mean(size))
            )
    return found


def runaways(error: Mapping[str, PositionError]) -> tuple[str, ...]:
    """Return the joints whose simulated motion ran away."""
    return tuple(name for name, e in error.items() if not isfinite(e.mean_abs))


def overall(error: Mapping[str, PositionError]) -> float:
    """Return the mean absolute error of all joints, rad (m)."""
    return float(np.mean([e.mean_abs for e in error.values()]))
