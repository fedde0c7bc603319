"""Does most of a residual lie in one short moment of the log.

A stop, a collision or a torque channel that hung for a third of a second bends every parameter, and what is left of it
follows many things a little. Where it lies tells more than what it follows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

SHORT = 0.05
"""Share of a row's instants that is a moment."""
LONGEST = 5.0
"""s that it lasts at most: a stop, a collision, a channel that hangs."""
MOST = 0.6
"""Share of what is left beyond noise that must lie in it; of residuals of models that lack an effect up to 0.3 does."""
CORE = 0.95
"""Share of that by which its bounds are told …"""
BESIDE = 0.25
"""… and s beside them, for what a filter spreads."""
FEWEST = 3
"""Instants of a moment at least."""


def moment_of(residual: Array, use: NDArray[np.bool_], t: Array, floor: float) -> tuple[float, float] | None:
    """Return the moment (start, stop), s, in which most of a residual lies; None where there is none.

    Parameters
    ----------
    residual
        N·m (N), (M,).
    use
        Instants that count, (M,).
    t
        Their times, s, (M,).
    floor
        rms that noise alone would leave.
    """
    squares, times = residual[use] ** 2, t[use]
    width = int(SHORT * len(squares))
    if width < FEWEST:
        return None
    sums = np.concatenate([[0.0], np.cumsum(squares)])
    beyond = sums[-1] - len(squares) * floor**2
    inside = sums[width:] - sums[:-width]
    first = int(np.argmax(inside))
    own = inside[first]
    lasts = times[first + width - 1] - times[first]
    if not own > MOST * beyond or lasts > min(2 * SHORT * (times[-1] - times[0]), LONGEST):
        return None
    edge = (1 - CORE) / 2 * own
    part = sums[first : first + width + 1] - sums[first]
    start = first + int(np.searchsorted(part, edge, side="right")) - 1
    stop = first + int(np.searchsorted(part, own - edge)) - 1
    return max(float(times[start]) - BESIDE, float(t[0])), min(float(times[stop]) + BESIDE, float(t[-1]))
