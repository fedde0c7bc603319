"""One effect: the residual without it and with it, against the variable that it follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.report.figures.drawing import Color, Drawing, Line, Panel, alike
from elid_cli.report.figures.paint import scatter_with_mean
from elid_cli.report.tree import Figure, number_text, upper

if TYPE_CHECKING:
    from elid_cli.diagnosis.refit import Contribution
    from elid_cli.diagnosis.result import Diagnosis
    from elid_cli.report.figures.input import FigureInput


ORDER = 1
CURVE = 500
"""Points of a friction curve."""
_CLEARLY = 0.15
"""Share of a torque's mean square by which two branches must follow a variable better than one."""
_OF_TIME = 0.6
"""What a share that follows time counts for: whatever moves follows time."""


@dataclass(frozen=True)
class EffectView:
    """One effect in the row that it explains best; arrays at the instants that count."""

    effect: str
    joint: str
    rows: str
    unit: str
    variable: str
    values: Array
    rising: NDArray[np.bool_] | None
    """Whether the variable grows, where the effect differs between the two directions; None: it does not."""
    without: Array
    """Residual of the refined model without this effect, its parameters fitted again."""
    with_it: Array
    error_without: float
    """Held-out error of the row, N·m (N)."""
    error_with: float
    friction: tuple[Array, Array, Array] | None = None
    """Of a friction curve: motor velocity, the friction of the model before and after there."""


SUMS = (
    " The friction curve is the sum of Coulomb friction fs, viscous friction fv and the effect's terms, so it need not "
    "show fs at any speed."
)


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every effect and curve found; the terms of one curve are one."""
    caption = (
        "Residuals of two models over the variable that the effect follows most: orange, without this effect, "
        "everything else that was found in the model and fitted again; blue, with it."
    )
    if told.diagnosis is None:
        return
    from elid_cli.report.answers.missing import spoken

    names = told.diagnosis.robot.joint_names
    views = sorted(effect_views(told.diagnosis, told.contributions), key=lambda view: names.index(view.joint))
    for k, view in enumerate(views, start=1):
        name = spoken(view.effect)
        title = f"{upper(name)} at {view.joint}: residual without and with it"
        sums = "" if view.friction is None else SUMS
        yield Figure(f"effect{k}", title, "effect", asdict(view), caption + sums)


def effect_views(found: Diagnosis, parts: Sequence[Contribution]) -> tuple[EffectView, ...]:
    """Return a view of every effect and curve found; `parts` are their `contributions`."""
    from elid_cli.diagnosis.refit import without_terms
    from elid_cli.estimation.regression.covariance import residuals
    from elid_cli.report.figures.joint_views import variables

    state = found.state_after
    # an effect that was seen in the positions themselves has no row of torques to be drawn in
    fitted = [part for part in parts if part.rows != "deflection"]
    first = len(state.effects) - len(fitted)
    names = found.robot.joint_names
    places = [(part.effect.effect, part.effect.joint) for part in fitted]
    views = []
    for k, part in enumerate(fitted):
        if places.index(places[k]) < k:
            continue
        joint = names.index(part.joint)
        terms = [first + n for n, place in enumerate(places) if place == places[k]]
        rest = without_terms(state, terms)
        row = (part.rows, joint)
        before = residuals(rest.log.observation, rest.solution.values, rest.extras)[row]
        after = residuals(state.log.observation, state.solution.values, state.extras)[row]
        group = next(g for g in state.log.observation.groups if g.row == row)
        use = group.use & np.isfinite(before) & np.isfinite(after)
        choices = variables(found.robot, state.log.signals, state.log.observation, joint)
        variable, split = _followed((before - after)[use], {name: v[use] for name, v in choices.items()})
        values = choices[variable]
        views.append(
            EffectView(
                effect=part.effect.effect,
                joint=part.joint,
                rows=part.rows,
                unit=found.robot.joints[joint].units[1],
                variable=variable,
                values=values[use],
                rising=(np.gradient(values) > 0)[use] if split else None,
                without=before[use],
                with_it=after[use],
                error_without=part.whole_without,
                error_with=part.with_it,
                friction=_friction(found, joint, terms),
            )
        )
    return tuple(views)


def _friction(found: Diagnosis, joint: int, terms: Sequence[int]) -> tuple[Array, Array, Array] | None:
    """Return (motor velocity, friction before, friction after) of effects that are a friction curve; None of others."""
    from elid_cli.model.effects.scene import EquationRow

    state = found.state_after
    effects = [state.effects[k] for k in terms]
    if not all(type(e).whole_curves(state.scene, joint, e.shape) for e in effects):
        return None
    velocity = state.scene.motion.dtheta[:, joint]
    order = np.argsort(velocity, kind="stable")
    order = order[np.linspace(0, len(order) - 1, CURVE).astype(int)]
    curves = []
    for robot, added in ((found.validation_before.robot, False), (found.refined, True)):
        known = robot.joints[joint].parameters
        torque = known.get("fs", 0.0) * state.scene.direction(joint) + known.get("fv", 0.0) * velocity
        for k, effect in zip(terms, effects, strict=True) if added else ():
            size, _ = type(effect).coefficients(state.scene, joint, state.named(k))
            torque = torque + size @ effect.columns(state.scene)[EquationRow("motor", joint)]
        curves.append(torque[order])
    return velocity[order], curves[0], curves[1]


def _followed(change: Array, choices: dict[str, Array]) -> tuple[str, bool]:
    """Return the variable that a torque follows most, and whether differently in its two directions.

    Anything follows time, and two branches follow anything better than one: both must be clearly better to be chosen.
    """
    from elid_cli.report.figures.joint_views import organised

    scores = {}
    for name, values in choices.items():
        if name.startswith("time"):
            scores[name, False] = _OF_TIME * organised(change, values)
            continue
        rising = np.gradient(values) > 0
        scores[name, False] = organised(change, values)
        branches = sum(
            organised(change[side], values[side]) * float(np.sum(change[side] ** 2)) for side in (rising, ~rising)
        )
        scores[name, True] = branches / max(float(np.sum(change**2)), 1e-300) - _CLEARLY
    return max(scores, key=lambda key: scores[key])


def draw(figure: Figure) -> Drawing:
    """Draw ``values``, ``without`` and ``with_it`` (M,), the ``variable``, ``unit`` and held-out errors."""
    data = figure.data
    rising = data.get("rising")
    sides: tuple[tuple[str, Color, str], ...] = (("without", "orange", "without"), ("with_it", "blue", "with"))
    panels = []
    for key, color, word in sides:
        if rising is None:
            marks = scatter_with_mean(data["values"], data[key], color, label=f"mean {word} it")
        else:
            name = data["variable"].split(" (")[0]
            up, down = f"mean {word} it, {name} growing", f"mean, {name} falling"
            marks = scatter_with_mean(data["values"][rising], data[key][rising], color, label=up)
            marks += scatter_with_mean(data["values"][~rising], data[key][~rising], "ink", dash="5 3", label=down)
        error = data["error_without" if key == "without" else "error_with"]
        title = f"{word} it: held-out error {number_text(error, 3)} {data['unit']}"
        panels.append(Panel(marks, title, data["variable"], f"residual ({data['unit']})", height=230))
    panels = list(alike(panels, "x", "y"))
    if data.get("friction") is not None:
        x, before, after = data["friction"]
        lines = [
            Line(x, before, "orange", "5 3", 1.4, "friction before"),
            Line(x, after, "blue", "", 1.8, "friction after"),
        ]
        panels.append(Panel(lines, "friction curve", data["variable"], f"torque ({data['unit']})", height=230))
    return Drawing(panels)
