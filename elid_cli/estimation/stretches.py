"""The one division of a log into contiguous stretches: each is predicted by a fit to the others.

Identification predicts each of six; a search for effects holds three of twelve out, and fits and compares on six
folds of the rest; what it names is asked of every quarter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STRETCHES = 6
"""Stretches of a log that are predicted in turn; folds of what a search sees."""
SEARCHED = 12
"""Stretches that a search divides a log into …"""
HELD_OUT = (2, 6, 10)
"""… and those of them that it never sees: a quarter of the log, spread over it."""
_FOLD_OF = {0: 0, 1: 0, 3: 1, 4: 2, 5: 2, 7: 3, 8: 4, 9: 4, 11: 5}
_OTHERS_OF = {0: 0, 2: 0, 3: 1, 5: 2, 6: 2, 7: 3, 9: 4, 10: 4, 11: 5}
"""Folds where others are held out, with what happens within those above in sight."""
QUARTERS = 4


def stretch_of(instants: int, stretches: int = STRETCHES) -> NDArray[np.intp]:
    """Return the stretch of every instant, (M,): contiguous, of equal length but for rounding."""
    return stretches_between(0, instants, instants, stretches)


def stretches_between(first: int, last: int, instants: int, stretches: int = STRETCHES) -> NDArray[np.intp]:
    """Return the same for the instants first … last - 1 of a log of `instants`."""
    return (np.arange(first, last) * stretches // max(instants, 1)).astype(np.intp)


def search_folds(instants: int, *, others: bool = False) -> NDArray[np.intp]:
    """Return the cross-validation fold of every instant of a search, (M,); -1 for held-out instants.

    `others`: with stretches 1, 4 and 8 held out in place of the usual ones.
    """
    folds = _OTHERS_OF if others else _FOLD_OF
    table = np.array([folds.get(k, -1) for k in range(SEARCHED)], dtype=np.intp)
    return table[np.minimum(stretch_of(instants, SEARCHED), SEARCHED - 1)]


def quarter_of(instants: int) -> NDArray[np.intp]:
    """Return the quarter of every instant, (M,)."""
    return stretch_of(instants, QUARTERS)


def spans(t: NDArray[np.float64], chosen: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
    """Return the first and last time, s, of every stretch of chosen instants, (M,) each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    return tuple((float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True))
