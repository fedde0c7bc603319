"""Signals moved in time by a fraction of a sample.

The interpolation is that of SciPy's `CubicSpline`, number by number, on LAPACK's tridiagonal solver: importing
`scipy.interpolate` took longer than all the rest of the identification of a log whose torque is late.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.lapack import lapack


def shifted(values: Array, samples: float) -> Array:
    """Return values (N,) as they are `samples` later, by cubic interpolation, held at the ends."""
    if len(values) < 4:
        return values.copy()
    steps, slopes = np.diff(values), _slopes(values)
    bend = slopes[:-1] + slopes[1:] - 2 * steps
    at = np.clip(np.arange(len(values), dtype=float) + samples, 0.0, len(values) - 1.0)
    first = np.minimum(at.astype(np.intp), len(steps) - 1)
    part = at - first
    square = part * part
    moved: Array = values[first] + slopes[first] * part
    moved += (steps - slopes[:-1] - bend)[first] * square
    moved += bend[first] * (square * part)
    return moved


def _slopes(values: Array) -> Array:
    """Return the derivatives, per sample, of the cubic spline through values (N,), N at least 4, at these.

    Its second derivatives agree at every sample, and its third at the second from either end ("not a knot").
    """
    steps = np.diff(values)
    right = np.empty_like(values)
    right[1:-1] = 3 * (steps[:-1] + steps[1:])
    right[0], right[-1] = (5 * steps[0] + steps[1]) / 2, (steps[-2] + 5 * steps[-1]) / 2
    below, middle, above = np.ones(len(steps)), np.full(len(values), 4.0), np.ones(len(steps))
    above[0] = below[-1] = 2.0
    middle[0] = middle[-1] = 1.0
    *_, slopes, _ = lapack().dgtsv(below, middle, above, right)
    return np.asarray(slopes)
