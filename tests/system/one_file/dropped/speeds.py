"""How often each joint moved how fast. A kind of figure dropped by a test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.drawing import Bars, Drawing, Panel
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of a log."""
    if told.signals is not None:
        yield Figure("speeds", "How fast the joints moved", "speeds", {"dq": told.signals.motion.dq}, "All instants.")


def draw(figure: Figure) -> Drawing:
    """Draw bars of how often ``dq`` (N, n) lies in each of twenty ranges."""
    counts, edges = np.histogram(figure.data["dq"], 20)
    marks = [Bars(edges[:-1], np.zeros(20), counts.astype(float), "blue", 6.0)]
    return Drawing([Panel(marks, xlabel="instants", ylabel="velocity")])
