"""The look that all figures share: colours that colour-blind readers tell apart, and dashes that grey printers keep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elid_cli.report.figures.thin import bands, cloud

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

Array = NDArray[np.float64]

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
