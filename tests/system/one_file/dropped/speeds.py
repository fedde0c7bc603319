"""How often each joint moved how fast. A kind of figure dropped by a test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of a log."""
    if told.signals is not None:
        yield Figure("speeds", "How fast the joints moved", "speeds", {"dq": told.signals.motion.dq}, "All instants.")


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw a histogram of ``dq`` (N, n)."""
    made = paper.canvas(2.0)
    made.subplots().hist(figure.data["dq"], bins=20)
    return made
