"""Where every joint has been: position against velocity, with the limits of its range."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.paint import BLUE, GREY, ORANGE, cloud
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper

ORDER = 7


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all joints, at the log's rate."""
    if (signals := told.signals) is None or (robot := told.robot) is None:
        return
    inside = np.concatenate([np.arange(s.start, s.stop) for s in signals.segments])
    joints = [
        {"joint": joint.name, "revolute": joint.revolute, "q": signals.motion.q[inside, k],
         "dq": signals.motion.dq[inside, k], "limits": joint.limits.position}
        for k, joint in enumerate(robot.joints)
    ]  # fmt: skip
    caption = "Position against velocity; dashed: limits of the robot file."
    yield Figure("coverage", "Where the joints have been", "coverage", {"joints": joints}, caption)


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
