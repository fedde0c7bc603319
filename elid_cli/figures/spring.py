"""Deflection-torque curve of every elastic joint: what the transmission transmitted, by direction, and the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from elid_cli.figures.paint import BLUE, INK, ORANGE, PALE, grid_of
from elid_cli.figures.thin import bands, cloud
from elid_cli.report import Figure, number_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

PATH = 4000
"""Instants up to which the path through them is drawn; beyond, loops would fill the panel."""


def draw(figure: Figure) -> Canvas:
    """Draw ``springs``: dictionaries of joint, unit, deflection, transmitted, modelled, rising, stiffness."""
    springs = figure.data["springs"]
    made, panels = grid_of(len(springs), 3 if len(springs) > 2 else 2, 2.7)
    for axes, spring in zip(panels, springs, strict=True):
        x = 1e3 * np.asarray(spring["deflection"])
        rising = np.asarray(spring["rising"], dtype=bool)
        if len(x) <= PATH:
            axes.plot(x, spring["transmitted"], color=PALE, linewidth=0.6, zorder=1, rasterized=True)
        for chosen, color, marker, name in ((rising, BLUE, ".", "winding up"), (~rising, ORANGE, "x", "unwinding")):
            kept = cloud(x[chosen], spring["transmitted"][chosen])
            axes.plot(x[chosen][kept], spring["transmitted"][chosen][kept], marker, color=color, markersize=2.4,
                      markeredgewidth=0.5 if marker == "x" else 0, alpha=0.45, label=name, rasterized=True)  # fmt: skip
        modelled = np.asarray(spring["modelled"])
        if len(x) <= PATH:
            axes.plot(x, modelled, color=INK, linewidth=0.8, label="model")
        else:
            for chosen, dash in ((rising, "-"), (~rising, "--")):
                centre, mean, *_ = bands(x[chosen], modelled[chosen])
                axes.plot(centre, mean, color=INK, linestyle=dash, linewidth=1.2,
                          label="model" if dash == "-" else None)  # fmt: skip
        length = "rad" if spring["unit"] == "N·m" else "m"
        axes.set_title(f"{spring['joint']}\nK = {number_text(spring['stiffness'])} {spring['unit']}/{length}")
        axes.set_xlabel(f"deflection (m{length})")
        axes.set_ylabel(f"transmitted torque ({spring['unit']})")
    handles, labels = panels[0].get_legend_handles_labels()
    made.legend(handles, labels, loc="outside upper left", ncols=3, markerscale=3)
    return made
