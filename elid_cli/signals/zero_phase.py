"""A Butterworth low-pass forwards and backwards, without the import of `scipy.signal`, which takes a second."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.lapack import lapack

_PADDED = 15
"""Samples by which either end is continued, turned about its last one (those of SciPy's `sosfiltfilt` for order 4)."""
_PAIRS = 2
"""Pairs of poles: order 4."""


def zero_phase(values: Array, cutoff: float, dt: float) -> Array:
    """Return columns (N, ...) after a Butterworth filter of order 4 in both directions, as `sosfiltfilt` gives them.

    Parameters
    ----------
    values
        Evenly spaced samples, more than 15.
    cutoff
        -3 dB of one direction, Hz.
    dt
        Sample time, s.
    """
    count = len(values)
    flat = values.reshape(count, -1)
    before, after = 2 * flat[0] - flat[_PADDED:0:-1], 2 * flat[-1] - flat[-2 : -_PADDED - 2 : -1]
    found = np.concatenate([before, flat, after])
    for _ in range(2):
        for section in _sections(cutoff, dt):
            found = _passed(found, *section)
        found = found[::-1]
    return np.ascontiguousarray(found[_PADDED : _PADDED + count]).reshape(values.shape)


def _sections(cutoff: float, dt: float) -> list[tuple[float, float, float]]:
    """Return gain and the two coefficients of the denominator of every section, of unit gain at 0 Hz."""
    warped = np.tan(np.pi * cutoff * dt)  # of the bilinear transform with twice the sample rate as unit
    order = 2 * _PAIRS
    poles = warped * np.exp(1j * np.pi * (2 * np.arange(_PAIRS) + order + 1) / (2 * order))
    turned = (1 + poles) / (1 - poles)
    first, second = -2 * turned.real, np.abs(turned) ** 2
    return list(zip((0.25 * (1 + first + second)).tolist(), first.tolist(), second.tolist(), strict=True))


def _passed(values: Array, gain: float, first: float, second: float) -> Array:
    """Return y of y_k + first y_k-1 + second y_k-2 = gain (x_k + 2 x_k-1 + x_k-2), from rest at the first sample."""
    past = np.concatenate([values[:1], values[:1], values])
    sides = gain * (past[2:] + 2 * past[1:-1] + past[:-2])
    sides[0] -= (first + second) * values[0]
    sides[1] -= second * values[0]
    band = np.empty((3, len(values)), order="F")
    band[0], band[1], band[2] = 1.0, first, second
    found: Array = lapack().dtbtrs(band, sides, uplo="L", diag="U")[0]
    return found
