"""Readings that lie about for a few samples, after which the motion goes on: a damaged page, frames of another message.

`dropouts` judges a step by the steps around it, so it sees at most three odd ones together. Here a step is judged by
the pace of the whole log, which holds for runs of any readings.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.grid import interpolate

Rows = NDArray[np.intp]

TIMES = 20.0
"""Times the pace from which a step is no motion."""
FEWEST = 3
"""Such steps that make a run; fewer are dropouts."""
APART = 5
"""Steps that two of a run are apart, at most."""
MORE = 2
"""Readings that may belong to a run at either end though their step is no wild one."""
PIECE = 4
"""Longest runs that make a piece, so that most of its steps are sound …"""
SHARE = 0.7
"""… and this share of them, steps of 0 left out, tells its pace."""
PIECES = 1024
"""Pieces, evenly taken, that tell the pace of a log."""


def scattered(column: Array, longest: int, finest: float, turns: tuple[float, ...]) -> Rows:
    """Return the samples of one column, shape (N,), that are in such runs.

    Parameters
    ----------
    column
        Values; NaN where a sample is missing.
    longest
        Samples of the longest run.
    finest
        Differences that are rounding.
    turns
        Steps that are an angle's own wrap.
    """
    sizes = np.abs(np.diff(column))
    pace = _pace(sizes, PIECE * longest)
    wild = sizes > TIMES * pace + finest
    for turn in turns:
        wild &= np.abs(sizes - turn) > 0.05 * turn
    at = np.flatnonzero(wild)
    runs = [run for run in np.split(at, np.flatnonzero(np.diff(at) > APART) + 1) if run.size >= FEWEST]
    rows = [np.arange(0)]
    for first, last in ((int(run[0]), int(run[-1])) for run in runs):
        around = sizes[max(0, first - PIECE * longest) : last + PIECE * longest]
        near = max(pace, _pace(around, around.size))
        if last - first <= longest and sizes[first : last + 1].max() > TIMES * near + finest:
            rows.append(_between(column, first, last, 2 * near, finest))
    return np.concatenate(rows)


def _between(column: Array, first: int, last: int, fastest: float, finest: float) -> Rows:
    """Return the samples between two steps that a joint leaves out; none where it cannot get past them in time.

    The first or the last reading of a run may lie near the motion, so that no step shows it: a few more are tried.
    """
    for before, after in sorted(product(range(MORE + 1), repeat=2), key=sum):
        start, stop = first - before, last + 1 + after
        reach = fastest * (stop - start) + finest
        if start >= 0 and stop < column.size and abs(column[stop] - column[start]) <= reach:
            return np.arange(start + 1, stop)
    return np.arange(0)


def bridged(column: Array, rows: Rows) -> Array:
    """Return a copy of a column with a smooth curve over some samples."""
    out, index = column.copy(), np.arange(column.size, dtype=float)
    held = np.isfinite(column)
    held[rows] = False
    out[rows] = interpolate(index[held], column[held][:, None], index[rows], order=4)[:, 0]
    return out


def _pace(sizes: Array, length: int) -> float:
    """Return the largest step that is kept up for a piece of some steps."""
    length = min(length, sizes.size)
    starts = np.unique(np.linspace(0, sizes.size - length, min(PIECES, -(-sizes.size // length))).astype(int))
    pieces = np.stack([sizes[start : start + length] for start in starts])
    pieces[pieces == 0] = np.nan
    pieces.sort(axis=1)  # NaN at the end
    known = np.count_nonzero(np.isfinite(pieces), axis=1)
    paces = pieces[np.arange(len(pieces)), np.maximum((SHARE * (known - 1)).astype(int), 0)]
    return float(paces[known > 0].max(initial=0.0))
