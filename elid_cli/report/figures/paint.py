"""Thinning of long lines and clouds of points; means with bands."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.report.figures.drawing import Band, Color, Dots, Line, Mark, Rule

COLUMNS = 900
"""Columns of a line: about one per dot of a printed page's width."""
GAP = 4.0
"""Bins between means, beyond which nothing is said of what lies between."""
CELLS = (150, 100)
"""Cells of a cloud of points, across and up."""
DRAWN = 400
"""Points of a cloud that are drawn: its mean and its band say the rest."""


def thinned(series: Sequence[Array], most: int) -> NDArray[np.intp]:
    """Return indices, at most about `most`, that keep every series' extremes and gaps; all of them where they are few.

    Of every block of instants those are kept at which any series has its least or its largest value, or a gap.
    """
    count = len(series[0])
    if count <= most:
        return np.arange(count, dtype=np.intp)
    blocks = max(1, most // (2 * len(series)))
    chosen: set[int] = set()
    for first, last in pairwise(np.linspace(0, count, blocks + 1).astype(int).tolist()):
        for values in series:
            block = values[first:last]
            finite = np.isfinite(block)
            if finite.all():  # the usual case, ten times as fast
                chosen.update((first + int(block.argmin()), first + int(block.argmax())))
                continue
            chosen.add(first + int(np.argmin(finite)))
            if finite.any():
                chosen.update((first + int(np.nanargmin(block)), first + int(np.nanargmax(block))))
    return np.array(sorted(chosen), dtype=np.intp)


def envelope(t: Array, values: Array, columns: int = COLUMNS) -> tuple[Array, Array]:
    """Return a shorter line through the smallest and the largest value of every column of time, in their order.

    A line of at most two points per column is returned as it is. NaN (a gap) stays a gap.
    """
    if len(values) <= 2 * columns:
        return t, values
    kept = thinned([values], 2 * columns)
    return t[kept], values[kept]


def cloud(x: Array, y: Array, cells: tuple[int, int] = CELLS, most: int = DRAWN) -> NDArray[np.intp]:
    """Return the indices of one point per occupied cell of a fine grid, at most `most` of them, evenly taken."""
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if finite.size <= most:
        return finite
    places = []
    for values, count in ((x[finite], cells[0]), (y[finite], cells[1])):
        low, span = float(values.min()), float(np.ptp(values)) or 1.0
        places.append(np.minimum((values - low) / span * count, count - 1).astype(np.intp))
    _, first = np.unique(places[0] * cells[1] + places[1], return_index=True)
    kept = np.asarray(finite[np.sort(first)])
    return kept[np.linspace(0, len(kept) - 1, min(most, len(kept))).astype(np.intp)]


def _parted(rows: Array, widest: float) -> Array:
    """Return rows, first column rising, with a row of NaN in the middle of every step wider than `widest`."""
    wide = np.flatnonzero(np.diff(rows[:, 0]) > widest) + 1
    between = np.full((len(wide), rows.shape[1]), np.nan)
    between[:, 0] = 0.5 * (rows[wide - 1, 0] + rows[wide, 0])
    return np.insert(rows, wide, between, axis=0)


def bands(x: Array, y: Array, bins: int = 40) -> tuple[Array, Array, Array, Array, Array]:
    """Return bins of equal width with enough points in them: (centre, mean, low, high, smallest and largest (2, …)).

    Low and high hold the middle 90 % of the points. In a wide gap stands a bin of NaN, so that no line crosses it.
    """
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if not x.size or np.ptp(x) == 0:
        empty = np.zeros(0)
        return empty, empty, empty, empty, np.zeros((2, 0))
    edges = np.linspace(x.min(), x.max(), bins + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, bins - 1)
    rows = []
    for b in range(bins):
        inside = y[place == b]
        if inside.size >= 5:
            low, high = np.quantile(inside, (0.05, 0.95))
            rows.append((0.5 * (edges[b] + edges[b + 1]), inside.mean(), low, high, inside.min(), inside.max()))
    table = _parted(np.array(rows).reshape(-1, 6), GAP * (edges[1] - edges[0])).T
    return table[0], table[1], table[2], table[3], table[4:6]


def scatter_with_mean(x: Array, y: Array, color: Color, *, dash: str = "", label: str = "mean") -> list[Mark]:
    """Return points, thinned to occupied cells, with their middle 90 % as a band and their mean as a line."""
    kept = cloud(x, y)
    centre, mean, low, high, _ = bands(x, y)
    points = Dots(x[kept], y[kept], "pale", label="samples")
    band = Band(centre, low, high, color, "" if dash else "middle 90 %")
    return [points, band, Rule(y=0.0), Line(centre, mean, color, dash, 1.8, label)]
