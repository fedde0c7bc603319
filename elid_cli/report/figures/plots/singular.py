"""Singular values of the weighted regressor: how many directions the log shows, and how clear the cut is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.paint import BLUE, GREY, ORANGE
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.paint import Paper


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``values``, largest first, relative to the first; the first ``rank`` are base parameters."""
    from matplotlib.ticker import MaxNLocator

    values, rank = np.asarray(figure.data["values"]), int(figure.data["rank"])
    relative = np.maximum(values / values[0], 1e-17)
    made = paper.canvas(2.8)
    axes = made.subplots()
    number = np.arange(1, len(values) + 1)
    axes.semilogy(number[:rank], relative[:rank], "o", color=BLUE, markersize=3.2,
                  label=f"{rank} base parameters, smallest {relative[min(rank, len(values)) - 1]:.1e}")  # fmt: skip
    if len(values) > rank:
        axes.semilogy(number[rank:], relative[rank:], "x", color=ORANGE, markersize=4,
                      label=f"dependent columns, largest {relative[rank]:.1e}")  # fmt: skip
        axes.axvline(rank + 0.5, color=GREY, linestyle="--", linewidth=0.9)
    axes.set_xlim(0, len(values) + 1)
    axes.set_xlabel("number")
    axes.set_ylabel("relative singular value")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    made.legend(loc="outside upper left", ncols=1 if paper.narrow else 2)
    return made
