"""Signals moved in time by a fraction of a sample."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array


def shifted(values: Array, samples: float) -> Array:
    """Return values (N,) as they are `samples` later, by cubic interpolation, held at the ends."""
    from scipy.interpolate import CubicSpline

    if len(values) < 4:
        return values.copy()
    index = np.arange(len(values), dtype=float)
    moved: Array = CubicSpline(index, values)(np.clip(index + samples, 0.0, index[-1]))
    return moved
