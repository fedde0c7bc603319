"""Covariance of estimates whose residuals are correlated in time and between rows.

The filter correlates neighbouring instants, one torque channel drives two rows, and real residuals have structure;
so the covariance is the sandwich of the normal matrix with the long-run covariance of the scores (Newey and West
1987), Parzen kernel, bandwidth by Andrews (1991).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.lowpass import LowPass
from elid_cli.observation import Observation
from elid_cli.reduction import Extra, full_columns
from elid_cli.solve import Solution

Array = NDArray[np.float64]


def residuals(observation: Observation, values: Array, extras: Sequence[Extra] = ()) -> dict[tuple[str, int], Array]:
    """Return target minus model per row group, (M,), N·m; masked instants included."""
    result = {}
    for group in observation.groups:
        index, columns = full_columns(group, extras, observation.parameters)
        result[(group.row.kind, group.row.joint)] = group.target - values[index] @ columns
    return result


def sandwich(observation: Observation, solution: Solution, extras: Sequence[Extra] = ()) -> Array:
    """Return the covariance of the solution's basis, (r, r)."""
    place = {int(column): k for k, column in enumerate(solution.basis)}
    scores = np.zeros((observation.instants, len(solution.basis)))
    for group in observation.groups:
        weight = solution.weights.get(group.row, 0.0)
        if weight == 0.0:
            continue
        index, columns = full_columns(group, extras, observation.parameters)
        residual = (group.target - solution.values[index] @ columns) * group.use * weight**2
        kept = [k for k, column in enumerate(index) if int(column) in place]
        scores[:, [place[int(index[k])] for k in kept]] += (columns[kept] * np.where(group.use, residual, 0.0)).T
    whitened = np.nan_to_num(scores) @ solution.inverse
    meat = long_run(whitened, observation.stretch)
    covariance: Array = solution.inverse @ meat @ solution.inverse.T
    return covariance


def long_run(scores: Array, stretch: NDArray[np.intp]) -> Array:
    """Return the long-run covariance sum of zero-mean scores (M, r), summed over instants."""
    width = bandwidth(scores)
    return kernel_gram(scores.T, stretch, width) * small_sample(scores.shape[0], scores.shape[1], width)


def kernel_gram(scores: Array, stretch: NDArray[np.intp], width: float) -> Array:
    """Return the sum over pairs of instants of scores times scores, weighted by a Parzen kernel of lag, (r, r).

    The kernel is the autocorrelation of a triangle of half its width, so that scores smoothed by that triangle are
    squared and summed: positive definite by construction, and smooth scores need not be summed at every instant.
    Instants of different stretches do not count as neighbours.

    Parameters
    ----------
    scores
        (r, M).
    stretch
        Contiguous stretch of every instant, (M,), ascending.
    width
        Lag in instants from which scores count as independent.
    """
    half = max(1, round((width + 1.0) / 2))
    step = max(1, half // 4)
    triangle = 1.0 - np.abs(np.arange(-half + 1, half)) / half
    smooth = LowPass(triangle, step, 0.0)
    total = np.zeros((scores.shape[0], scores.shape[0]))
    starts = np.flatnonzero(np.diff(stretch, prepend=stretch[:1] - 1))
    for start, stop in zip(starts, [*starts[1:], scores.shape[1]], strict=True):
        # padded so that every instant is seen by the whole triangle, from both sides
        smoothed = smooth.apply(np.pad(scores[:, start:stop], ((0, 0), (2 * half, 2 * half + step))))
        total += smoothed @ smoothed.T
    return total * (step / float(triangle @ triangle))


def small_sample(instants: int, width: int, lags: float) -> float:
    """Return the factor for `width` parameters fitted to `instants` correlated over `lags` instants."""
    correlation = max(1.0, 0.54 * lags)
    effective = max(instants / correlation, width + 2.0)
    return effective / (effective - min(width, 0.5 * effective))


def bandwidth(scores: Array) -> float:
    """Return Andrews' automatic bandwidth for the Parzen kernel from AR(1) fits of the scores."""
    power = np.sum(scores[:-1] ** 2, axis=0)
    rho = np.clip(np.sum(scores[1:] * scores[:-1], axis=0) / np.where(power > 0, power, 1.0), -0.97, 0.97)
    innovation = np.mean((scores[1:] - rho * scores[:-1]) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.nansum(4 * rho**2 * innovation**2 / (1 - rho) ** 8)
        bottom = np.nansum(innovation**2 / (1 - rho) ** 4)
    alpha = float(top / bottom) if bottom > 0 else 0.0
    wanted = 2.6614 * (alpha * scores.shape[0]) ** 0.2
    return float(np.clip(wanted, 8.0, scores.shape[0] / 6))
