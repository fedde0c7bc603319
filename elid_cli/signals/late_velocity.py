"""By how much a logged velocity is late against the position of its joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array

WINDOW = 0.05
"""s, about, over which the position's change is compared with the velocity's integral."""
BLOCKS = 6
"""Parts of a log whose differences give the error."""
FEWEST = 50
"""Windows in a part below which nothing is said."""


@dataclass(frozen=True)
class Delay:
    """By how much a joint's velocity is late against its position."""

    joint: int
    value: float
    """s; negative where the position is late."""
    std_error: float


def delay_of(q: Array, dq: Array, dt: float, joint: int) -> Delay | None:
    """Return by how much a velocity (N,) is late against a position (N,); None where that cannot be told.

    Over any window the position changes by the velocity's integral. A late velocity leaves its change over the window
    times the delay, beside what a wrong scale of it leaves.
    """
    half = max(1, round(0.5 * WINDOW / dt))
    if len(q) < 2 * half + BLOCKS * FEWEST or not (np.isfinite(q).all() and np.isfinite(dq).all()):
        return None
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (dq[1:] + dq[:-1]) * dt)])
    integral, change = whole[2 * half :] - whole[: -2 * half], dq[2 * half :] - dq[: -2 * half]
    left = q[2 * half :] - q[: -2 * half] - integral
    known = np.stack([change, integral], axis=1)
    parts = np.array_split(np.arange(len(left)), BLOCKS)
    delays = []
    for part in parts:
        step, _, rank, _ = np.linalg.lstsq(known[part], left[part], rcond=1e-9)
        if rank < 2:
            return None
        delays.append(float(step[0] / (1.0 + step[1])))  # a wrong scale is of the velocity's change as well
    step = np.linalg.lstsq(known, left, rcond=1e-9)[0]
    return Delay(joint, float(step[0] / (1.0 + step[1])), float(np.std(delays, ddof=1)) / BLOCKS**0.5)
