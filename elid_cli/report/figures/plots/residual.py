"""One joint's residual against everything that it may follow: velocity, position, deflection, torque, time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elid_cli.report.figures.paint import BLUE, ORANGE, bands, scatter_with_mean
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.paint import Paper


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``residual`` (M,) against each of ``variables``; ``before`` (M,) is drawn as its mean only."""
    data = figure.data
    made, panels = paper.grid(len(data["variables"]), 3, 2.2, sharey=True)
    for axes, (name, values) in zip(panels, data["variables"].items(), strict=True):
        scatter_with_mean(axes, values, data["residual"], BLUE)
        if data.get("before") is not None:
            centre, mean, *_ = bands(values, data["before"])
            axes.plot(centre, mean, color=ORANGE, linestyle="--", linewidth=1.4, label="mean before")
        axes.set_xlabel(name)
    for axes in panels[:: min(2 if paper.narrow else 3, len(panels))]:
        axes.set_ylabel(f"residual ({data['unit']})")
    if data.get("before") is not None:
        panels[0].plot([], [], color=BLUE, linewidth=1.6, label="mean after")
        made.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return made
