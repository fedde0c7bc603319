"""The error of every joint as a share of its torque: one bar a case, such as a robot file, a log, before and after."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.drawing import CYCLE, Bars, Drawing, Mark, Panel, Words
from elid_cli.report.tree import Figure, number_text

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

ORDER = 2
THICK = 9.0
"""px of a bar."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all joints and cases."""
    if any(shares for _, shares in told.cases):
        yield Figure("errors", "Error of each joint", "errors", {"cases": told.cases}, "Shares of the joint's torque.")


def draw(figure: Figure) -> Drawing:
    """Draw ``cases``: pairs of a label and the relative error of each joint, by name."""
    cases = figure.data["cases"]
    joints = list(dict.fromkeys(joint for _, shares in cases for joint in shares))
    marks: list[Mark] = []
    for number, (label, shares) in enumerate(cases):
        place = (number + 0.5) / len(cases) * 0.84 - 0.42
        y = np.array([joints.index(joint) + place for joint in shares])
        size = np.array([100.0 * share for share in shares.values()])
        marks.append(Bars(y, np.zeros(len(y)), size, CYCLE[number % len(CYCLE)][0], THICK, label))
        marks.append(Words(y, [f" {number_text(float(s), 2)} %" for s in size], size, "ink"))
    most = max((100.0 * share for _, shares in cases for share in shares.values()), default=1.0)
    height = 46.0 + len(joints) * max(18.0, (THICK + 3.0) * len(cases) + 6.0)
    limits = (0.0, 1.25 * most or 1.0), (len(joints) - 0.5, -0.5)
    return Drawing([Panel(marks, "", "error (% of torque)", "", *limits, height, ynames=joints)])
