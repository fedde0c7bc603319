"""Covariance of estimates whose residuals are correlated in time and between rows.

The filter correlates neighbouring instants, one torque channel drives two rows, and real residuals have structure;
so the covariance is the sandwich of the normal matrix with the long-run covariance of the scores (Newey and West
1987), Parzen kernel, bandwidth by Andrews (1991).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

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
    instants, width = scores.shape
    bandwidth = _bandwidth(scores)
    total = scores.T @ scores
    for lag in range(1, min(int(bandwidth) + 1, instants - 1)):
        x = lag / (bandwidth + 1.0)
        kernel = 1 - 6 * x**2 + 6 * x**3 if x <= 0.5 else 2 * (1 - x) ** 3
        same = (stretch[lag:] == stretch[:-lag])[:, None]
        cross = scores[lag:].T @ (scores[:-lag] * same)
        total = total + kernel * (cross + cross.T)
    correlation = max(1.0, 0.54 * bandwidth)
    effective = max(instants / correlation, width + 2.0)
    return total * effective / (effective - min(width, 0.5 * effective))


def _bandwidth(scores: Array) -> float:
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
