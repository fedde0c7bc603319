"""Covariance of estimates whose residuals are correlated in time and between rows.

The filter correlates neighbouring instants, one torque channel drives two rows, and real residuals have structure;
so the covariance is the sandwich of the normal matrix with the long-run covariance of the scores (Newey and West
1987), Parzen kernel, bandwidth by Andrews (1991).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.longrun import KernelSum, Persistence, small_sample
from elid_cli.observation import Observation
from elid_cli.reduction import Extra, full_columns
from elid_cli.solve import Solution

Array = NDArray[np.float64]


def residuals(observation: Observation, values: Array, extras: Sequence[Extra] = ()) -> dict[tuple[str, int], Array]:
    """Return target minus model per row group, (M,), N·m; masked instants included."""
    result: dict[tuple[str, int], Array] = {}
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
    rows = np.ascontiguousarray(scores.T)
    memory = Persistence(width)
    memory.feed(rows)
    total = KernelSum(width, memory.bandwidth)
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    for number, (start, stop) in enumerate(zip(starts, [*starts[1:], instants], strict=True)):
        total.feed(rows[:, start:stop], number)
    return total.total() * small_sample(instants, width, memory.bandwidth)
