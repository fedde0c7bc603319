"""The error of every joint as a share of its torque: one bar a case, such as a robot file, a log, before and after."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.answers.summary import share_text
from elid_cli.report.figures.drawing import CYCLE, Bars, Color, Drawing, Mark, Panel, Words, alike
from elid_cli.report.figures.svg import CHARACTER, WIDTH
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
        data = {"cases": told.cases, "sides": told.sides, "unit": told.unit, "units": told.units}
        yield Figure("errors", title, "errors", data, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``cases`` and ``sides``: pairs of a label and the error of each joint, by name, in ``unit`` or as shares.

    Where joints have their own, ``units`` has them by name.
    """
    cases, sides = figure.data["cases"], figure.data.get("sides") or ()
    unit, units = figure.data.get("unit", ""), figure.data.get("units") or {}
    panels = [_panel(cases, "whole joint" if sides else "", unit, units)]
    return Drawing(list(alike([*panels, _panel(sides, "motor side")], "x"))) if sides else Drawing(panels, wide=True)


def _panel(
    cases: Sequence[tuple[str, Mapping[str, float]]], title: str, unit: str = "", units: Mapping[str, str] = {}
) -> Panel:  # fmt: skip
    joints = list(dict.fromkeys(joint for _, shares in cases for joint in shares))
    scale = 1.0 if unit else 100.0
    changed = [label for label, _ in cases] == ["before", "after"]
    marks: list[Mark] = []
    longest = 0
    for number, (label, shares) in enumerate(cases):
        place = (number + 0.5) / len(cases) * 0.84 - 0.42
        y = np.array([joints.index(joint) + place for joint in shares])
        size = scale * np.array(list(shares.values()))
        color = CHANGE[number] if changed else CYCLE[number % len(CYCLE)][0]
        count = "" if changed or len(cases) == 1 else f"{number + 1}: "  # no case is told by its colour alone
        marks.append(Bars(y, np.zeros(len(y)), size, color, THICK, f"{count}{label}"))
        # a space of its own width: SVG takes an ordinary one away at the beginning of a text
        sizes = [f"{number_text(share, 2)} {units.get(joint, unit)}" if unit else share_text(share)
                 for joint, share in shares.items()]  # fmt: skip
        texts = [f"{count}{text}" for text in sizes]
        longest = max([longest, *map(len, texts)])
        marks.append(Words(y, [f"\N{NO-BREAK SPACE}{text}" for text in texts], size, "ink"))
    most = max((scale * share for _, shares in cases for share in shares.values()), default=1.0)
    height = 46.0 + (20.0 if title else 0.0) + len(joints) * max(18.0, (THICK + 3.0) * len(cases) + 6.0)
    # beside the longest bar there is room for what is written at its end
    beside = CHARACTER * (2 + longest) / (WIDTH - CHARACTER * (4 + max(map(len, joints), default=0)))
    limits = (0.0, most / (1.0 - min(max(beside, 0.2), 0.6)) or 1.0), (len(joints) - 0.5, -0.5)
    return Panel(marks, title, f"error ({unit})" if unit else "error (% of torque)", "", *limits, height, ynames=joints)
