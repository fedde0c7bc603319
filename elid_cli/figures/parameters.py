"""Base parameters with their 95 % intervals, each on the scale of its own value, beside the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from elid_cli.figures.paint import BLUE, GREY, INK, ORANGE, canvas
from elid_cli.report import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

LONGEST = 34
"""Characters of a name; the table beside the figure has it whole."""
EDGE = 2.2
"""Values beyond this many times their scale are drawn at the edge."""


def draw(figure: Figure) -> Canvas:
    """Draw ``names``, ``estimate``, ``std_error``, ``reference`` and ``verdict`` of b base parameters."""
    data = figure.data
    estimate, deviation = np.asarray(data["estimate"]), np.asarray(data["std_error"])
    reference = np.asarray(data["reference"])
    names = [name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…" for name in data["names"]]
    count = len(names)
    columns = 1 if count <= 24 else 2
    rows = -(-count // columns)
    made = canvas(0.165 * rows + 0.9)
    panels = made.subplots(1, columns, squeeze=False, sharex=True)[0]
    scale = np.fmax(np.abs(estimate), np.abs(np.nan_to_num(reference)))
    scale = np.where((scale > 0) & np.isfinite(scale), scale, 1.0)
    for column, axes in enumerate(panels):
        index = np.arange(column * rows, min((column + 1) * rows, count))
        y = np.arange(len(index))
        half = 1.96 * deviation[index] / scale[index]
        axes.axvline(0.0, color=GREY, linewidth=0.7)
        axes.errorbar(estimate[index] / scale[index], y, xerr=half, fmt="o", color=BLUE, markersize=3, elinewidth=1.4,
                      capsize=2, label="estimate, 95 %")  # fmt: skip
        axes.plot(reference[index] / scale[index], y, "D", color="none", markeredgecolor=ORANGE, markersize=4.5,
                  markeredgewidth=1.0, label="reference")  # fmt: skip
        for place, k in zip(y, index, strict=True):
            if data["verdict"][k] == "refused":
                axes.text(-EDGE, place, " refused", va="center", fontsize=6.8, color=INK)
        axes.set_yticks(y, [names[k] for k in index], fontsize=6.8)
        axes.set_ylim(rows - 0.5, -0.5)
        axes.set_xlim(-EDGE, EDGE)
        axes.set_xlabel("value / its own size")
    made.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return made
