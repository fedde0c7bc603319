"""What figures show of a found effect: the residual without it and with it, against the variable it follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli.covariance import residuals
from elid_cli.diagnosis.contributions import Contribution
from elid_cli.diagnosis.diagnose import Diagnosis
from elid_cli.diagnosis.state import fit
from elid_cli.views import organised, variables

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EffectView:
    """One effect in the row that it explains best; arrays at the instants that count."""

    effect: str
    joint: str
    rows: str
    unit: str
    variable: str
    values: Array
    without: Array
    """Residual of the refined model without this effect, its parameters fitted again."""
    with_it: Array
    error_without: float
    """Held-out error of the row, N·m (N)."""
    error_with: float


def effect_views(found: Diagnosis, parts: Sequence[Contribution]) -> tuple[EffectView, ...]:
    """Return a view of every effect and curve found; `parts` are their `contributions`."""
    state = found.state_after
    every = (*found.effects, *found.curves)
    first = len(state.effects) - len(every)
    names = found.robot.joint_names
    views = []
    for k, part in enumerate(parts):
        joint = names.index(part.joint)
        rest = fit(state.log, [e for i, e in enumerate(state.effects) if i != first + k], state.scene)
        row = (part.rows, joint)
        before = residuals(rest.log.observation, rest.solution.values, rest.extras)[row]
        after = residuals(state.log.observation, state.solution.values, state.extras)[row]
        group = next(g for g in state.log.observation.groups if (g.row.kind, g.row.joint) == row)
        use = group.use & np.isfinite(before) & np.isfinite(after)
        choices = variables(found.robot, state.log.signals, state.log.observation, joint)
        change = (before - after)[use]
        variable = max(choices, key=lambda name: organised(change, choices[name][use]))
        views.append(
            EffectView(
                effect=part.effect.effect,
                joint=part.joint,
                rows=part.rows,
                unit="N·m" if found.robot.joints[joint].revolute else "N",
                variable=variable,
                values=choices[variable][use],
                without=before[use],
                with_it=after[use],
                error_without=part.without,
                error_with=part.with_it,
            )
        )
    return tuple(views)
