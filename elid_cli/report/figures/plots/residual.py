"""One joint's residual against everything that it may follow: velocity, position, deflection, torque, time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elid_cli.report.figures.paint import BLUE, ORANGE, bands, scatter_with_mean
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli._types import Array
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.joint_views import JointView
    from elid_cli.report.figures.paint import Paper

ORDER = 4


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint, and one of its motor row where the transmission holds more than the rest."""
    for view in told.views:
        old = told.views_before.get(view.joint)
        yield _followed(view, view.residual, None if old is None else old.residual, "")
        if view.spring_residual is not None and (view.spring_stands_out or (old is not None and old.spring_stands_out)):
            yield _followed(view, view.spring_residual, None if old is None else old.spring_residual, "_spring")


def _followed(view: JointView, residual: Array, before: Array | None, suffix: str) -> Figure:
    where = ", spring torque from the deflection" if suffix else ""
    data = {
        "joint": view.joint, "unit": view.unit, "residual": residual[view.used],
        "before": None if before is None else before[view.used],
        "variables": {name: values[view.used] for name, values in view.variables.items()},
    }  # fmt: skip
    caption = "Points: instants; line: mean; band: the middle 90 %. A model that lacks nothing leaves a flat line."
    title = f"{view.joint}: what the residual follows{where}"
    return Figure(f"residual_{view.joint}{suffix}", title, "residual", data, caption)


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``residual`` (M,) against each of ``variables``; ``before`` (M,) is drawn as its mean only."""
    data = figure.data
    made, panels = paper.grid(len(data["variables"]), 3, 2.2, sharey=True)
    for axes, (name, values) in zip(panels, data["variables"].items(), strict=True):
        scatter_with_mean(axes, values, data["residual"], BLUE)
        if data.get("before") is not None:
            centre, mean, *_ = bands(values, data["before"])
            axes.plot(centre, mean, color=ORANGE, linestyle="--", linewidth=1.4, label="mean before")
        axes.set_xlabel(name)
    for axes in panels[:: min(2 if paper.narrow else 3, len(panels))]:
        axes.set_ylabel(f"residual ({data['unit']})")
    if data.get("before") is not None:
        panels[0].plot([], [], color=BLUE, linewidth=1.6, label="mean after")
        made.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return made
