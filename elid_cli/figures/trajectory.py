"""A trajectory to play: position, velocity and acceleration of every joint over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elid_cli.figures.paint import CYCLE, canvas
from elid_cli.figures.thin import envelope
from elid_cli.report import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas


def draw(figure: Figure) -> Canvas:
    """Draw ``t`` (N,), ``q``, ``dq`` and ``ddq`` (N, n) of ``joints``, ``revolute`` or not."""
    data = figure.data
    made = canvas(5.0)
    panels = made.subplots(3, 1, sharex=True)
    unit = "rad" if all(data["revolute"]) else "rad or m"
    labels = {"q": f"position ({unit})", "dq": "velocity (/s)", "ddq": "acceleration (/s²)"}
    for axes, (key, label) in zip(panels, labels.items(), strict=True):
        for k, joint in enumerate(data["joints"]):
            color, dash = CYCLE[k % len(CYCLE)]
            axes.plot(*envelope(data["t"], data[key][:, k]), color=color, linestyle=dash, linewidth=1.1, label=joint)
        axes.set_ylabel(label)
    panels[-1].set_xlabel("time (s)")
    panels[-1].margins(x=0.01)
    made.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=min(len(data["joints"]), 7))
    return made
