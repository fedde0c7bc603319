"""The error of every joint as a share of its torque: one bar a case, such as a robot file, a log, before and after."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.answers.summary import share_text
from elid_cli.report.figures.drawing import CYCLE, Bars, Color, Drawing, Mark, Panel, Words, alike
from elid_cli.report.tree import Figure, number_text

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

ORDER = 2
THICK = 9.0
"""px of a bar."""
CHANGE: tuple[Color, ...] = ("before", "blue")
"""Colours of before and after, as of residuals over time: one light, one dark, also in grey."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all joints and cases."""
    if any(shares for _, shares in told.cases):
        title, caption = told.heading
        if told.sides:
            caption += (
                " Whole joint: motor torque against the motion of all bodies. Motor side: with the "
                "transmission's torque from the measured deflection, where a fault of the motor shows more clearly."
            )
        data = {"cases": told.cases, "sides": told.sides, "unit": told.unit}
        yield Figure("errors", title, "errors", data, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``cases`` and ``sides``: pairs of a label and the error of each joint, by name, in ``unit`` or as shares."""
    cases, sides = figure.data["cases"], figure.data.get("sides") or ()
    panels = [_panel(cases, "whole joint" if sides else "", figure.data.get("unit", ""))]
    return Drawing(list(alike([*panels, _panel(sides, "motor side")], "x"))) if sides else Drawing(panels, wide=True)


def _panel(cases: Sequence[tuple[str, Mapping[str, float]]], title: str, unit: str = "") -> Panel:
    joints = list(dict.fromkeys(joint for _, shares in cases for joint in shares))
    scale = 1.0 if unit else 100.0
    changed = [label for label, _ in cases] == ["before", "after"]
    marks: list[Mark] = []
    for number, (label, shares) in enumerate(cases):
        place = (number + 0.5) / len(cases) * 0.84 - 0.42
        y = np.array([joints.index(joint) + place for joint in shares])
        size = scale * np.array(list(shares.values()))
        color = CHANGE[number] if changed else CYCLE[number % len(CYCLE)][0]
        count = "" if changed or len(cases) == 1 else f"{number + 1}: "  # no case is told by its colour alone
        marks.append(Bars(y, np.zeros(len(y)), size, color, THICK, f"{count}{label}"))
        # a space of its own width: SVG takes an ordinary one away at the beginning of a text
        sizes = [f"{number_text(share, 2)} {unit}" if unit else share_text(share) for share in shares.values()]
        texts = [f"{count}{text}" for text in sizes]
        marks.append(Words(y, [f"\N{NO-BREAK SPACE}{text}" for text in texts], size, "ink"))
    most = max((scale * share for _, shares in cases for share in shares.values()), default=1.0)
    height = 46.0 + (20.0 if title else 0.0) + len(joints) * max(18.0, (THICK + 3.0) * len(cases) + 6.0)
    limits = (0.0, 1.25 * most or 1.0), (len(joints) - 0.5, -0.5)
    return Panel(marks, title, f"error ({unit})" if unit else "error (% of torque)", "", *limits, height, ynames=joints)
