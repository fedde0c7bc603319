"""Measured against simulated position of one joint over time, the error under it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.drawing import Drawing, Line, Mark, Panel
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

ORDER = 2
GAP = 1.5
"""Times between samples from which one is the last of its stretch."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint of a replay."""
    if not told.replays:
        return
    first, *other = told.replays
    caption = "Position as measured and as simulated under the same commands, and their difference."
    ends = np.append(np.diff(first.t) > GAP * float(np.median(np.diff(first.t))), [False])
    for k, joint in enumerate(first.robot.joints):
        # no line leads from one stretch to the next
        measured, simulated, *against = (np.where(ends, np.nan, values[:, k]) for values in (
            first.measured, first.simulated, *(one.simulated for one in other)
        ))  # fmt: skip
        data = {"t": first.t, "unit": joint.units[0], "measured": measured, "simulated": simulated,
                "against": against[0] if against else None, "labels": told.replay_labels}  # fmt: skip
        yield Figure(f"replayed_{joint.name}", f"{joint.name}: measured and simulated", "replayed", data, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``t``, ``measured``, ``simulated`` and ``against`` (M,) or None, rad or m as ``unit`` says.

    ``labels`` are those of the two errors.
    """
    data = figure.data
    t, measured, simulated, against = (data[key] for key in ("t", "measured", "simulated", "against"))
    unit, (own, others) = data["unit"], data["labels"]
    moved: list[Mark] = [Line(t, measured, "measured", "", 3.0, "measured"),
                         Line(t, simulated, "ink", "5 2", 1.1, "simulated")]  # fmt: skip
    errors: list[Mark] = []
    if against is not None:
        errors.append(Line(t, 1e3 * (against - measured), "before", "", 1.3, others))
    errors.append(Line(t, 1e3 * (simulated - measured), "ink", "", 1.0, own))
    drawn = [values for values in (simulated, against) if values is not None]
    sizes = [np.abs(1e3 * (values - measured)) for values in drawn]
    reach = max([1.15 * float(v[np.isfinite(v)].max(initial=0.0)) for v in sizes]) or 1.0
    return Drawing(
        [
            Panel(moved, "", "", f"position ({unit})"),
            Panel(errors, "", "time (s)", f"error (m{unit})", ylim=(-reach, reach), height=165),
        ],
        over_time=True,
        wide=True,
    )
