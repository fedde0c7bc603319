"""Which instants the search sees, which judge it: contiguous stretches, fixed before anything is fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STRETCHES = 12
HELD_OUT = (2, 6, 10)
"""Stretches that the search never sees: a quarter of the log, spread over it."""
_FOLD_OF = {0: 0, 1: 0, 3: 1, 4: 2, 5: 2, 7: 3, 8: 4, 9: 4, 11: 5}
FOLDS = 6


def folds(instants: int) -> NDArray[np.intp]:
    """Return the cross-validation fold of every instant, (M,); -1 for held-out instants."""
    stretch = np.arange(instants) * STRETCHES // max(instants, 1)
    table = np.array([_FOLD_OF.get(k, -1) for k in range(STRETCHES)], dtype=np.intp)
    return table[np.minimum(stretch, STRETCHES - 1)]


def spans(t: NDArray[np.float64], chosen: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
    """Return the first and last time, s, of every stretch of chosen instants, (M,) each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    return tuple((float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True))
