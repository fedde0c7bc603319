"""Classes of all standard parameters: 14 kinds across n joints, each class a tone and a letter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elid_cli.report.figures.paint import INK
from elid_cli.report.tree import Figure
from elid_cli.robot.parameter import StandardParameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper

ORDER = 6
LOOK = {
    "independent": ("#0072b2", "i", "white", "independent"),
    "combined": ("#8fc1e3", "c", INK, "combined"),
    "unidentifiable": ("#f4f4f4", "–", INK, "no effect on any torque"),
    "weak": ("#f0c05a", "w", INK, "weak in this log"),
    "not excited": ("#b5500a", "x", "white", "not excited by this log"),
}
"""Class -> colour (lightness falls with what is known), letter, its colour, words."""
STANDARD = ("m", "cx", "cy", "cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "Jm", "Ja", "fs", "fv", "K")


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all standard parameters."""
    if (found := told.identified) is not None:
        data = {"classes": dict(found.this_log), "joints": found.robot.joint_names}
        title = "What this log shows of each parameter"
        yield Figure("classification", title, "classes", data, "The 14 parameters of each joint.")


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``classes``, name -> class, for ``joints``."""
    from matplotlib.patches import Patch, Rectangle

    classes, joints = figure.data["classes"], figure.data["joints"]
    shown = [kind for kind in STANDARD if any(StandardParameter(kind, row) in classes for row in range(len(joints)))]
    made = paper.canvas(0.3 * len(joints) + (1.6 if paper.narrow else 0.95))
    axes = made.subplots()
    seen = []
    for row in range(len(joints)):
        for column, kind in enumerate(shown):
            found = classes.get(StandardParameter(kind, row))
            if found is None:
                continue
            fill, letter, ink, _ = LOOK[found]
            seen.append(found)
            axes.add_patch(Rectangle((column - 0.48, row - 0.46), 0.96, 0.92, facecolor=fill, edgecolor="#bbbbbb",
                                     linewidth=0.5))  # fmt: skip
            axes.text(column, row, letter, ha="center", va="center", color=ink, fontsize=8)
    axes.set_xlim(-0.55, len(shown) - 0.45)
    axes.set_ylim(len(joints) - 0.45, -0.55)
    axes.set_xticks(range(len(shown)), shown, fontsize=7.5 if paper.narrow else None)
    axes.set_yticks(range(len(joints)), joints)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.xaxis.tick_top()
    for spine in axes.spines.values():
        spine.set_visible(False)
    handles = [Patch(facecolor=LOOK[c][0], edgecolor="#bbbbbb", label=f"{LOOK[c][1]}  {LOOK[c][3]}")
               for c in LOOK if c in seen]  # fmt: skip
    made.legend(handles=handles, loc="outside lower center", ncols=1 if paper.narrow else 3)
    return made
