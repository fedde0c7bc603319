"""Colours, fonts; thinning of long lines."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas


COLUMNS = 900
"""Columns of a line: about one per dot of a printed page's width."""
GAP = 4.0
"""Bins between means, beyond which nothing is said of what lies between."""
CELLS = (260, 160)
"""Cells of a cloud of points, across and up."""


def envelope(t: Array, values: Array, columns: int = COLUMNS) -> tuple[Array, Array]:
    """Return a shorter line through the smallest and the largest value of every column of time, in their order.

    A line of at most two points per column is returned as it is. NaN (a gap) stays a gap.
    """
    n = len(values)
    if n <= 2 * columns:
        return t, values
    edges = np.linspace(0, n, columns + 1).astype(int)
    chosen: list[int] = []
    for first, last in pairwise(edges.tolist()):
        block = values[first:last]
        finite = np.flatnonzero(np.isfinite(block))
        if finite.size < len(block):
            chosen.append(first + int(np.flatnonzero(~np.isfinite(block))[0]))
        if finite.size:
            low, high = finite[np.argmin(block[finite])], finite[np.argmax(block[finite])]
            chosen += [first + int(low), first + int(high)]
    index = np.array(sorted(set(chosen)), dtype=int)
    return t[index], values[index]


def cloud(x: Array, y: Array, cells: tuple[int, int] = CELLS) -> NDArray[np.intp]:
    """Return the indices of one point per occupied cell of a fine grid: the same picture from fewer points."""
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if finite.size <= 1500:
        return finite
    places = []
    for values, count in ((x[finite], cells[0]), (y[finite], cells[1])):
        low, span = float(values.min()), float(np.ptp(values)) or 1.0
        places.append(np.minimum((values - low) / span * count, count - 1).astype(np.intp))
    _, first = np.unique(places[0] * cells[1] + places[1], return_index=True)
    return np.asarray(finite[np.sort(first)])


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


INK, GREY, PALE = "#222222", "#6b6b6b", "#c9c9c9"
BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#aa4499"
"""Of Okabe and Ito's palette; in grey they differ in lightness, and lines differ in dashes too."""
CYCLE = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (PURPLE, ":"), (INK, (0, (5, 1))), ("#56b4e9", (0, (3, 1, 1, 1))),
         ("#e69f00", (0, (1, 1))))  # fmt: skip
"""Colour and dash of lines that stand side by side."""
BEFORE = "#e9a978"
"""The residual before, behind the one after."""
MEASURED = "#86bbdf"
"""What was measured: a broad pale line, so that a thin dark one over it shows in grey too."""


@dataclass(frozen=True)
class Paper:
    """What a figure is drawn on: a page, or a telephone, where panels stand below each other in the same type."""

    width: float
    """Inches."""
    narrow: bool = False

    def canvas(self, height: float) -> Canvas:
        """Return an empty figure of that height in inches."""
        from matplotlib.figure import Figure as Made

        return Made(figsize=(self.width, height), layout="constrained")

    def grid(self, count: int, columns: int, each: float, *, sharey: bool = False) -> tuple[Canvas, list[Axes]]:
        """Return a figure with `count` panels in rows of at most `columns` (2 if narrow), each `each` inches high."""
        columns = min(columns, count, 2 if self.narrow else columns)
        rows = -(-count // columns)
        made = self.canvas(each * rows + 0.25)
        axes = list(made.subplots(rows, columns, squeeze=False, sharey=sharey).ravel())
        for spare in axes[count:]:
            spare.set_axis_off()
        return made, axes[:count]


PAGE, TELEPHONE = Paper(7.6), Paper(3.7, narrow=True)


def settings() -> dict[str, Any]:
    """Return matplotlib settings: plain white paper, small type, no box around what needs none."""
    return {
        "font.size": 9.0, "axes.titlesize": 9.5, "axes.labelsize": 9.0, "legend.fontsize": 8.5,
        "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans", "Arial", "Helvetica"],
        "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": GREY, "axes.labelcolor": INK,
        "xtick.color": GREY, "ytick.color": GREY, "xtick.labelcolor": INK, "ytick.labelcolor": INK,
        "text.color": INK, "axes.titlecolor": INK, "axes.titlelocation": "left",
        "axes.grid": True, "grid.color": "#e6e6e6", "grid.linewidth": 0.6, "axes.axisbelow": True,
        "lines.linewidth": 1.0, "legend.frameon": False, "figure.facecolor": "white", "savefig.facecolor": "white",
        "svg.fonttype": "none", "path.simplify": True, "path.simplify_threshold": 0.2, "axes.unicode_minus": False,
        "text.parse_math": False,  # names of joints may hold a dollar sign
    }  # fmt: skip


def scatter_with_mean(
    axes: Axes, x: Array, y: Array, color: str, *, dashes: str = "-", label: str | None = None
) -> None:
    """Draw points, thinned to occupied cells, with their middle 90 % as a band and their mean as a line."""
    kept = cloud(x, y)
    axes.plot(x[kept], y[kept], ".", color=PALE, markersize=2.2, markeredgewidth=0, zorder=1, rasterized=True)
    centre, mean, low, high, _ = bands(x, y)
    axes.fill_between(centre, low, high, color=color, alpha=0.22, linewidth=0, zorder=2)
    axes.plot(centre, mean, color=color, linestyle=dashes, linewidth=1.6, zorder=3, label=label)
    axes.axhline(0.0, color=GREY, linewidth=0.7, zorder=2)
