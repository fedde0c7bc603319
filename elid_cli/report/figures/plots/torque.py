"""Measured against predicted torque of one joint over time, the residuals under it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from elid_cli.report.figures.paint import BEFORE, GREY, INK, MEASURED, ORANGE, envelope
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper

ORDER = 2


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint whose torque is known."""
    caption = (
        "Filtered motor torque, measured and predicted with the spring eliminated, and their difference. Grey: "
        "left out, around reversals."
    )
    for view in told.views:
        old = told.views_before.get(view.joint)
        residuals = [{"name": "residual", "residual": view.residual, "before": None if old is None else old.residual,
                      "floor": view.floor}]  # fmt: skip
        if view.spring_residual is not None:
            residuals.append(
                {"name": "residual, spring torque from the deflection", "residual": view.spring_residual,
                 "before": None if old is None else old.spring_residual, "floor": view.spring_floor}
            )  # fmt: skip
        data = {"joint": view.joint, "unit": view.unit, "t": view.t, "measured": view.measured, "used": view.used,
                "residuals": residuals}  # fmt: skip
        yield Figure(f"torque_{view.joint}", f"{view.joint}: torque and residual", "torque", data, caption)


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``t``, ``measured`` and ``used`` (M,), the ``unit``, and ``residuals``.

    Each of these is a dictionary of ``name``, ``residual`` (M,), ``before`` (M,) or None, and ``floor`` or None; the
    first belongs to the torque that is drawn.
    """
    data = figure.data
    t, measured, residuals = data["t"], data["measured"], data["residuals"]
    made = paper.canvas(2.15 + (1.8 if paper.narrow else 1.35) * len(residuals))
    top, *under = made.subplots(1 + len(residuals), 1, sharex=True, height_ratios=(1.7, *(1.0 for _ in residuals)))
    top.plot(*envelope(t, measured), color=MEASURED, linewidth=2.6, label="measured")
    predicted = measured - residuals[0]["residual"]
    top.plot(*envelope(t, predicted), color=INK, linestyle=(0, (4, 1.5)), linewidth=0.9, label="predicted")
    top.set_ylabel(f"torque ({data['unit']})")
    top.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2, borderaxespad=0.2)
    used = np.asarray(data["used"], dtype=bool)
    for number, (axes, part) in enumerate(zip(under, residuals, strict=True)):
        _residual(axes, t, part, used)
        handles, labels = axes.get_legend_handles_labels()
        # what the first panel has explained needs no second time
        known = 4 if number == 0 else 1 + (part["before"] is not None)
        axes.legend(handles[:known], labels[:known], loc="lower left", bbox_to_anchor=(0, 1.0),
                    ncols=(2 if number == 0 else 1) if paper.narrow else 4, borderaxespad=0.2)  # fmt: skip
        axes.set_ylabel(f"residual ({data['unit']})")
    under[-1].set_xlabel("time (s)")
    top.margins(x=0.01)
    made.align_ylabels()
    return made


def _residual(axes: Axes, t: Any, part: dict[str, Any], used: Any) -> None:
    residual, before, floor = part["residual"], part["before"], part["floor"]
    if before is not None:
        axes.plot(*envelope(t, before), color=BEFORE, linewidth=1.2, label="before")
    if not used.all():
        axes.plot(*envelope(t, residual), color=GREY, linewidth=0.5)
    axes.plot(*envelope(t, np.where(used, residual, np.nan)), color=INK, linewidth=0.8, label=part["name"])
    if floor:
        for side in (-2 * floor, 2 * floor):
            name = "± 2 × noise floor" if side > 0 else None
            axes.axhline(side, color=ORANGE, linewidth=0.8, linestyle="--", label=name)
    drawn = [values for values in (residual, before) if values is not None]
    shown = [np.abs(values[used & np.isfinite(values)]) for values in drawn]
    reach = max([2.2 * (floor or 0.0), *(1.15 * float(values.max()) for values in shown if values.size)]) or 1.0
    # what was left out of the fit may be far off and must not set the scale
    axes.set_ylim(-reach, reach)
    if not used.all() and used.any():
        axes.fill_between(t, 0, 1, where=~used, transform=axes.get_xaxis_transform(), color=GREY, alpha=0.2,
                          linewidth=0, label="left out")  # fmt: skip
