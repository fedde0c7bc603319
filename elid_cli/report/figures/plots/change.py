"""Parameters of saved results side by side: those that moved most, with their intervals, in each result."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np

from elid_cli.report.figures.drawing import CYCLE, Bars, Dots, Drawing, Mark, Panel, Rule, Words
from elid_cli.report.tree import Figure, number_text

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

ORDER = 1
MOST = 20
"""Parameters that are drawn: those that moved by most standard deviations."""


SHAPES: tuple[tuple[Literal["o", "d", "x"], float], ...] = (("o", 5.0), ("d", 9.0), ("x", 7.0))
"""Marks of results: told apart without colour as well."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of the parameters that all results share."""
    if not told.comparisons:
        return
    known = [{c.name: c for c in found.changes if np.isfinite(c.deviations)} for found in told.comparisons]
    names = [name for name in known[0] if all(name in other for other in known)]
    names.sort(key=lambda name: -max(abs(other[name].deviations) for other in known))
    first = [known[0][name].before for name in names[:MOST]]
    columns = [first, *([other[name].after for name in names[:MOST]] for other in known)]
    data = {
        "names": names[:MOST],
        "files": [told.comparisons[0].first.file, *(found.other.file for found in told.comparisons)],
        "values": [[e.value for e in column] for column in columns],
        "std_errors": [[e.std_error or 0.0 for e in column] for column in columns],
        "deviations": [max((other[name].deviations for other in known), key=abs) for name in names[:MOST]],
    }
    caption = (
        "Difference from the first result, in percent of the parameter's size. Bars: 95 % intervals; where they reach "
        "the edge they go on. At the right: the largest difference in standard errors."
    )
    if names:
        yield Figure("change", "Parameters that moved most", "change", data, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``values`` and ``std_errors`` (results, parameters) of ``names``, for ``files``, with ``deviations``."""
    data = figure.data
    values, spread = np.array(data["values"], dtype=float), 1.96 * np.array(data["std_errors"], dtype=float)
    count = len(data["names"])
    scale = np.fmax(np.fmax(np.abs(values).max(axis=0), spread.max(axis=0)), 1e-300)
    # a parameter near zero has a large error for its size, which must not set the scale of the others
    sure = spread.max(axis=0) < np.abs(values).max(axis=0)
    reach = np.fmax(np.abs(values - values[0] - spread), np.abs(values - values[0] + spread)).max(axis=0) / scale
    edge = 110.0 * float((reach[sure] if sure.any() else reach).max(initial=1e-6))
    marks: list[Mark] = [Rule(x=0.0)]
    for number, (file, row, wide) in enumerate(zip(data["files"], values, spread, strict=True)):
        color, y = CYCLE[number % len(CYCLE)][0], np.arange(float(count)) + 0.22 * (number - (len(values) - 1) / 2)
        x, half = 100.0 * (row - values[0]) / scale, 100.0 * wide / scale
        shape, size = SHAPES[number % len(SHAPES)]
        marks += [Bars(y, x - half, x + half, color, 2.0), Dots(x, y, color, shape, size, label=file)]
    told = [f"{number_text(float(d), 2)} sd" for d in data["deviations"]]
    marks.append(Words(np.arange(float(count)), told))
    axes = "difference (%)", "", (-edge, edge), (count - 0.5, -0.5), 46.0 + 19.0 * count
    return Drawing([Panel(marks, "", *axes, ynames=data["names"])], wide=True)
