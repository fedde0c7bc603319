"""Deflection and torque of every elastic joint: what its transmission transmitted, and what of it no line explains.

First the torque through the transmission; then the same less a straight line of the stiffness, where loops of
hysteresis, a dead zone and a bend are as large as they are, not as small as beside the whole torque.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.report.figures.drawing import Color, Dots, Drawing, Line, Mark, Panel
from elid_cli.report.figures.paint import bands, cloud
from elid_cli.report.tree import Figure, number_text
from elid_cli.robot.parameter import StandardParameter

if TYPE_CHECKING:
    from elid_cli.estimation.validation.prediction import Validation
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.signals.signals import Signals

ORDER = 3
DRAWN = 250
"""Instants of each direction that are drawn."""


@dataclass(frozen=True)
class SpringView:
    """One transmission: what it transmitted against how far it was deflected, at M instants.

    Reversals are kept, since hysteresis shows there; NaN where a stretch ends.
    """

    joint: str
    unit: str
    deflection: Array
    """theta - q, rad (m)."""
    transmitted: Array
    """Motor torque less the motor's own inertia and friction, N·m (N)."""
    modelled: Array
    """What the description says: K (theta - q) and the effects of the transmission."""
    rising: NDArray[np.bool_]
    """Whether the deflection grows."""
    used: NDArray[np.bool_]
    """Instants that count (not masked around a reversal of the motor, where its friction is undefined)."""
    stiffness: float
    known: bool
    """Whether the stiffness is more than what a fit had to put there: False where it was refused."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every transmission whose stiffness is known."""
    if told.judged is None or told.signals is None:
        return
    caption = (
        "Torque through the transmission (motor torque less the motor's inertia and friction) against its deflection e,"
        " and the same less the line K·e. Two branches mean hysteresis or friction in the transmission, a flat middle"
        " backlash, a bend a stiffness that grows. Left out: around reversals of the motor."
    )
    for view in spring_views(told.judged, told.signals, told.refused):
        title = f"{view.joint}: deflection and torque of the transmission"
        yield Figure(f"spring_{view.joint}", title, "spring", asdict(view), caption)


def spring_views(found: Validation, signals: Signals, refused: Collection[str] = ()) -> tuple[SpringView, ...]:
    """Return the deflection-torque curve of every elastic joint whose stiffness the description gives.

    `refused` names parameters that the log does not support.
    """
    from elid_cli.model.regressor import EstimationRow
    from elid_cli.report.figures.joint_views import broken, deflection_of

    bare = _without_spring_effects(found, signals)
    views = []
    for k, joint in enumerate(found.robot.joints):
        row = EstimationRow("motor", k)
        stiffness = joint.parameters.get("K")
        if row not in found.residual or not joint.elastic or stiffness is None or signals.still[k]:
            continue
        group = found.observation.group(row)
        deflection = deflection_of(found.observation, k, found.robot.parameter_names())
        if deflection is None or not group.use.any():
            continue
        transmitted = stiffness * deflection + bare.residual[row]
        views.append(
            SpringView(
                joint=joint.name,
                unit=joint.units[1],
                deflection=broken(deflection, found.observation),
                transmitted=transmitted,
                modelled=transmitted - found.residual[row],
                rising=np.gradient(deflection) > 0,
                used=group.use,
                stiffness=float(stiffness),
                known=StandardParameter("K", k) not in refused,
            )
        )
    return tuple(views)


def _without_spring_effects(found: Validation, signals: Signals) -> Validation:
    """Return the same description judged without its effects of the transmission: their torque is then residual."""
    from elid_cli.estimation.validation.prediction import validate
    from elid_cli.model.effects.declared import resolve

    kept = tuple(spec for spec in found.robot.effects if resolve(found.robot, spec)[0].place != "spring")
    if len(kept) == len(found.robot.effects):
        return found
    return validate(replace(found.robot, effects=kept), signals)


def draw(figure: Figure) -> Drawing:
    """Draw a spring: joint, unit, deflection, transmitted, modelled, rising, used, stiffness, known."""
    spring = figure.data
    length = "rad" if spring["unit"] == "N·m" else "m"
    rounded = float(f"{spring['stiffness']:.4g}")
    title = f"K = {number_text(rounded)} {spring['unit']}/{length}{'' if spring['known'] else ', refused'}"
    line = spring["stiffness"] * np.asarray(spring["deflection"])
    x = f"deflection e (m{length})"
    return Drawing([_panel(spring, 0.0 * line, title, x, f"transmitted ({spring['unit']})"),
                    _panel(spring, line, "", x, f"less K·e ({spring['unit']})")])  # fmt: skip


def _panel(spring: Mapping[str, Any], line: Array, title: str, xlabel: str, ylabel: str) -> Panel:
    """Return torques less a line against the deflection, without instants around reversals."""
    x, used = 1e3 * np.asarray(spring["deflection"]), np.asarray(spring["used"], dtype=bool)
    rising = np.asarray(spring["rising"], dtype=bool)
    transmitted, modelled = np.asarray(spring["transmitted"]) - line, np.asarray(spring["modelled"]) - line
    sides: tuple[tuple[NDArray[np.bool_], Color, Literal["o", "x"], str, str], ...] = (
        (rising, "blue", "o", "", "winding up"), (~rising, "orange", "x", "5 3", "unwinding"),
    )  # fmt: skip
    marks: list[Mark] = []
    for side, color, shape, _, name in sides:
        a, b = x[side & used], transmitted[side & used]
        kept = cloud(a, b, most=DRAWN)
        marks.append(Dots(a[kept], b[kept], color, shape, 2.4, 0.5, name))
    for side, _, _, dash, name in sides:
        centre, mean, *_ = bands(x[side & used], modelled[side & used])
        marks.append(Line(centre, mean, "ink", dash, 1.3, f"model, {name}"))
    return Panel(marks, title, xlabel, ylabel, height=230)
