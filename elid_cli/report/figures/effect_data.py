"""What figures show of a found effect: the residual without it and with it, against the variable it follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import without
from elid_cli.diagnosis.refit import Contribution
from elid_cli.diagnosis.result import Diagnosis
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.report.figures.data import organised, variables

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


def effect_views(found: Diagnosis, parts: Sequence[Contribution]) -> tuple[EffectView, ...]:
    """Return a view of every effect and curve found; `parts` are their `contributions`."""
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
