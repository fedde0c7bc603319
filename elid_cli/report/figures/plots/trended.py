"""Parameters of one joint over recordings: estimates with intervals, and the line or the step that was found."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli._types import Array
from elid_cli.report.figures.drawing import Dots, Drawing, Line, Mark, Panel, Rule
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.estimation.trend.trends import Trend
    from elid_cli.report.figures.input import FigureInput

ORDER = 3
MOST = 8
"""Parameters of a joint that are drawn: those that changed first, then drives before bodies."""
FEW = 30
"""Recordings up to which panels stand side by side."""
LONGEST, EDGE = 60, 0.04
"""Characters of a name that are written; room beside the first and the last recording, as a part of the width."""
REACH = 1.96
"""Standard errors of a 95 % interval."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint whose parameters were followed."""
    if told.trends is None:
        return
    groups: dict[str, list[Trend]] = {}
    for item in told.trends.trends:
        groups.setdefault(told.trends.joint_of(item), []).append(item)
    for joint, items in groups.items():
        ordered = sorted(items, key=lambda item: (item.word == "steady", not item.drives))[:MOST]
        hours = told.trends.axis == "hour"
        data = {
            "axis": "hours since the first" if hours else "recording, in the order given",
            "parameters": [_drawn(item, 0.0 if hours else 1.0) for item in ordered],
        }
        caption = "Estimate of every recording with its 95 % interval; dashed: the line or the step that was found."
        if told.trends.stands_out:
            caption += " Crosses: recordings that stand out; they are not used for the rest."
        yield Figure(f"trend_{joint}", f"{joint}: parameters over recordings", "trended", data, caption)


def _drawn(item: Trend, begin: float) -> dict[str, object]:
    s = item.series
    line = np.full_like(s.values, s.mean)
    if item.word == "trend":
        line = s.values.mean() + s.slope * (s.place - s.place.mean())
    if item.word == "step" and s.step is not None:
        first = np.arange(len(s.values)) <= s.step.after
        line = np.where(first, s.values[first].mean(), s.values[~first].mean())
    return {"name": s.name, "unit": s.unit, "place": s.place + begin, "values": s.values, "errors": s.errors,
            "line": line, "outside": item.outside[:, :2] + [begin, 0.0], "changed": item.word != "steady"}  # fmt: skip


def draw(figure: Figure) -> Drawing:
    """Draw ``parameters``: ``place``, ``values``, ``errors`` and ``line`` (R,) each, with ``name`` and ``unit``.

    ``outside``: places and values of recordings that stand out, (K, 2).
    """
    parameters = figure.data["parameters"]
    panels = []
    for number, item in enumerate(parameters):
        x, y, reach = item["place"], item["values"], REACH * item["errors"]
        last = number == len(parameters) - 1 or len(x) <= FEW
        marks: list[Mark] = [
            Line(_between(x), _stretched(y - reach, y + reach), "grey", "", 1.2),
            Dots(x, y, "orange" if item["changed"] else "blue", "o", 5.0 if len(x) <= FEW else 3.0),
            Line(x, item["line"], "ink", "5 2", 1.1),
        ]
        apart = item["outside"]
        if len(apart):
            marks.append(Dots(apart[:, 0], apart[:, 1], "orange", "x", 6.0))
        if np.any(y - reach < 0) and np.any(y + reach > 0):
            marks.append(Rule(y=0.0, color="pale"))
        margin = EDGE * max(float(np.ptp(x)), 1.0)
        every = np.concatenate([x, apart[:, 0]])
        sides = float(every.min()) - margin, float(every.max()) + margin
        name = item["name"] if len(item["name"]) <= LONGEST else item["name"][: LONGEST - 1] + "…"
        panels.append(Panel(marks, name, figure.data["axis"] if last else "", item["unit"], xlim=sides, height=120))
    return Drawing(panels, wide=max(len(item["place"]) for item in parameters) > FEW)


def _between(x: Array) -> Array:
    """Return every place twice with a gap behind, for upright strokes, (3 R,)."""
    return np.stack([x, x, np.full_like(x, np.nan)], axis=1).ravel()


def _stretched(low: Array, high: Array) -> Array:
    return np.stack([low, high, np.full_like(low, np.nan)], axis=1).ravel()
