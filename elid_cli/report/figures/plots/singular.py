"""Singular values of the weighted regressor: how many directions the log shows, and how clear the cut is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.drawing import Dots, Drawing, Mark, Panel, Rule
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

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


def draw(figure: Figure) -> Drawing:
    """Draw ``values``, largest first, relative to the first; the first ``rank`` are base parameters."""
    values, rank = np.asarray(figure.data["values"]), int(figure.data["rank"])
    relative = np.maximum(values / values[0], 1e-17)
    number = np.arange(1.0, len(values) + 1.0)
    least = f"{rank} base parameters, smallest {relative[min(rank, len(values)) - 1]:.1e}"
    marks: list[Mark] = [Dots(number[:rank], relative[:rank], "blue", size=4, label=least)]
    if len(values) > rank:
        rest = f"dependent columns, largest {relative[rank]:.1e}"
        marks.append(Dots(number[rank:], relative[rank:], "orange", "x", 5, label=rest))
        marks.append(Rule(x=rank + 0.5, dash="5 3"))
    return Drawing([Panel(marks, "", "number", "relative singular value", (0.0, len(values) + 1.0), height=210,
                          logarithmic=True)])  # fmt: skip
