"""A trajectory to play: position, velocity and acceleration of every joint over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elid_cli.report.figures.drawing import CYCLE, Drawing, Line, Panel
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

ORDER = 9


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield the trajectory that was found."""
    if (found := told.excitation) is not None:
        t, q, dq, ddq = found.trajectory.sampled(50.0)
        revolute = tuple(joint.revolute for joint in found.robot.joints)
        data = {"t": t, "q": q, "dq": dq, "ddq": ddq, "joints": found.robot.joint_names, "revolute": revolute}
        caption = "position, velocity and acceleration"
        yield Figure("trajectory", "Planned trajectory", "trajectory", data, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``t`` (N,), ``q``, ``dq`` and ``ddq`` (N, n) of ``joints``, ``revolute`` or not."""
    data = figure.data
    words = {"q": ("position", ""), "dq": ("velocity", "/s"), "ddq": ("acceleration", "/s²")}
    lengths = ("rad",) if all(data["revolute"]) else ("m",) if not any(data["revolute"]) else ("rad", "m")
    panels = []
    for key, (word, share) in words.items():
        looks = [CYCLE[k % len(CYCLE)] for k in range(len(data["joints"]))]
        marks = [
            Line(data["t"], data[key][:, k], color, dash, label=joint)
            for k, (joint, (color, dash)) in enumerate(zip(data["joints"], looks, strict=True))
        ]
        unit = " or ".join(length + share for length in lengths)
        panels.append(Panel(marks, "", "time (s)" if key == "ddq" else "", f"{word} ({unit})"))
    return Drawing(panels, over_time=True, wide=True)
