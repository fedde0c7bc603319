"""Local polynomial interpolation between samples; never across a gap, and never from far away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK = 1 << 15
"""Points interpolated at once, to bound memory."""


def interpolate(t: Array, values: Array, at: Array, *, order: int = 6) -> Array:
    """Return values at other times by Lagrange polynomials through the `order` nearest samples.

    Parameters
    ----------
    t
        Times of the samples, s, strictly ascending, shape (N,).
    values
        Samples, shape (N, k), finite.
    at
        Times wanted, shape (M,), within `t` (or at most a sample outside).
    order
        Samples per polynomial: 6 for even spacing, 4 where the spacing is uneven (less noise gain).

    Returns
    -------
    Shape (M, k).
    """
    order = min(order, t.size)
    result = np.empty((at.size, values.shape[1]))
    for start in range(0, at.size, BLOCK):
        points = at[start : start + BLOCK]
        first = np.clip(np.searchsorted(t, points) - order // 2, 0, t.size - order)
        nodes = t[first[:, None] + np.arange(order)]
        block = np.zeros((points.size, values.shape[1]))
        for j in range(order):
            weight = np.ones(points.size)
            for m in range(order):
                if m != j:
                    weight *= (points - nodes[:, m]) / (nodes[:, j] - nodes[:, m])
            block += weight[:, None] * values[first + j]
        result[start : start + BLOCK] = block
    return result
