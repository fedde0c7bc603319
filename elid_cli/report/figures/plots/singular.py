"""Singular values of the weighted regressor: how many directions the log shows, and how clear the cut is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.paint import BLUE, GREY, ORANGE
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper

ORDER = 8


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield the singular values of the weighted regressor, columns of unit norm, and the rank kept.

    Columns beyond the standard parameters (nuisances, effects) are left out; so are columns that are zero.
    """
    if (found := told.identified) is None or found.triangles is None:
        return
    system = found.triangles.stacked(found.weights)[:, : found.triangles.parameters]
    norms = np.linalg.norm(system, axis=0)
    live = norms > 0
    values = np.linalg.svd(system[:, live] / norms[live], compute_uv=False)
    caption = "Columns of unit norm. The wider the step, the surer the number of base parameters."
    data = {"values": np.asarray(values), "rank": found.base.count}
    yield Figure("singular", "Singular values of the regressor", "singular", data, caption)


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
