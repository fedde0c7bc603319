"""Cubic splines through samples, without the import of `scipy.interpolate`, which takes a third of a second."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.lapack import lapack


class CubicSpline:
    """The spline through columns y (N, n) at instants t (N,) whose third derivative is continuous next to the ends.

    As SciPy's of that name; beyond the ends the outermost pieces go on. N is at least 4.
    """

    def __init__(self, t: Array, y: Array) -> None:
        dt = np.diff(t)
        step, slope = dt[:, None], np.diff(y, axis=0) / dt[:, None]
        diagonal = np.r_[dt[1], 2 * (dt[:-1] + dt[1:]), dt[-2]]
        above, below = np.r_[t[2] - t[0], dt[:-1]], np.r_[dt[1:], t[-1] - t[-3]]
        sides = np.empty_like(y)
        sides[1:-1] = 3 * (step[1:] * slope[:-1] + step[:-1] * slope[1:])
        (a, b), (d, c) = dt[:2], dt[-2:]
        sides[0] = ((a + 2 * above[0]) * b * slope[0] + a**2 * slope[1]) / above[0]
        sides[-1] = (c**2 * slope[-2] + (2 * below[-1] + c) * d * slope[-1]) / below[-1]
        rates: Array = lapack().dgtsv(below, diagonal, above, sides)[3]
        bend = (rates[:-1] + rates[1:] - 2 * slope) / step
        self._t = t
        self._pieces = y[:-1], rates[:-1], (slope - rates[:-1]) / step - bend, bend / step
        """Coefficients of the powers of the time since a piece began, (N - 1, n) each."""

    def __call__(self, t: Array) -> Array:
        """Return the values at instants t (M,), (M, n)."""
        piece = np.clip(np.searchsorted(self._t, t, "right") - 1, 0, len(self._t) - 2)
        since = (t - self._t[piece])[:, None]
        value, rate, bend, change = (part[piece] for part in self._pieces)
        found: Array = value + since * (rate + since * (bend + since * change))
        return found
