"""One effect: the residual without it and with it, against the variable that it follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.report.figures.paint import BLUE, INK, ORANGE, scatter_with_mean
from elid_cli.report.tree import Figure, number_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.diagnosis.refit import Contribution
    from elid_cli.diagnosis.result import Diagnosis
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper


ORDER = 1
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


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every effect and curve found."""
    caption = (
        "The residual of the model without the effect, all else fitted again, and with it, against the variable that "
        "the effect follows most. Line: mean; band: the middle 90 %."
    )
    for k, view in enumerate(effect_views(told.diagnosis, told.contributions) if told.diagnosis else (), start=1):
        title = f"{view.effect} of {view.joint}: without and with"
        yield Figure(f"effect{k}", title, "effect", asdict(view), caption)


def effect_views(found: Diagnosis, parts: Sequence[Contribution]) -> tuple[EffectView, ...]:
    """Return a view of every effect and curve found; `parts` are their `contributions`."""
    from elid_cli.diagnosis.fit.state import without
    from elid_cli.estimation.regression.covariance import residuals
    from elid_cli.report.figures.joint_views import variables

    state = found.state_after
    # an effect that was seen in the positions themselves has no row of torques to be drawn in
    fitted = [part for part in parts if part.rows != "deflection"]
    first = len(state.effects) - len(fitted)
    names = found.robot.joint_names
    views = []
    for k, part in enumerate(fitted):
        joint = names.index(part.joint)
        rest = without(state, first + k)
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
                unit="N·m" if found.robot.joints[joint].revolute else "N",
                variable=variable,
                values=values[use],
                rising=(np.gradient(values) > 0)[use] if split else None,
                without=before[use],
                with_it=after[use],
                error_without=part.without,
                error_with=part.with_it,
            )
        )
    return tuple(views)


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


def draw(figure: Figure, paper: Paper) -> Canvas:
    """Draw ``values``, ``without`` and ``with_it`` (M,), the ``variable``, ``unit`` and held-out errors."""
    data = figure.data
    made = paper.canvas(4.8 if paper.narrow else 2.7)
    shape = (2, 1) if paper.narrow else (1, 2)
    left, right = made.subplots(*shape, sharex=True, sharey=True)
    for axes, key, color, word in ((left, "without", ORANGE, "without"), (right, "with_it", BLUE, "with")):
        rising = data.get("rising")
        if rising is None:
            scatter_with_mean(axes, data["values"], data[key], color)
        else:
            scatter_with_mean(axes, data["values"][rising], data[key][rising], color, label="growing")
            scatter_with_mean(axes, data["values"][~rising], data[key][~rising], INK, dashes="--", label="falling")
            axes.legend(loc="best")
        error = data["error_without" if key == "without" else "error_with"]
        axes.set_title(f"{word} it: held-out error {number_text(error, 3)} {data['unit']}")
        if axes is right or not paper.narrow:
            axes.set_xlabel(data["variable"])
        if axes is left or paper.narrow:
            axes.set_ylabel(f"residual of {data['joint']},\n{data['rows']} row ({data['unit']})")
    return made
