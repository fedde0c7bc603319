"""Signals moved in time by a fraction of a sample."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.lapack import lapack


def shifted(values: Array, samples: float) -> Array:
    """Return values (N,) as they are `samples` later, held at the ends.

    A cubic spline goes through them, which has no knot at the second sample from either end.
    """
    if len(values) < 4:
        return values.copy()
    slopes = _slopes(values)
    place = np.clip(np.arange(len(values)) + samples, 0.0, len(values) - 1.0)
    left = np.minimum(place.astype(np.intp), len(values) - 2)
    u = place - left
    rest = 1.0 - u
    moved: Array = (values[left] * (1.0 + 2.0 * u) + slopes[left] * u) * rest**2 + (
        values[left + 1] * (1.0 + 2.0 * rest) - slopes[left + 1] * rest
    ) * u**2  # Hermite's cubic in every interval
    return moved


def _slopes(values: Array) -> Array:
    """Return the slopes per sample that make the second derivative continuous, (N,)."""
    rise = np.diff(values)
    right = np.empty_like(values)
    right[1:-1] = 3.0 * (rise[1:] + rise[:-1])
    right[0] = 0.5 * (5.0 * rise[0] + rise[1])
    right[-1] = 0.5 * (5.0 * rise[-1] + rise[-2])
    middle = np.full(len(values), 4.0)
    middle[[0, -1]] = 1.0
    above, below = np.ones((2, len(values) - 1))
    above[0] = below[-1] = 2.0
    found: Array = lapack().dgtsv(below, middle, above, right)[3]
    return found
