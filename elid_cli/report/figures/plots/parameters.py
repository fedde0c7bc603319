"""Base parameters with their 95 % intervals, each on the scale of its own value, beside the reference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.paint import BLUE, GREY, INK, ORANGE
from elid_cli.report.tree import Figure, number_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper

ORDER = 5
LONGEST, SHORTER = 30, 22
"""Characters of a name on a page and on a telephone; the table beside the figure has it whole."""
EDGE = 2.2
"""Values beyond this many times their scale are drawn at the edge."""
TYPE = 7.5
FAR = 100.0
"""Standard deviation, % of the value, from which on its size says nothing."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all base parameters."""
    if (found := told.identified) is not None:
        data = {"names": found.base.names, "estimate": found.estimate, "std_error": found.std_error,
                "reference": found.reference, "verdict": found.verdict}  # fmt: skip
        caption = "Each on the scale of its own value; bars are 95 % intervals, diamonds the robot file's values."
        yield Figure("parameters", "Base parameters", "parameters", data, caption)


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``names``, ``estimate``, ``std_error``, ``reference`` and ``verdict`` of b base parameters."""
    data = figure.data
    estimate, deviation = np.asarray(data["estimate"]), np.asarray(data["std_error"])
    reference = np.asarray(data["reference"])
    longest = SHORTER if paper.narrow else LONGEST
    names = [name if len(name) <= longest else f"{name[: longest - 1]}…" for name in data["names"]]
    count = len(names)
    columns = 1 if count <= 24 or paper.narrow else 2
    rows = -(-count // columns)
    made = paper.canvas(0.18 * rows + 0.9)
    panels = made.subplots(1, columns, squeeze=False, sharex=True)[0]
    # a value that is nothing but noise is drawn on the scale of its interval, not of itself
    scale = np.fmax(np.fmax(np.abs(estimate), np.abs(np.nan_to_num(reference))), 1.96 * deviation)
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
                axes.text(-EDGE, place, " refused", va="center", fontsize=TYPE, color=INK)
            elif np.isfinite(deviation[k]) and estimate[k] != 0:
                share = 100 * deviation[k] / abs(estimate[k])
                text = f"{number_text(share, 2)} %" if share < FAR else "> 100 %"
                axes.text(1.02, place, text, va="center", ha="left", fontsize=TYPE, color=GREY,
                          transform=axes.get_yaxis_transform())  # fmt: skip
        axes.set_yticks(y, [names[k] for k in index], fontsize=TYPE)
        axes.set_ylim(rows - 0.5, -0.5)
        axes.set_xlim(-EDGE, EDGE)
        axes.set_xlabel("value / its own size")
        axes.set_title("± sd", fontsize=TYPE, color=GREY, loc="right", x=1.02, ha="left")
    made.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return made
