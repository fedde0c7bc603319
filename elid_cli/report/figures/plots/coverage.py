"""Where every joint has been: position against velocity, with the limits of its range."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.drawing import Dots, Drawing, Mark, Panel, Rule
from elid_cli.report.figures.paint import cloud
from elid_cli.report.figures.plots.signals import joint_signals
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

ORDER = 7


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all joints, at the log's rate."""
    if (robot := told.robot) is None:
        return
    if (signals := told.signals) is not None:
        inside = np.concatenate([np.arange(s.start, s.stop) for s in signals.segments])
        moved = [(signals.motion.q[inside, k], signals.motion.dq[inside, k]) for k in range(robot.n)]
    elif (recording := told.recording) is not None:
        known = [joint_signals(recording, joint, k) for k, joint in enumerate(robot.joints)]
        none = np.zeros(0)
        moved = [(f.get("q", f.get("theta", none)), f.get("dq", f.get("dtheta", none))) for f in known]
    else:
        return
    joints = [
        {"joint": joint.name, "revolute": joint.revolute, "q": q, "dq": dq, "limits": joint.limits.position}
        for joint, (q, dq) in zip(robot.joints, moved, strict=True)
    ]
    caption = "Position against velocity; dashed: limits of the robot file."
    yield Figure("coverage", "Where the joints have been", "coverage", {"joints": joints}, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``joints``: dictionaries of joint, revolute, q, dq and limits (low, high) or None."""
    panels = []
    for joint in figure.data["joints"]:
        unit = "rad" if joint["revolute"] else "m"
        kept = cloud(joint["q"], joint["dq"], most=300)
        marks: list[Mark] = [Rule(y=0.0), Dots(joint["q"][kept], joint["dq"][kept], "blue", opacity=0.7)]
        marks += [Rule(x=limit, color="orange", dash="5 3", label="limit") for limit in joint["limits"] or ()]
        panels.append(Panel(marks, joint["joint"], f"position ({unit})", f"velocity ({unit}/s)"))
    return Drawing(panels)
