"""Base parameters with their 95 % intervals, each on the scale of its own value, beside the reference."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.estimation.validation.verdicts import HELD
from elid_cli.report.answers import summary
from elid_cli.report.figures.drawing import Bars, Dots, Drawing, Mark, Panel, Rule, Words
from elid_cli.report.tree import Figure
from elid_cli.robot.parameter import StandardParameter

if TYPE_CHECKING:
    from elid_cli.estimation.result import Identification
    from elid_cli.report.figures.input import FigureInput

ORDER = 5
LONGEST = 22
"""Characters of a name; the table beside the figure has it whole."""
MOST = 26
"""Parameters of one panel."""
EDGE = 2.1
"""Values beyond this many times their scale are drawn at the edge."""
CAPTION = (
    "Each on the scale of its own value, with its standard error at the right (small: it makes less than 1 % of the "
    "torque).{} The tables below have the numbers (long ones are folded)."
)
STAR = "*"
"""Stands behind the error of a parameter that may be biased."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield one figure of all base parameters, or of the drives where a fit of the motion took the file's bodies."""
    if (found := told.identified) is not None and found.drives:
        yield Figure("parameters", "Drives", "parameters", _drives(found), CAPTION.format(""))
    elif found is not None:
        data = {"names": found.base.names, "leaders": [p.leader for p in found.parameters],
                "estimate": found.estimate, "std_error": found.std_error,
                "reference": found.reference, "verdict": ["held" if p.reason.startswith(HELD) else p.verdict
                                                          for p in found.parameters],
                "biased": [p.bias_possible for p in found.parameters]}  # fmt: skip
        star = f" {STAR}: {summary.BIASED} by what the model lacks." if any(data["biased"]) else ""
        yield Figure("parameters", "Base parameters", "parameters", data, CAPTION.format(star))


def _drives(found: Identification) -> dict[str, Any]:
    """Return the data of a figure of the drives."""
    items = [(joint, kind, values) for kind in PARAMETERS for joint, own in found.drives.items()
             for values in (own[kind],)]  # fmt: skip
    places = {name: k for k, name in enumerate(found.robot.joint_names)}
    described = dict(zip(found.robot.parameter_names(), found.robot.reference().tolist(), strict=True))
    leaders = [StandardParameter(kind, places[joint]) for joint, kind, _ in items]
    return {
        "names": [f"{kind} {joint}" for joint, kind, _ in items],
        "leaders": leaders,
        "estimate": np.array([np.nan if v["estimate"] is None else v["estimate"] for _, _, v in items]),
        "std_error": np.array([np.nan if v["std_error"] is None else v["std_error"] for _, _, v in items]),
        "reference": np.array([described[leader] for leader in leaders]),
        "verdict": [values["verdict"] for _, _, values in items],
        "biased": [False] * len(items),
    }


def draw(figure: Figure) -> Drawing:
    """Draw ``names``, ``leaders``, ``estimate``, ``std_error``, ``reference`` and ``verdict`` of b base parameters.

    Those that are ``biased`` have a star.
    """
    data = figure.data
    order = summary.by_kind(data["leaders"])
    drives = [k for k in order if data["leaders"][k].kind in summary.JOINT_KINDS]
    bodies = [k for k in order if k not in set(drives)]
    titled = [("drives and transmissions", drives), ("bodies", bodies)]
    pieces = [(title, part) for title, rows in titled for part in parts(rows)]
    return Drawing([_panel(data, title, rows) for title, rows in pieces])


def parts(rows: Sequence[int]) -> list[Sequence[int]]:
    """Return rows in as few parts as `MOST` allows, about equally long."""
    count = -(-len(rows) // MOST)
    edges = [round(k * len(rows) / count) for k in range(count + 1)] if count else []
    return [rows[first:last] for first, last in pairwise(edges)]


def _panel(data: Mapping[str, Any], title: str, index: Sequence[int]) -> Panel:
    estimate, deviation, reference = (
        np.asarray(data[key], dtype=float)[list(index)] for key in ("estimate", "std_error", "reference")
    )
    # a value that is nothing but noise is drawn on the scale of its interval, not of itself
    scale = np.fmax(np.fmax(np.abs(estimate), np.abs(np.nan_to_num(reference))), 1.96 * deviation)
    scale = np.where((scale > 0) & np.isfinite(scale), scale, 1.0)
    y, x, half = np.arange(float(len(index))), estimate / scale, 1.96 * deviation / scale
    names = [data["names"][k] for k in index]
    marks: list[Mark] = [
        Rule(x=0.0),
        Bars(y, x - half, x + half, "blue", 2.0),
        Dots(x, y, "blue", size=6, label="estimate with 95 % interval"),
        *([Dots(reference / scale, y, "orange", "d", 9, label="robot file")] if np.isfinite(reference).any() else []),
        Words(
            y, [_spread(data["verdict"][k], data["estimate"][k], data["std_error"][k]) + _star(data, k) for k in index]
        ),
    ]
    drawn = np.concatenate([x - half, x + half, reference / scale])
    drawn = np.clip(drawn[np.isfinite(drawn)], -EDGE, EDGE)
    limits = (min(-0.12, *(drawn - 0.12)), max(1.12, *(drawn + 0.12))), (len(index) - 0.5, -0.5)
    return Panel(
        marks,
        title,
        "value, scaled to its own size",
        "",
        *limits,
        44.0 + 17.0 * len(index),
        ynames=[shortened(name) for name in names],
    )


def shortened(name: str) -> str:
    """Return a combination, or, of a long one, its leading term and the number of the others."""
    if len(name) <= LONGEST:
        return name
    short = summary.called(name)
    return short if short != name else f"{name[: LONGEST - 1]}…"


def _star(data: Mapping[str, Any], k: int) -> str:
    return f" {STAR}" if data["biased"][k] and data["verdict"][k] == "supported" else ""


def _spread(verdict: str, estimate: float, deviation: float) -> str:
    """Return how well a parameter is known: its standard error in percent, or that it is not."""
    if verdict == "held":
        return verdict
    if verdict == "refused" or not np.isfinite(deviation):
        return summary.NOT_SHOWN
    if summary.small_value(estimate, deviation, verdict) or not estimate:
        return summary.SMALL
    text = f"{summary.spread_text(deviation, estimate)} %"
    return text if text[0] in "<>" else f"± {text}"
