"""One joint's residual against everything that it may follow: velocity, position, deflection, torque, time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elid_cli.report.figures.drawing import Drawing, Line, Panel, alike
from elid_cli.report.figures.paint import bands, scatter_with_mean
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli._types import Array
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.joint_views import JointView

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
    caption = "A model that lacks nothing leaves a flat mean."
    title = f"{view.joint}: what the residual follows{where}"
    return Figure(f"residual_{view.joint}{suffix}", title, "residual", data, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``residual`` (M,) against each of ``variables``; ``before`` (M,) is drawn as its mean only."""
    data, panels = figure.data, []
    old = data.get("before") is not None
    for name, values in data["variables"].items():
        marks = scatter_with_mean(values, data["residual"], "blue", label="mean after" if old else "mean")
        if old:
            centre, mean, *_ = bands(values, data["before"])
            marks.append(Line(centre, mean, "orange", "5 3", 1.4, "mean before"))
        panels.append(Panel(marks, "", name, f"residual ({data['unit']})", height=200))
    return Drawing(alike(panels, "y"))
