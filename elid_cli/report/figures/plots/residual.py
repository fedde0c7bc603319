"""One joint's residual against everything that it may follow: velocity, position, deflection, torque, time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from elid_cli.report.figures.drawing import Drawing, Line, Panel, alike
from elid_cli.report.figures.paint import bands, scatter_with_mean
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli._types import Array
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.joint_views import JointView

ORDER = 4
EVIDENCE = 2
"""Joints whose unexplained residual stands on the page unfolded."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint, and one of its motor row where the transmission holds more than the rest."""
    left = _unexplained(told)
    for view in told.views:
        old = told.views_before.get(view.joint)
        if view.joint in left:
            view = replace(view, variables={**_of_other_joints(told, view.joint), **view.variables})
        figure = _followed(view, view.residual, None if old is None else old.residual, "")
        yield replace(figure, data={**figure.data, "left": view.joint in left})
        if view.spring_residual is not None and (view.spring_stands_out or (old is not None and old.spring_stands_out)):
            yield _followed(view, view.spring_residual, None if old is None else old.spring_residual, "_spring")


def _unexplained(told: FigureInput) -> list[str]:
    """Return the joints with the most times noise that nothing explains, whose figures are evidence."""
    rows = () if told.diagnosis is None else told.diagnosis.unexplained
    ranked = dict.fromkeys(item.joint for item in sorted(rows, key=lambda item: -item.ratio))
    return list(ranked)[:EVIDENCE]


def _of_other_joints(told: FigureInput, joint: str) -> dict[str, Array]:
    """Return the other joint's angle or speed that a residual follows most, with its unit, (M,); empty: of none."""
    if told.diagnosis is None or told.signals is None:
        return {}
    robot, motion, at = told.diagnosis.robot, told.signals.motion, told.signals.outputs
    followed = [o.variable for (name, _), rows in told.diagnosis.organised.items() if name == joint for o in rows]
    for kind, _, other in (variable.partition(" of ") for variable in followed):
        if other in robot.joint_names:
            k = robot.joint_names.index(other)
            unit = robot.joints[k].units[0]
            if kind == "dtheta":
                return {f"velocity of {other} ({unit}/s)": motion.dtheta[at, k]}
            return {f"position of {other} ({unit})": motion.theta[at, k]}
    return {}


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
