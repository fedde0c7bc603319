"""The search of a collocation: from a start to the nearest valley of the cost, and from several to the lowest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.collocation.equations import free_shapes
from elid_cli.estimation.collocation.gauss_newton import Outcome, iterate
from elid_cli.estimation.collocation.problem import Iterate
from elid_cli.estimation.collocation.setup import Setup
from elid_cli.estimation.collocation.starts import other_valleys
from elid_cli.estimation.default_fit import Fit
from elid_cli.estimation.regression.nuisances import DELAY
from elid_cli.estimation.regression.other_shapes import APART, explains_as_well

Array = NDArray[np.float64]

STEPS = 30
"""Most steps of an iteration: 16 were too few for arms in noise (errors of 2.2 standard errors instead of 0.8)."""


def from_start(setup: Setup, start: Iterate, steps: int = STEPS) -> Outcome:
    """Return the outcome of an iteration."""
    setup.problem.rho = setup.first_rho()
    return iterate(setup.problem, start, setup.prior, steps)


def best_of(setup: Setup, *known: Outcome) -> tuple[Outcome, tuple[Outcome, ...]]:
    """Return the outcome of least cost among those known and those that start from several valleys of the shapes.

    With it those in other valleys that explain the log as well.
    """
    tried = [*known, from_start(setup, setup.start)]
    if setup.z_start.size:  # noise leads the default fit far astray at times
        start = Iterate(setup.start.coefficients, setup.start.p.copy(), setup.z_start.copy())
        tried.append(from_start(setup, start))
        tried += [from_start(setup, replace(start, z=z)) for z in _named_by(setup.fit)]
    tried += [from_start(setup, start) for start in other_valleys(setup, lowest(setup, tried).end)]
    best = lowest(setup, tried)
    return best, tuple(_rivals(setup, best, tried))


def lowest(setup: Setup, outcomes: Sequence[Outcome]) -> Outcome:
    """Return the outcome of least cost, equations counted as little as where a motor reverses in any of them."""
    if len(outcomes) == 1:
        return outcomes[0]
    ends = [outcome.end for outcome in outcomes]
    totals = [
        sum(float(part.sum()) for part in costs) + setup.prior(end)[0]
        for costs, end in zip(setup.common_costs(*ends), ends, strict=True)
    ]
    return outcomes[int(np.argmin(np.nan_to_num(totals, nan=np.inf)))]


def values_of(setup: Setup, outcome: Outcome) -> Array:
    """Return an outcome in the columns of the fit it started from, (p + e,)."""
    fit = setup.fit
    values = np.zeros(fit.triangles.width)
    values[setup.p_columns] = outcome.p
    for k, extra in enumerate(fit.nuisances):  # a delay that is no unknown stays as it was fitted
        if extra.name == DELAY and fit.model.parameters + k not in setup.p_columns:
            values[fit.model.parameters + k] = fit.solution.values[fit.model.parameters + k]
    return values


def _named_by(fit: Fit) -> list[Array]:
    """Return the shapes in other valleys that a fit could not tell from its own."""
    if fit.effects is None:
        return []
    found = []
    for other in fit.effects.others:
        items = [replace(e, effect=other.get(k, e.effect)) for k, e in enumerate(fit.effects.effects)]
        found.append(free_shapes(replace(fit.effects, effects=tuple(items))))
    return found


def _rivals(setup: Setup, best: Outcome, tried: Sequence[Outcome]) -> list[Outcome]:
    """Return the outcomes in other valleys than the best one's that explain the log as well, one of each valley."""
    if not len(best.z):
        return []
    found: list[Outcome] = []
    for outcome in tried:
        known = [best, *found]
        if not np.isfinite(outcome.p).all() or min(float(np.max(np.abs(outcome.z - k.z))) for k in known) <= APART:
            continue
        if _as_well(setup, outcome, best):
            found.append(outcome)
    return found


def _as_well(setup: Setup, outcome: Outcome, best: Outcome) -> bool:
    """Whether an outcome explains the log as well as the best one, by the scatter of the costs' difference."""
    theirs, own = setup.common_costs(outcome.end, best.end)
    stretch = np.repeat(np.arange(len(own)), [len(part) for part in own])
    return explains_as_well(np.concatenate(theirs) - np.concatenate(own), stretch)
