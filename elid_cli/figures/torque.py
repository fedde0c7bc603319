"""Measured against predicted torque of one joint over time, the residual under it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from elid_cli.figures.paint import BLUE, GREY, INK, ORANGE, PALE, canvas
from elid_cli.figures.thin import envelope
from elid_cli.report import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas


def draw(figure: Figure) -> Canvas:
    """Draw ``t``, ``measured``, ``residual`` and ``used`` (M,), the ``unit``, and perhaps ``before`` and ``floor``."""
    data = figure.data
    t, measured, residual = data["t"], data["measured"], data["residual"]
    made = canvas(3.5)
    top, under = made.subplots(2, 1, sharex=True, height_ratios=(2, 1.2))
    top.plot(*envelope(t, measured), color=BLUE, linewidth=1.1, label="measured")
    top.plot(*envelope(t, measured - residual), color=ORANGE, linestyle=(0, (4, 2)), linewidth=1.0, label="predicted")
    top.set_ylabel(f"motor torque ({data['unit']})")
    top.legend(loc="upper left", bbox_to_anchor=(0, 1.16), ncols=2, borderaxespad=0)
    if data.get("before") is not None:
        under.plot(*envelope(t, data["before"]), color=PALE, linewidth=0.9, label="before")
    under.plot(*envelope(t, residual), color=INK, linewidth=0.7, label="residual")
    floor = data.get("floor")
    if floor:
        for side in (-2 * floor, 2 * floor):
            under.axhline(side, color=ORANGE, linewidth=0.8, linestyle="--",
                          label="± 2 × noise floor" if side > 0 else None)  # fmt: skip
    used = np.asarray(data["used"], dtype=bool)
    masked = ~used
    drawn = [values for values in (residual, data.get("before")) if values is not None]
    shown = [np.abs(values[used & np.isfinite(values)]) for values in drawn]
    reach = max([2.2 * (floor or 0.0), *(1.15 * float(values.max()) for values in shown if values.size)])
    # what was left out of the fit may be far off and must not set the scale
    under.set_ylim(-reach or -1.0, reach or 1.0)
    if masked.any() and not masked.all():
        under.fill_between(t, 0, 1, where=masked, transform=under.get_xaxis_transform(), color=GREY, alpha=0.13,
                           linewidth=0, label="left out (reversal)")  # fmt: skip
    under.set_ylabel(f"residual ({data['unit']})")
    under.set_xlabel("time (s)")
    if len(under.get_legend_handles_labels()[1]) > 1:
        under.legend(loc="upper left", bbox_to_anchor=(0, 1.26), ncols=4, borderaxespad=0)
    top.margins(x=0.01)
    return made
