"""Quantiles of many short rows: NumPy's own take six times as long to decide how as to do it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elid_cli._types import Array


def quantiles(values: Array, shares: Sequence[float]) -> Array:
    """Return quantiles along the last axis, as `numpy.quantile` does to the last bit.

    Parameters
    ----------
    values
        Numbers without NaN, (…, N), N at least 1.
    shares
        Between 0 and 1.

    Returns
    -------
    numpy.ndarray
        (len(shares), …).
    """
    last = values.shape[-1] - 1
    places = [share * last for share in shares]
    below = [int(place) for place in places]
    ordered = np.partition(values, sorted({min(k + step, last) for k in below for step in (0, 1)}), axis=-1)
    found = np.empty((len(shares), *values.shape[:-1]))
    for number, (place, k) in enumerate(zip(places, below, strict=True)):
        low, high, part = ordered[..., k], ordered[..., min(k + 1, last)], place - k
        step = high - low
        found[number] = low + step * part if part < 0.5 else high - step * (1.0 - part)
    return found
