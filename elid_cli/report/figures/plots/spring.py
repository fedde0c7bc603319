"""Deflection and torque of every elastic joint: what its transmission transmitted, and what of it no line explains.

Above, the torque through the transmission; below, the same less a straight line of the stiffness, where loops of
hysteresis, a dead zone and a bend are as large as they are, not as small as beside the whole torque.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.report.figures.paint import BLUE, INK, ORANGE, PALE, bands, cloud
from elid_cli.report.tree import Figure, number_text
from elid_cli.robot.parameter import StandardParameter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

    from elid_cli.estimation.validation.prediction import Validation
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper
    from elid_cli.signals.signals import Signals

ORDER = 3
PATH = 4000
"""Instants up to which the path through them is drawn; beyond, loops would fill the panel."""
ACROSS = 3
"""Joints side by side on a page."""


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
    """Yield one figure of all transmissions."""
    if told.judged is None or told.signals is None:
        return
    springs = [asdict(view) for view in spring_views(told.judged, told.signals, told.refused)]
    if springs:
        caption = (
            "Torque through each transmission (motor torque less the motor's inertia and friction) against its "
            "deflection e; below, less the line K·e. Two branches mean hysteresis or friction in the transmission, a "
            "flat middle backlash, a bend a stiffness that grows. Pale: around reversals of the motor, where its "
            "friction is undefined."
        )
        yield Figure("springs", "Deflection and torque of the transmissions", "spring", {"springs": springs}, caption)


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
                unit="N·m" if joint.revolute else "N",
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


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``springs``: dictionaries of joint, unit, deflection, transmitted, modelled, rising, used, stiffness."""
    springs = figure.data["springs"]
    across = min(1 if paper.narrow else ACROSS, len(springs))
    blocks = -(-len(springs) // across)
    made = paper.canvas(4.0 * blocks + 0.3)
    grid = made.subplots(2 * blocks, across, squeeze=False, height_ratios=(1.5, 1.0) * blocks)
    for axes in grid.ravel():
        axes.set_axis_off()
    for number, spring in enumerate(springs):
        block, column = divmod(number, across)
        curve, rest = grid[2 * block, column], grid[2 * block + 1, column]
        curve.set_axis_on()
        rest.set_axis_on()
        curve.sharex(rest)
        length = "rad" if spring["unit"] == "N·m" else "m"
        line = spring["stiffness"] * np.asarray(spring["deflection"])
        _panel(curve, spring, 0.0 * line)
        _panel(rest, spring, line)
        rounded = float(f"{spring['stiffness']:.4g}")
        stiffness = f"{number_text(rounded)} {spring['unit']}/{length}"
        known = "" if spring["known"] else ", refused"
        curve.set_title(f"{spring['joint']}\nK = {stiffness}{known}")
        curve.tick_params(labelbottom=False)
        rest.set_xlabel(f"deflection (m{length})")
        if column == 0:
            curve.set_ylabel(f"transmitted ({spring['unit']})")
            rest.set_ylabel(f"less K·e ({spring['unit']})")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    made.legend(handles, labels, loc="outside upper left", ncols=2 if paper.narrow else 4, markerscale=3)
    return made


def _panel(axes: Axes, spring: Mapping[str, Any], line: Any) -> None:
    """Draw torques less a line against the deflection; instants around reversals pale and outside the scale."""
    x = 1e3 * np.asarray(spring["deflection"])
    rising, used = np.asarray(spring["rising"], dtype=bool), np.asarray(spring["used"], dtype=bool)
    transmitted, modelled = np.asarray(spring["transmitted"]) - line, np.asarray(spring["modelled"]) - line
    if len(x) <= PATH:
        axes.plot(x, np.where(used | ~np.any(line), transmitted, np.nan), color=PALE, linewidth=0.6, zorder=1,
                  rasterized=True)  # fmt: skip
    for chosen, color, marker, name in ((rising & used, BLUE, ".", "winding up"),
                                        (~rising & used, ORANGE, "x", "unwinding")):  # fmt: skip
        kept = cloud(x[chosen], transmitted[chosen])
        axes.plot(x[chosen][kept], transmitted[chosen][kept], marker, color=color, markersize=2.4,
                  markeredgewidth=0.5 if marker == "x" else 0, alpha=0.45, label=name, rasterized=True)  # fmt: skip
    if len(x) <= PATH:
        axes.plot(x, np.where(used, modelled, np.nan), color=INK, linewidth=0.8, label="model")
    else:
        for chosen, dash in ((rising, "-"), (~rising, "--")):
            centre, mean, *_ = bands(x[chosen & used], modelled[chosen & used])
            axes.plot(centre, mean, color=INK, linestyle=dash, linewidth=1.2, label="model" if dash == "-" else None)
    shown = transmitted[used & np.isfinite(transmitted)]
    if shown.size:
        low, high = float(shown.min()), float(shown.max())
        margin = 0.08 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)
