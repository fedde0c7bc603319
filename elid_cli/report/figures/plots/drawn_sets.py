"""Drawn parameter sets: the range of every parameter, and the sets themselves for the pairs that vary together most."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.report.answers.summary import JOINT_KINDS, called, spread_text
from elid_cli.report.figures.drawing import Bars, Dots, Drawing, Mark, Panel, Rule, Words
from elid_cli.report.figures.plots.parameters import EDGE, parts, shortened
from elid_cli.report.tree import Figure, number_text
from elid_cli.robot.parameter import parameter_named

if TYPE_CHECKING:
    from elid_cli.estimation.sampling.sets import ParameterSets
    from elid_cli.report.figures.input import FigureInput

ORDER = 4
PAIRS = 4
"""Pairs of parameters that are drawn."""
TOGETHER = 0.3
"""Correlation below which a pair is not worth a picture."""
SETS = 400
"""Sets that are drawn of a pair."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield the ranges of all parameters, and the pairs that vary together."""
    if (sets := told.sets) is None:
        return
    low, high = sets.bounds
    mean, _ = sets.spread
    data = {"names": sets.names, "origin": sets.origin, "mean": mean, "low": low, "high": high}
    caption = (
        "Middle 95 % of the sets and their mean, each on the scale of its own value. At the right: half the range, as "
        "a share of the mean. The table has the numbers."
    )
    yield Figure("ranges", "Ranges of the parameters", "drawn_sets", data, caption)
    if pairs := _pairs(sets):
        caption = (
            "Every point is a set; r: correlation. Values drawn from each range by itself would fill the whole box, "
            "also with combinations that the logs rule out."
        )
        yield Figure("pairs", "Parameters that vary together", "drawn_sets", {"pairs": pairs}, caption)


def _pairs(sets: ParameterSets) -> list[dict[str, Any]]:
    """Return the pairs of parameters with the largest correlations, no parameter twice."""
    _, spread = sets.spread
    varied = [k for k in range(len(sets.names)) if np.isfinite(spread[k]) and spread[k] > 0]
    if len(varied) < 2 or len(sets.values) < 3:
        return []
    correlation: Array = np.atleast_2d(np.corrcoef(sets.values[:, varied].T))
    first, second = np.triu_indices(len(varied), 1)
    found: list[dict[str, Any]] = []
    used: set[int] = set()
    for k in np.argsort(-np.abs(correlation[first, second]), kind="stable"):
        r, pair = float(correlation[first[k], second[k]]), (varied[first[k]], varied[second[k]])
        if len(found) == PAIRS or abs(r) < TOGETHER:
            break
        if used.isdisjoint(pair):
            used.update(pair)
            titles = [f"{called(sets.names[p])} less its mean ({sets.units[p]})" for p in pair]
            values = sets.values[:, list(pair)]
            found.append({"r": r, "titles": titles, "values": (values - values.mean(axis=0))[:SETS]})
    return found


def draw(figure: Figure) -> Drawing:
    """Draw ``names``, ``origin``, ``mean``, ``low`` and ``high`` of p parameters, or ``pairs`` of them."""
    data = figure.data
    if "pairs" in data:
        return Drawing([_scatter(pair) for pair in data["pairs"]])
    shown = [k for k, origin in enumerate(data["origin"]) if origin != "unknown"]
    kinds = {k: "" if (p := parameter_named(data["names"][k].split(" ")[0])) is None else p.kind for k in shown}
    places = {kind: k for k, kind in enumerate(JOINT_KINDS)}
    drives = sorted((k for k in shown if kinds[k] in JOINT_KINDS), key=lambda k: (places[kinds[k]], k))
    titled = [("drives and transmissions", drives), ("bodies", [k for k in shown if kinds[k] not in JOINT_KINDS])]
    return Drawing([_panel(data, title, part) for title, rows in titled for part in parts(rows)])


def _scatter(pair: Mapping[str, Any]) -> Panel:
    x, y = np.asarray(pair["values"], dtype=float).T
    dots = Dots(x, y, "blue", size=4, opacity=0.6)
    across, up = pair["titles"]
    return Panel([dots], f"r = {number_text(pair['r'], 2)}", across, up, height=235.0)


def _panel(data: Mapping[str, Any], title: str, index: Sequence[int]) -> Panel:
    mean, low, high = (np.asarray(data[key], dtype=float)[list(index)] for key in ("mean", "low", "high"))
    scale = np.fmax(np.fmax(np.abs(low), np.abs(high)), np.abs(mean))
    scale = np.where(scale > 0, scale, 1.0)
    y = np.arange(float(len(index)))
    held = np.array([data["origin"][k] == "held" for k in index])
    marks: list[Mark] = [
        Rule(x=0.0),
        Bars(y, low / scale, high / scale, "blue", 2.0),
        *_dots(mean / scale, y, held),
        Words(y, [_half(*values) for values in zip(mean, low, high, held, strict=True)]),
    ]
    drawn = np.clip(np.concatenate([low, high]) / np.tile(scale, 2), -EDGE, EDGE)
    limits = (min(-0.12, float(drawn.min()) - 0.12), max(1.12, float(drawn.max()) + 0.12)), (len(index) - 0.5, -0.5)
    names = [shortened(data["names"][k]) for k in index]
    return Panel(marks, title, "value, scaled to its own size", "", *limits, 44.0 + 17.0 * len(index), ynames=names)


def _dots(x: Array, y: Array, held: NDArray[np.bool_]) -> list[Mark]:
    marks: list[Mark] = []
    if not held.all():
        marks.append(Dots(x[~held], y[~held], "blue", size=6, label="mean with the middle 95 %"))
    if held.any():
        marks.append(Dots(x[held], y[held], "orange", "d", 9, label="held"))
    return marks


def _half(mean: float, low: float, high: float, held: bool) -> str:
    """Return half the range as a share of the mean, or that there is none."""
    if held:
        return "held"
    half = 0.5 * (high - low)
    vague = not mean or (low <= 0.0 <= high and abs(mean) < half)
    text = "near 0" if vague else f"{spread_text(half, mean)} %"
    return text if text[0] in "<>n" else f"± {text}"
