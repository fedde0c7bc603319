"""Sine and cosine of many angles at once.

NumPy takes each by the C library, value by value; from a table of 512 directions and a short series for what is left,
both together take a third of that, to the last digit but one.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array

_DIRECTIONS = 512
_EXACT = 2 * np.longdouble("3.14159265358979323846264338327950288") / _DIRECTIONS
# Cody and Waite: the step in a part of few digits, whose multiples are exact, and the rest
_COARSE = float(np.float32(_EXACT))
_FINE = float(_EXACT - _COARSE)
_FAR = 1e4
"""rad; angles beyond are left to the library, as is what is no number."""
_LEAST = 64
"""Angles below which the table does not pay."""
_SINE, _COSINE = (f(_EXACT * np.arange(_DIRECTIONS)).astype(np.float64) for f in (np.sin, np.cos))


def sine_and_cosine(angles: Array, sine: Array, cosine: Array) -> None:
    """Write sine and cosine of angles (N,), rad, into `sine` and `cosine` (N,)."""
    if len(angles) < _LEAST or not np.abs(angles).max() < _FAR:
        np.sin(angles, out=sine)
        np.cos(angles, out=cosine)
        return
    nearest = angles * (_DIRECTIONS / (2.0 * np.pi))
    np.rint(nearest, out=nearest)
    place = nearest.astype(np.int32)
    place &= _DIRECTIONS - 1
    rest = nearest * -_COARSE
    rest += angles
    nearest *= _FINE
    rest -= nearest
    square = np.multiply(rest, rest, out=nearest)
    tail = square * (1.0 / 120.0)  # sin r = r + r * square * (square / 120 - 1 / 6)
    tail -= 1.0 / 6.0
    tail *= square
    tail *= rest
    rest += tail
    np.multiply(square, -1.0 / 24.0, out=tail)  # 1 - cos r = square * (1 / 2 - square / 24)
    tail += 0.5
    square *= tail
    # sin(a + r) = sin a - (sin a (1 - cos r) - cos a sin r)
    np.take(_SINE, place, out=sine)
    np.take(_COSINE, place, out=cosine)
    change = sine * square
    other = cosine * rest
    change -= other
    square *= cosine
    rest *= sine
    square += rest
    sine -= change
    cosine -= square
