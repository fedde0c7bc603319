"""Standard errors of the one fit: correlated residuals, shapes of effects that were fitted along, short logs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.data import Solved
from elid_cli.estimation.facts import SignalFacts
from elid_cli.estimation.regression.covariance import sandwich
from elid_cli.estimation.regression.effect_shapes import SHAPE_SPREAD, shape_columns
from elid_cli.estimation.regression.least_squares import Solution, solve
from elid_cli.estimation.regression.long_run import beyond_normal
from elid_cli.estimation.regression.normal_equations import jackknife
from elid_cli.estimation.regression.rotor_shares import rotor_columns, rotor_prior
from elid_cli.estimation.regression.triangles import Triangles, to_triangles

SHORT = 400.0
"""Independent instants below which a log is short."""
ROTOR_KNOWN = 0.3
"""Share of a rotor's inertia that its standard error may be for it to be told."""
LEAST_LEFT = 1e-3
"""Share of the information on a direction that a stretch is taken to leave to the others at least."""


def covariance_of(fit: Solved) -> Array:
    """Return the covariance of a fit's basis, (r, r)."""
    size = len(fit.solution.basis)
    covariance = covariance_with_shapes(fit)
    if covariance is None:
        covariance = fit.data.covariance(fit.solution, fit.extras)
    return covariance[:size, :size] * few(fit.data.facts, fit.triangles, size) ** 2


def covariance_with_dropped(fit: Solved, covariance: Array) -> Array:
    """Return a fit's covariance, (r, r), as it is with the nuisances that were taken for none still unknown.

    Drives that are told positions nearly always have an offset. Where it does not show, a weight takes its place: taken
    for none where a joint hardly turns, it left first moments 100 of their standard errors off.
    """
    if fit.before is None or not fit.data.facts.computed.any():
        return covariance
    first, every = fit.model.parameters, fit.before.nuisances
    dropped = [k for k, extra in enumerate(every) if not any(extra is own for own in fit.nuisances)]
    columns = np.delete(np.arange(fit.before.triangles.width), [first + k for k in dropped])
    place = {int(column): k for k, column in enumerate(fit.before.solution.basis)}
    kept = [place.get(int(columns[column]), -1) for column in fit.solution.basis]
    if min(kept, default=-1) < 0:
        return covariance
    whole, values = covariance_of(fit.before), fit.before.solution.values
    wider = whole[np.ix_(kept, kept)]
    gone = [(values[first + k], whole[place[first + k], place[first + k]]) for k in dropped if first + k in place]
    if any(value**2 > variance for value, variance in gone):
        # it may well be what it came to: the two fits say by how much the answer is off then
        moved = values[fit.before.solution.basis[kept]] - fit.solution.values[fit.solution.basis]
        wider = wider + np.outer(moved, moved)
    return wider


def covariance_with_shapes(fit: Solved) -> Array | None:
    """Return the covariance of a fit's basis and of its effects' free shapes, (r + s, r + s); None without such.

    Shapes count by their logarithms, in the order of the effects, as parameters that have their prior; after them come
    the shares of rotors that friction under load tells.
    """
    if fit.effects is None or fit.data.samples is None:
        return None
    shapes = shape_columns(fit.effects, fit.signals, fit.amplitudes())
    rotors = rotor_columns(fit.effects, fit.signals, fit.amplitudes())
    precision = np.full(len(shapes) + len(rotors), 1.0 / SHAPE_SPREAD)
    precision[len(shapes) :] = np.maximum(precision[len(shapes) :], rotor_prior(fit.effects.scene, rotors)[1])
    shapes += [extra for extra, _ in rotors.values()]
    if not shapes:
        return None
    extras = [*fit.extras, *shapes]
    extended = with_prior(to_triangles(fit.observation, extras), fit.triangles, precision)
    basis = np.concatenate([fit.solution.basis, fit.triangles.width + np.arange(len(shapes))]).astype(np.intp)
    wider = solve(extended, fit.solution.weights, basis=basis)
    whole = sandwich(fit.observation, wider, extras)
    place = {int(column): k for k, column in enumerate(wider.basis)}
    kept = [place.get(int(column), -1) for column in basis]
    return None if min(kept) < 0 else whole[np.ix_(kept, kept)]


def told_rotors(fit: Solved) -> dict[int, tuple[float, float]]:
    """Return inertia and standard error, kg·m² (kg) at joints, of rotors beside friction under load, by joint.

    Those that it tells, and those that it took from the robot file. Of one that the file does not give, and that it
    tells no better than `ROTOR_KNOWN`, nothing is said: such friction may be small.
    """
    if fit.effects is None or fit.data.samples is None or not fit.effects.scene.rotors:
        return {}
    columns = rotor_columns(fit.effects, fit.signals, fit.amplitudes())
    whole = covariance_with_shapes(fit) if columns else None
    if whole is None:
        return {}
    shares = np.sqrt(np.maximum(np.diag(whole)[-len(columns) :], 0.0)).tolist()
    here, (_, known) = fit.effects.scene.rotors, rotor_prior(fit.effects.scene, columns)
    return {
        joint: (here[joint], share * most)
        for (joint, (_, most)), share, own in zip(columns.items(), shares, known.tolist(), strict=True)
        if own > 0 or share * most < ROTOR_KNOWN * here[joint]
    }


def with_prior(wider: Triangles, triangles: Triangles, precision: Array) -> Triangles:
    """Return triangles with last columns that others lack, and what is known beforehand.

    The last columns are near 0, by one over their standard deviations, (d,); of the others what `triangles` know.
    """
    count, first = len(precision), triangles.width
    prior = np.zeros((count, wider.width + 1))
    prior[np.arange(count), first + np.arange(count)] = precision
    if triangles.prior is not None:
        prior = np.concatenate([prior, np.insert(triangles.prior, [first], np.zeros((1, count)), axis=1)])
    return replace(wider, prior=prior)


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


def few(facts: SignalFacts, triangles: Triangles, fitted: int) -> float:
    """Return the factor on standard errors of a log that is short.

    Student's t is wider than the normal distribution, and a fit takes its parameters' share of the residual away.
    """
    degrees = freedom(facts, triangles, fitted)
    return beyond_normal(degrees) * float(np.sqrt(1 + fitted / len(triangles.rows) / degrees))


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
    return np.asarray(solution.inverse @ jackknife(np.array(steps), about=0.0) @ solution.inverse.T)
