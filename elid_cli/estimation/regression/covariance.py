"""Sandwich covariance; one equation with long-run errors.

The filter correlates neighbouring instants, one torque channel drives two rows, and real residuals have structure;
so the covariance is the sandwich of the normal matrix with the long-run covariance of the scores (Newey and West
1987), Parzen kernel, bandwidth by Andrews (1991).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.long_run import TAKEN, KernelSum, Persistence, small_sample, uncertain
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns, full_columns, parts_of
from elid_cli.model.regressor import EstimationRow


def residuals(
    observation: Observation, values: Array, extras: Sequence[ExtraColumns] = ()
) -> dict[tuple[str, int], Array]:
    """Return target minus model per row group, (M,), N·m; masked instants included."""
    result: dict[tuple[str, int], Array] = {}
    for group in observation.groups:
        index, columns = full_columns(group, extras, observation.parameters)
        result[group.row] = group.target - values[index] @ columns
    return result


def sandwich(observation: Observation, solution: Solution, extras: Sequence[ExtraColumns] = ()) -> Array:
    """Return the covariance of the solution's basis, (r, r)."""
    live = solution.live
    place = np.full(len(solution.values), -1, dtype=np.intp)
    place[live] = np.arange(len(live))
    scores = np.zeros((len(live), observation.instants))
    for group in observation.groups:
        weight = solution.weights.get(group.row, 0.0)
        if weight == 0.0:
            continue
        index, parts = parts_of(group, extras, observation.parameters)
        edges = np.cumsum([len(part) for part in parts])[:-2]
        spans = list(zip(np.split(index, edges), parts[:-1], strict=True))
        residual = group.target - sum(solution.values[own] @ columns for own, columns in spans)
        residual = np.where(group.use, residual, 0.0) * weight**2
        for own, columns in spans:
            _add_scores(scores, place[own], columns, residual, group.use)
    # of each column's own scores: any rotation of them by the order of the pivots would change the width
    memory = Persistence(len(live))
    memory.feed(scores)
    bandwidth = memory.bandwidth
    rows = sum(1 for weight in solution.weights.values() if weight > 0.0)
    meat = summed(scores[place[solution.basis]], observation.segment, bandwidth)
    meat *= small_sample(observation.instants, len(meat), bandwidth, rows)
    meat *= uncertain(observation.instants, bandwidth)
    return np.asarray(solution.inverse @ (solution.inverse.T @ meat @ solution.inverse) @ solution.inverse.T)


def _add_scores(
    scores: Array, places: NDArray[np.intp], columns: Array, residual: Array, use: NDArray[np.bool_]
) -> None:
    """Add columns (k, M) times a residual (M,) to the scores at their places, -1 of those that have none.

    Column by column: one stays in the cache, where all at once pass through memory four times.
    """
    own = np.empty_like(residual)
    for place, column in zip(places.tolist(), columns, strict=True):
        if place >= 0:
            np.multiply(column, residual, out=own)
            if not np.isfinite(own).all():
                own[~use] = 0.0  # what is not known must not spread
            scores[place] += own


def lasting_weights(
    observation: Observation, solution: Solution, extras: Sequence[ExtraColumns] = ()
) -> dict[EstimationRow, float]:
    """Return the weight of every row group with which its instants count for as much as they would if independent.

    A residual that lasts for many instants says once what it shows in all of them. One far below its weight's, as
    without any noise, says nothing of the kind.
    """
    found = residuals(observation, solution.values, extras)
    weights = dict(solution.weights)
    for group in observation.groups:
        weight = weights.get(group.row, 0.0)
        if weight > 0 and group.count:
            residual = weight * np.where(group.use, found[group.row], 0.0)
            lasting = float(long_run(residual[:, None], observation.segment)[0, 0]) / group.count
            weights[group.row] = weight / np.sqrt(max(lasting, 1.0))
    return weights


def long_run(scores: Array, segment: NDArray[np.intp], rows: int = 1, taken: float = TAKEN) -> Array:
    """Return the long-run covariance sum of zero-mean scores (M, r), summed over instants.

    `rows` and `taken` are those of `long_run.small_sample`.
    """
    bandwidth = bandwidth_of(scores)
    factor = small_sample(len(scores), scores.shape[1], bandwidth, rows, taken)
    return summed(np.ascontiguousarray(scores.T), segment, bandwidth) * factor


def bandwidth_of(scores: Array) -> float:
    """Return the kernel's bandwidth for scores (M, r), instants."""
    memory = Persistence(scores.shape[1])
    memory.feed(np.ascontiguousarray(scores.T))
    return memory.bandwidth


def summed(scores: Array, segment: NDArray[np.intp], bandwidth: float) -> Array:
    """Return the kernel's sum over zero-mean scores (r, M), (r, r)."""
    width, instants = scores.shape
    total = KernelSum(width, bandwidth)
    starts = np.flatnonzero(np.diff(segment, prepend=-1))
    for number, (start, stop) in enumerate(zip(starts, [*starts[1:], instants], strict=True)):
        total.feed(scores[:, start:stop], number)
    return total.total()


@dataclass(frozen=True)
class Regression:
    """A fitted equation."""

    values: Array
    """Coefficients, (k,)."""
    spread: Array
    """Their standard deviations, (k,)."""
    alone: Array
    """Mean square of each column that the others do not explain, (k,)."""


def in_unit_columns(columns: Array, target: Array) -> tuple[Array, Array, Array, Array]:
    """Solve a target (M,) by columns (M, k) of length one.

    Returns these columns, their sizes before (k,), the inverse of their normal matrix and the coefficients (k,).
    """
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    unit = columns / scale
    inverse = np.linalg.pinv(unit.T @ unit, rcond=1e-12)
    return unit, scale, inverse, inverse @ (unit.T @ target)


def regression(columns: Array, target: Array, segment: NDArray[np.intp]) -> Regression:
    """Fit a target (M,) by columns (M, k), its residual correlated within each segment (number of every instant, (M,)).

    Standard errors are autocorrelation-aware (Newey and West 1987; `long_run`).
    """
    unit, scale, inverse, fitted = in_unit_columns(columns, target)
    scores = unit * (target - unit @ fitted)[:, None]
    meat = long_run(scores, segment) * uncertain(len(scores), bandwidth_of(scores))
    spread = np.sqrt(np.maximum(np.diag(inverse @ meat @ inverse), 0.0))
    own = np.diag(inverse)
    alone = np.where(own > 0, scale**2 / np.where(own > 0, own, 1.0), 0.0) / len(target)
    return Regression(fitted / scale, spread / scale, alone)
