"""Several starts, several valleys, the lowest.

A friction curve of two exponentials has several valleys, and Gauss-Newton ends in the one it starts in. Columns of
every effect at a grid of shapes are put beside the model's, the trajectory is eliminated once for all of them, and
each combination of one joint's shapes then costs a small linear solve: variable projection about the trajectory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, product

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.collocation.bordered_banded import eliminate_trajectory
from elid_cli.estimation.collocation.gauss_newton import Outcome, iterate
from elid_cli.estimation.collocation.layout import Scanned, free_shapes
from elid_cli.estimation.collocation.problem import Iterate, States
from elid_cli.estimation.collocation.setup import SHAPE_SPREAD, Setup
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.other_shapes import APART, explains_as_well

MOVES = np.linspace(-1.6, 1.6, 9)
"""Moves of a shape's logarithm from what the robot file gives."""
_COMBINATIONS = 4000
_NEAR = 0.5
"""Shapes' logarithms closer than this lie in one valley."""
_WORTH = 8.0
"""Cost above the best within which a further valley is tried."""
_VALLEYS = 2
"""Valleys per joint."""
_STARTS = 3


@dataclass(frozen=True)
class _Valley:
    cost: float
    shapes: Array
    """Logarithms of the joint's scanned shapes."""
    amplitudes: list[Array]


def other_valleys(setup: Setup, now: Iterate) -> list[Iterate]:
    """Return unknowns to start from in valleys other than that of `now`, the most promising first."""
    items = setup.equations.scanned(now.z)
    if not items or setup.effects is None:
        return []
    grids = [np.clip(setup.z_start[item.shape] + MOVES, *item.limits) for item in items]

    def further(states: States) -> Array:
        return setup.equations.dictionary(states, items, grids)

    size = len(now.p) + len(now.z)
    _, known, pull = setup.prior(now)
    places = np.cumsum([size, *(len(MOVES) * len(item.places) for item in items)])
    matrix, gradient = np.zeros((places[-1], places[-1])), np.zeros(places[-1])
    matrix[:size, :size], gradient[:size] = known, pull
    for item, place in zip(items, places, strict=False):
        declared = setup.effects.effects[item.number]
        held = np.tile(1.0 / declared.spread**2, len(MOVES))
        index = place + np.arange(len(held))
        matrix[index, index] += held
        gradient[index] -= held * np.tile(declared.mean, len(MOVES))
    left = eliminate_trajectory(setup.problem, now, (matrix, gradient), further)
    joints = [[k for k, item in enumerate(items) if item.joint == joint] for joint in sorted({i.joint for i in items})]
    by_joint = [_valleys(setup, now, left.matrix, left.gradient, chosen, grids, places) for chosen in joints]
    best = [valleys[0] for valleys in by_joint]
    plans = [(0.0, best)]
    for number, valleys in enumerate(by_joint):
        plans += [
            (v.cost - best[number].cost, [*best[:number], v, *best[number + 1 :]])
            for v in valleys[1:]
            if v.cost < best[number].cost + _WORTH
        ]
    starts = []
    for _, plan in sorted(plans, key=lambda entry: entry[0]):
        start = Iterate(now.coefficients, now.p.copy(), now.z.copy())
        for valley, chosen in zip(plan, joints, strict=True):
            for k, shape, amplitude in zip(chosen, valley.shapes, valley.amplitudes, strict=True):
                start.z[items[k].shape] = shape
                start.p[items[k].places] = amplitude
        if np.max(np.abs(start.z - now.z)) > _NEAR:
            starts.append(start)
    return starts[:_STARTS]


def _valleys(
    setup: Setup,
    now: Iterate,
    matrix: Array,
    gradient: Array,
    chosen: Sequence[int],
    grids: Sequence[Array],
    places: NDArray[np.intp],
) -> list[_Valley]:
    """Return the lowest points of one joint's grid that are no neighbours of each other."""
    items: list[Scanned] = [setup.equations.scanned(now.z)[k] for k in chosen]
    own = np.concatenate([item.places for item in items])
    free = np.setdiff1d(np.arange(len(now.p)), own)
    entries = np.concatenate([np.arange(places[k], places[k + 1]) for k in chosen])
    rest = np.concatenate([own, entries])
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inner = np.linalg.pinv(matrix[np.ix_(free, free)] * np.outer(scale[free], scale[free]), rcond=1e-12, hermitian=True)
    inner *= np.outer(scale[free], scale[free])
    across = matrix[np.ix_(rest, free)] @ inner
    square = matrix[np.ix_(rest, rest)] - across @ matrix[np.ix_(free, rest)]
    slope = gradient[rest] - across @ gradient[free]
    count = len(own)
    gone = -now.p[own]
    base = float(2 * slope[:count] @ gone + gone @ square[:count, :count] @ gone)
    pull = slope[count:] + square[count:, :count] @ gone
    core = square[count:, count:]
    widths = [len(item.places) for item in items]
    begins = np.cumsum([0, *(len(MOVES) * width for width in widths)])
    found: list[_Valley] = []
    for moves in islice(product(range(len(MOVES)), repeat=len(items)), _COMBINATIONS):
        index = np.concatenate([b + m * w + np.arange(w) for b, m, w in zip(begins, moves, widths, strict=False)])
        amplitude = -np.linalg.lstsq(core[np.ix_(index, index)], pull[index], rcond=1e-12)[0]
        shapes = np.array([grids[k][m] for k, m in zip(chosen, moves, strict=True)])
        start = np.array([setup.z_start[item.shape] for item in items])
        cost = base + float(pull[index] @ amplitude) + float(np.sum((shapes - start) ** 2)) / SHAPE_SPREAD**2
        found.append(_Valley(cost, shapes, np.split(amplitude, np.cumsum(widths)[:-1])))
    found.sort(key=lambda valley: valley.cost)
    apart: list[_Valley] = []
    for valley in found:
        if all(np.max(np.abs(valley.shapes - other.shapes)) > 2 * _NEAR for other in apart):
            apart.append(valley)
        if len(apart) == _VALLEYS:
            break
    return apart


STEPS = 30
"""Most steps of an iteration: 16 were too few for arms in noise (errors of 2.2 standard errors instead of 0.8)."""


def from_start(setup: Setup, start: Iterate, steps: int = STEPS, *, roughly: bool = False) -> Outcome:
    """Return the outcome of an iteration."""
    setup.problem.rho = setup.first_rho()
    return iterate(setup.problem, start, setup.prior, steps, roughly=roughly)


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
        if extra.nuisance == "delay" and fit.model.parameters + k not in setup.p_columns:
            values[fit.model.parameters + k] = fit.solution.values[fit.model.parameters + k]
    return values


def _named_by(fit: DefaultFit) -> list[Array]:
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
