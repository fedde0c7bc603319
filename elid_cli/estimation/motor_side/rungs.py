"""Rungs of a climb in frequency: which there are, the highest that fits, and where two climbs have met."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array

FIRST_RUNG, RATIO = 1.2, 1.4
"""Lowest cut-off, Hz, and the least step between cut-offs."""
_FITS = 4.0
"""A rung above counts while its cost is within this many times the lowest below it."""
_MET = 1e-3
"""Share of the cost, and logarithm of the compliances, within which two climbs have met."""


@dataclass(frozen=True)
class ClimbEnd:
    """Where a climb ended."""

    x: Array
    cost: float
    """Weighted squared residual per frequency and joint: 1 is noise."""
    top: float
    """Highest cut-off that still fitted, Hz."""


def rungs(top: float) -> Array:
    """Return the cut-offs of a climb to `top`, Hz."""
    count = max(3, int(np.ceil(np.log(top / FIRST_RUNG) / np.log(RATIO))) + 1)
    found: Array = np.exp(np.linspace(np.log(FIRST_RUNG), np.log(top), count))
    return found


def highest(trace: Sequence[ClimbEnd]) -> ClimbEnd:
    """Return the highest rung that still fits: above it rectified noise rules."""
    lowest = np.minimum.accumulate([max(1.0, rung.cost) for rung in trace])
    return [rung for rung, least in zip(trace, lowest, strict=True) if rung.cost <= _FITS * least][-1]


def met(
    rung: ClimbEnd, traces: Sequence[list[ClimbEnd]], apart: Callable[[Array, Array], float]
) -> list[ClimbEnd] | None:
    """Return the rungs of an earlier climb that a rung stands on, or None: from there on the two are the same.

    `apart` gives the largest logarithm of a ratio of two answers' compliances.
    """
    for trace in traces:
        for other in trace:
            near = other.top == rung.top and abs(other.cost - rung.cost) < _MET * rung.cost
            if near and apart(other.x, rung.x) < _MET:
                return trace
    return None
