"""Standard errors of the one fit: correlated residuals, shapes of effects that were fitted along, short logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.data import FitData
from elid_cli.estimation.facts import SignalFacts
from elid_cli.estimation.regression.covariance import sandwich
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.estimation.regression.effect_shapes import SHAPE_SPREAD, shape_columns
from elid_cli.estimation.regression.least_squares import Solution, solve
from elid_cli.estimation.regression.long_run import beyond_normal
from elid_cli.estimation.regression.normal_equations import jackknife
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles, to_triangles

SHORT = 400.0
"""Independent instants below which a log is short."""
LEAST_LEFT = 1e-3
"""Share of the information on a direction that a stretch is taken to leave to the others at least."""


def covariance_of(
    data: FitData,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects | None,
    triangles: Triangles,
    solution: Solution,
) -> Array:
    """Return the covariance of the solution's basis, (r, r)."""
    size = len(solution.basis)
    covariance = covariance_with_shapes(data, nuisances, effects, triangles, solution)
    if covariance is None:
        covariance = data.covariance(solution, nuisances, effects)
    return covariance[:size, :size] * _few(data.facts, triangles, size) ** 2


def covariance_with_shapes(
    data: FitData,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects | None,
    triangles: Triangles,
    solution: Solution,
) -> Array | None:
    """Return the covariance of the solution's basis and of the effects' free shapes, (r + s, r + s); None without such.

    Shapes count by their logarithms, in the order of the effects, as parameters that have their prior.
    """
    samples = data.samples
    if effects is None or samples is None:
        return None
    observation = samples.observation
    amplitudes = amplitudes_of(solution, triangles.parameters, nuisances, effects)
    shapes = shape_columns(effects, samples.signals, amplitudes)
    if not shapes:
        return None
    extras = [*nuisances, *effects.extras]
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
    kept = [place.get(int(column), -1) for column in basis]
    return None if min(kept) < 0 else whole[np.ix_(kept, kept)]


def freedom(facts: SignalFacts, triangles: Triangles, fitted: int) -> float:
    """Return the degrees of freedom that a short log leaves, at least 1; inf for a log that is not short.

    A channel below the cut-off f has 2 f independent values per second; each row of the fit has its share of the
    `fitted` parameters. The joint with the fewest usable instants decides.
    """
    share = min(1.0, 2 * facts.cutoff / facts.rate)
    counts = [sum(t.count for t in triangles.of(row)) for row in triangles.rows]
    if not counts or share * facts.instants > SHORT:
        return float("inf")
    return max(share * min(counts) - fitted / len(counts), 1.0)


def _few(facts: SignalFacts, triangles: Triangles, fitted: int) -> float:
    """Return the factor on standard errors of a log that is short.

    Student's t is wider than the normal distribution, and a fit takes its parameters' share of the residual away.
    """
    degrees = freedom(facts, triangles, fitted)
    return beyond_normal(degrees) * float(np.sqrt(1 + fitted / len(triangles.rows) / degrees))


def amplitudes_of(
    solution: Solution, parameters: int, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None
) -> list[Array]:
    """Return the amplitudes of every declared effect in a solution's columns, each (d,)."""
    place = parameters + sum(extra.width for extra in nuisances)
    found = []
    for extra in effects.extras if effects else ():
        found.append(solution.values[place : place + extra.width])
        place += extra.width
    return found


def by_stretches(triangles: Triangles, solution: Solution) -> Array:
    """Return the covariance of the solution's basis by leaving out each stretch of the log in turn, (r, r).

    What a model lacks lasts as long as the motion that shows it, and the kernel of a long-run covariance is shorter:
    estimates then differ between recordings by more than that covariance says (`tests.system.reproduce.recordings`).
    """
    steps = []
    for fold in range(triangles.folds):
        part = replace(triangles, prior=None).stacked(solution.weights, [fold])
        white = part[:, solution.basis] @ solution.inverse
        score = white.T @ (part[:, -1] - part[:, :-1] @ solution.values)
        share, direction = np.linalg.eigh(white.T @ white)  # of all that is known, the part that this stretch says
        steps.append(direction @ ((direction.T @ score) / np.maximum(1.0 - share, LEAST_LEFT)))
    # about the estimate of all, not their mean: a stretch that alone shows a direction moves all the others one way
    found: Array = solution.inverse @ jackknife(np.array(steps), about=0.0) @ solution.inverse.T
    return found
