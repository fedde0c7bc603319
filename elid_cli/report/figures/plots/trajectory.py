"""A trajectory to play: position, velocity and acceleration of every joint over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elid_cli.report.figures.paint import CYCLE, envelope
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper

ORDER = 9


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield the trajectory that was found."""
    if (found := told.excitation) is not None:
        t, q, dq, ddq = found.sampled(50.0)
        revolute = tuple(joint.revolute for joint in found.robot.joints)
        data = {"t": t, "q": q, "dq": dq, "ddq": ddq, "joints": found.robot.joint_names, "revolute": revolute}
        caption = "position, velocity and acceleration"
        yield Figure("trajectory", "Exciting trajectory", "trajectory", data, caption)


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``t`` (N,), ``q``, ``dq`` and ``ddq`` (N, n) of ``joints``, ``revolute`` or not."""
    data = figure.data
    made = paper.canvas(5.6 if paper.narrow else 5.0)
    panels = made.subplots(3, 1, sharex=True)
    words = {"q": ("position", ""), "dq": ("velocity", "/s"), "ddq": ("acceleration", "/s²")}
    lengths = ("rad",) if all(data["revolute"]) else ("m",) if not any(data["revolute"]) else ("rad", "m")
    for axes, (key, (word, share)) in zip(panels, words.items(), strict=True):
        for k, joint in enumerate(data["joints"]):
            color, dash = CYCLE[k % len(CYCLE)]
            axes.plot(*envelope(data["t"], data[key][:, k]), color=color, linestyle=dash, linewidth=1.1, label=joint)
        axes.set_ylabel(f"{word} ({' or '.join(length + share for length in lengths)})")
    panels[-1].set_xlabel("time (s)")
    panels[-1].margins(x=0.01)
    columns = min(len(data["joints"]), 3 if paper.narrow else 7)
    made.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=columns)
    return made
