"""Standard errors of the default fit: correlated residuals, shapes of effects that were fitted along, short logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.covariance import sandwich
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.estimation.regression.effect_shapes import SHAPE_SPREAD, shape_columns
from elid_cli.estimation.regression.least_squares import Solution, solve
from elid_cli.estimation.regression.long_run import beyond_normal
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles, to_triangles
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.signals.signals import Signals

SHORT = 400.0
"""Independent instants below which a log is short."""


def covariance_of(
    base: BaseParameters,
    observation: Observation,
    signals: Signals,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects | None,
    triangles: Triangles,
    solution: Solution,
) -> Array:
    """Return the covariance of the solution's basis, (r, r)."""
    covariance = _of_shapes(base, observation, signals, nuisances, effects, triangles, solution)
    return covariance * _few(observation, signals, triangles, solution) ** 2


def _of_shapes(
    base: BaseParameters,
    observation: Observation,
    signals: Signals,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects | None,
    triangles: Triangles,
    solution: Solution,
) -> Array:
    """Return the covariance of the solution's basis; shapes that were fitted count as parameters with their prior."""
    extras = [*nuisances, *(effects.extras if effects else ())]
    if effects is None:
        return sandwich(observation, solution, extras)
    shapes = shape_columns(effects, signals, amplitudes_of(solution, base, nuisances, effects))
    if not shapes:
        return sandwich(observation, solution, extras)
    extended = to_triangles(observation, [*extras, *shapes])
    prior = np.zeros((len(shapes), extended.width + 1))
    prior[np.arange(len(shapes)), triangles.width + np.arange(len(shapes))] = 1.0 / SHAPE_SPREAD
    if triangles.prior is not None:
        known = np.insert(triangles.prior, [triangles.width], np.zeros((1, len(shapes))), axis=1)
        prior = np.concatenate([prior, known])
    extended = replace(extended, prior=prior)
    basis = np.concatenate([solution.basis, triangles.width + np.arange(len(shapes))]).astype(np.intp)
    wider = solve(extended, solution.weights, basis=basis)
    whole = sandwich(observation, wider, [*extras, *shapes])
    place = {int(column): k for k, column in enumerate(wider.basis)}
    kept = [place.get(int(column), -1) for column in solution.basis]
    if min(kept) < 0:
        return sandwich(observation, solution, extras)
    covariance: Array = whole[np.ix_(kept, kept)]
    return covariance


def freedom(observation: Observation, signals: Signals, fitted: int) -> float:
    """Return the degrees of freedom that a short log leaves, at least 1; inf for a log that is not short.

    A channel below the cut-off f has 2 f independent values per second; each row of the fit has its share of the
    `fitted` parameters. The joint with the fewest usable instants decides.
    """
    if not observation.rate > 0:  # equations that were reduced elsewhere
        return float("inf")
    share = min(1.0, 2 * signals.filter.cutoff / observation.rate)
    counts = [group.count for group in observation.groups if group.count]
    if not counts or share * observation.instants > SHORT:
        return float("inf")
    return max(share * min(counts) - fitted / len(counts), 1.0)


def _few(observation: Observation, signals: Signals, triangles: Triangles, solution: Solution) -> float:
    """Return the factor on standard errors of a log that is short.

    Student's t is wider than the normal distribution, and a fit takes its parameters' share of the residual away.
    """
    fitted = len(solution.basis)
    degrees = freedom(observation, signals, fitted)
    return beyond_normal(degrees) * float(np.sqrt(1 + fitted / len(triangles.rows) / degrees))


def amplitudes_of(
    solution: Solution, base: BaseParameters, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None
) -> list[Array]:
    """Return the amplitudes of every declared effect in a solution's columns, each (d,)."""
    place = len(base.parameters) + sum(extra.width for extra in nuisances)
    found = []
    for extra in effects.extras if effects else ():
        found.append(solution.values[place : place + extra.width])
        place += extra.width
    return found
