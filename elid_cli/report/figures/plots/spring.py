"""Deflection and torque of every elastic joint: what its transmission transmitted, and what of it no line explains.

Above, the torque through the transmission; below, the same less a straight line of the stiffness, where loops of
hysteresis, a dead zone and a bend are as large as they are, not as small as beside the whole torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from elid_cli.report.figures.paint import BLUE, INK, ORANGE, PALE, bands, cloud
from elid_cli.report.tree import Figure, number_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.paint import Paper

PATH = 4000
"""Instants up to which the path through them is drawn; beyond, loops would fill the panel."""
ACROSS = 3
"""Joints side by side on a page."""


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``springs``: dictionaries of joint, unit, deflection, transmitted, modelled, rising, used, stiffness."""
    springs = figure.data["springs"]
    across = min(1 if paper.narrow else ACROSS, len(springs))
    blocks = -(-len(springs) // across)
    made = paper.canvas(4.0 * blocks + 0.3)
    grid = made.subplots(2 * blocks, across, squeeze=False, height_ratios=(1.5, 1.0) * blocks)
    for axes in grid.ravel():
        axes.set_axis_off()
    for number, spring in enumerate(springs):
        block, column = divmod(number, across)
        curve, rest = grid[2 * block, column], grid[2 * block + 1, column]
        curve.set_axis_on()
        rest.set_axis_on()
        curve.sharex(rest)
        length = "rad" if spring["unit"] == "N·m" else "m"
        line = spring["stiffness"] * np.asarray(spring["deflection"])
        _panel(curve, spring, 0.0 * line)
        _panel(rest, spring, line)
        rounded = float(f"{spring['stiffness']:.4g}")
        stiffness = f"{number_text(rounded)} {spring['unit']}/{length}"
        known = "" if spring["known"] else ", refused"
        curve.set_title(f"{spring['joint']}\nK = {stiffness}{known}")
        curve.tick_params(labelbottom=False)
        rest.set_xlabel(f"deflection (m{length})")
        if column == 0:
            curve.set_ylabel(f"transmitted ({spring['unit']})")
            rest.set_ylabel(f"less K·e ({spring['unit']})")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    made.legend(handles, labels, loc="outside upper left", ncols=2 if paper.narrow else 4, markerscale=3)
    return made


def _panel(axes: Axes, spring: Mapping[str, Any], line: Any) -> None:
    """Draw torques less a line against the deflection; instants around reversals pale and outside the scale."""
    x = 1e3 * np.asarray(spring["deflection"])
    rising, used = np.asarray(spring["rising"], dtype=bool), np.asarray(spring["used"], dtype=bool)
    transmitted, modelled = np.asarray(spring["transmitted"]) - line, np.asarray(spring["modelled"]) - line
    if len(x) <= PATH:
        axes.plot(x, np.where(used | ~np.any(line), transmitted, np.nan), color=PALE, linewidth=0.6, zorder=1,
                  rasterized=True)  # fmt: skip
    for chosen, color, marker, name in ((rising & used, BLUE, ".", "winding up"),
                                        (~rising & used, ORANGE, "x", "unwinding")):  # fmt: skip
        kept = cloud(x[chosen], transmitted[chosen])
        axes.plot(x[chosen][kept], transmitted[chosen][kept], marker, color=color, markersize=2.4,
                  markeredgewidth=0.5 if marker == "x" else 0, alpha=0.45, label=name, rasterized=True)  # fmt: skip
    if len(x) <= PATH:
        axes.plot(x, np.where(used, modelled, np.nan), color=INK, linewidth=0.8, label="model")
    else:
        for chosen, dash in ((rising, "-"), (~rising, "--")):
            centre, mean, *_ = bands(x[chosen & used], modelled[chosen & used])
            axes.plot(centre, mean, color=INK, linestyle=dash, linewidth=1.2, label="model" if dash == "-" else None)
    shown = transmitted[used & np.isfinite(transmitted)]
    if shown.size:
        low, high = float(shown.min()), float(shown.max())
        margin = 0.08 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)
