"""Where every joint has been: position against velocity, with the limits of its range."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elid_cli.report.figures.paint import BLUE, GREY, ORANGE, cloud
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.paint import Paper


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``joints``: dictionaries of joint, revolute, q, dq and limits (low, high) or None."""
    joints = figure.data["joints"]
    made, panels = paper.grid(len(joints), 3, 1.95)
    for axes, joint in zip(panels, joints, strict=True):
        unit = "rad" if joint["revolute"] else "m"
        kept = cloud(joint["q"], joint["dq"], (200, 120))
        axes.plot(joint["q"][kept], joint["dq"][kept], ".", color=BLUE, markersize=1.8, markeredgewidth=0, alpha=0.7,
                  rasterized=True)  # fmt: skip
        if joint["limits"] is not None:
            for limit in joint["limits"]:
                axes.axvline(limit, color=ORANGE, linestyle="--", linewidth=1.0)
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.set_title(joint["joint"])
        axes.set_xlabel(f"position ({unit})")
        axes.set_ylabel(f"velocity ({unit}/s)")
    return made
