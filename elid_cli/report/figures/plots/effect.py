"""One effect: the residual without it and with it, against the variable that it follows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elid_cli.report.figures.paint import BLUE, INK, ORANGE, scatter_with_mean
from elid_cli.report.tree import Figure, number_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.paint import Paper


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``values``, ``without`` and ``with_it`` (M,), the ``variable``, ``unit`` and held-out errors."""
    data = figure.data
    made = paper.canvas(4.8 if paper.narrow else 2.7)
    shape = (2, 1) if paper.narrow else (1, 2)
    left, right = made.subplots(*shape, sharex=True, sharey=True)
    for axes, key, color, word in ((left, "without", ORANGE, "without"), (right, "with_it", BLUE, "with")):
        rising = data.get("rising")
        if rising is None:
            scatter_with_mean(axes, data["values"], data[key], color)
        else:
            scatter_with_mean(axes, data["values"][rising], data[key][rising], color, label="growing")
            scatter_with_mean(axes, data["values"][~rising], data[key][~rising], INK, dashes="--", label="falling")
            axes.legend(loc="best")
        error = data["error_without" if key == "without" else "error_with"]
        axes.set_title(f"{word} it: held-out error {number_text(error, 3)} {data['unit']}")
        if axes is right or not paper.narrow:
            axes.set_xlabel(data["variable"])
        if axes is left or paper.narrow:
            axes.set_ylabel(f"residual of {data['joint']},\n{data['rows']} row ({data['unit']})")
    return made
