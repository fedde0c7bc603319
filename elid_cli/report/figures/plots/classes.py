"""Classes of all standard parameters: 14 kinds across n joints, each class a tone and a letter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.drawing import Cells, Drawing, Panel
from elid_cli.report.tree import Figure
from elid_cli.robot.parameter import JOINT_PARAMETERS, StandardParameter

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput


ORDER = 6
LOOK = {
    "independent": ("#0072b2", "i", "independent"),
    "combined": ("#8fc1e3", "c", "in a combination only"),
    "unidentifiable": ("#f4f4f4", "–", "no effect on any torque"),
    "weak": ("#f0c05a", "w", "known roughly from this log"),
    "not excited": ("#b5500a", "x", "not excited by this log"),
}
"""Class -> colour (lightness falls with what is known), letter, words."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all standard parameters."""
    if (found := told.identified) is not None:
        data = {"classes": dict(found.this_log), "joints": found.robot.joint_names}
        seen = set(found.this_log.values())
        words = "; ".join(f"{letter}: {meaning}" for c, (_, letter, meaning) in LOOK.items() if c in seen)
        title = "What this log shows of each parameter"
        yield Figure("classification", title, "classes", data, f"The 14 parameters of each joint. {words}.")


def draw(figure: Figure) -> Drawing:
    """Draw ``classes``, name -> class, for ``joints``."""
    classes, joints = figure.data["classes"], figure.data["joints"]
    shown = [
        kind for kind in JOINT_PARAMETERS if any(StandardParameter(kind, row) in classes for row in range(len(joints)))
    ]
    found = [
        (column, row, LOOK[classes[name]])
        for row in range(len(joints))
        for column, kind in enumerate(shown)
        if (name := StandardParameter(kind, row)) in classes
    ]
    places = np.array([(column, row) for column, row, _ in found], dtype=float).reshape(-1, 2)
    cells = Cells(places[:, 0], places[:, 1], [look[0] for *_, look in found], [look[1] for *_, look in found])
    limits = (-0.55, len(shown) - 0.45), (len(joints) - 0.45, -0.55)
    return Drawing([Panel([cells], "", "", "", *limits, 34.0 + 24.0 * len(joints), xnames=shown, ynames=joints,
                          bare=True)])  # fmt: skip
