"""Measured against predicted torque of one joint over time, the residuals under it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.stretches import spans
from elid_cli.report.figures.drawing import Color, Drawing, Line, Mark, Panel, Rule, Spans
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.joint_views import JointView

ORDER = 2
MOTOR_SIDE = "motor side"


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint whose torque is known."""
    held_out = () if told.diagnosis is None else told.diagnosis.held_out
    worst = max(told.views, key=lambda view: _loudness(view, told.views_before.get(view.joint)), default=None)
    for view in told.views:
        caption = "Filtered motor torque, measured and predicted from the motion, and their difference."
        if view.spring_residual is not None:
            caption += " Motor side: the same with the transmission's torque from the measured deflection."
        if not np.all(view.used):
            caption += " Grey: left out of the fit, around reversals and gaps; what is too large there is not drawn."
        caption += " Green, with a bar below: held-out stretches, which the fit never saw." if held_out else ""
        old = told.views_before.get(view.joint)
        residuals = [_part("", view.residual, None if old is None else old.residual, view.floor)]
        if view.spring_residual is not None:
            before = None if old is None else old.spring_residual
            residuals.append(_part(MOTOR_SIDE, view.spring_residual, before, view.spring_floor))
        data = {"joint": view.joint, "unit": view.unit, "t": view.t, "measured": view.measured, "used": view.used,
                "held_out": held_out, "residuals": residuals, "first": view is worst}  # fmt: skip
        yield Figure(f"torque_{view.joint}", f"{view.joint}: torque and residual", "torque", data, caption)


def _loudness(view: JointView, before: JointView | None) -> float:
    """Return how many times the noise of the sensors the larger residual is, before or after; 0 where not known."""
    sides = [(view.residual, view.floor), (view.spring_residual, view.spring_floor)]
    if before is not None:
        sides += [(before.residual, view.floor), (before.spring_residual, view.spring_floor)]
    known = [(residual[view.used], floor) for residual, floor in sides if residual is not None and floor]
    return max((float(np.sqrt(np.nanmean(residual**2))) / floor for residual, floor in known), default=0.0)


def _part(name: str, residual: Array, before: Array | None, floor: float | None) -> dict[str, Any]:
    return {"name": name, "residual": residual, "before": before, "floor": floor}


def draw(figure: Figure) -> Drawing:
    """Draw ``t``, ``measured`` and ``used`` (M,), the ``unit``, ``held_out`` stretches and ``residuals``.

    Each of these is a dictionary of ``name``, ``residual`` (M,), ``before`` (M,) or None, and ``floor`` or None; the
    first belongs to the torque that is drawn.
    """
    data = figure.data
    t, measured, residuals = data["t"], data["measured"], data["residuals"]
    used = np.asarray(data["used"], dtype=bool)
    shades: list[Mark] = [Spans(spans(t, ~used), "grey", "left out")] if not used.all() else []
    shades += [Spans(held_out, "green", "held out", strip=True)] if (held_out := data.get("held_out")) else []
    torques = [Line(t, measured, "measured", "", 3.0, "measured"),
               Line(t, measured - residuals[0]["residual"], "ink", "5 2", 1.1, "predicted")]  # fmt: skip
    panels = [Panel([*shades, *torques], "", "", f"torque ({data['unit']})")]
    for part in residuals:
        panels.append(_residual(t, part, shades, used, data["unit"]))
    panels[-1] = replace(panels[-1], xlabel="time (s)")
    return Drawing(panels, over_time=True, wide=True)


def _residual(t: Array, part: Mapping[str, Any], shades: Sequence[Mark], used: NDArray[np.bool_], unit: str) -> Panel:
    residual, before, floor = part["residual"], part["before"], part["floor"]
    lines: list[tuple[Array, Color, float, str]] = []
    if before is not None:
        lines.append((before, "before", 1.3, "residual before"))
    lines.append((residual, "ink", 1.0, "residual" if before is None else "residual after"))
    shown = [np.abs(values[used & np.isfinite(values)]) for values, *_ in lines]
    # what was left out of the fit may be far off: it neither sets the scale nor fills the panel's edge
    reach = max([2.2 * (floor or 0.0), *(1.15 * float(v.max()) for v in shown if v.size)]) or 1.0
    marks: list[Mark] = [*shades]
    for values, color, width, label in lines:
        marks.append(Line(t, np.where(np.abs(values) <= reach, values, np.nan), color, "", width, label))
    if floor:
        marks += [Rule(y=side * floor, color="purple", dash="5 3", label="± 2 × noise") for side in (-2.0, 2.0)]
    return Panel(marks, part["name"], "", f"residual ({unit})", ylim=(-reach, reach), height=165)
