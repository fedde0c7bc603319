"""Steps, covariances and descents by normal equations in columns of length one; what blocks of time say alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.long_run import beyond_normal


def sizes(matrix: Array) -> Array:
    """Return the lengths of the columns that a Gram matrix (U, U) is of, none of them 0."""
    return np.asarray(np.sqrt(np.maximum(np.diag(matrix), 1e-300)))


def step_of(matrix: Array, load: Array, more: Array | float, held: NDArray[np.bool_] | None = None) -> Array:
    """Return the Gauss-Newton step of normal equations (U, U), (U,); those `held` do not move.

    `more` of the diagonal, one part or (U,), is added to it (Levenberg, Marquardt): directions that the data do not
    show stay where they are.
    """
    if held is not None and held.any():
        step, free = np.zeros(len(load)), ~held
        step[free] = step_of(matrix[np.ix_(free, free)], load[free], np.broadcast_to(more, load.shape)[free])
        return step
    scale = sizes(matrix)
    scaled = matrix / np.outer(scale, scale)
    scaled[np.diag_indices(len(load))] += more
    return np.asarray(-np.linalg.solve(scaled, load / scale) / scale)


def descend(
    x: Array, free: NDArray[np.bool_], residual: Callable[[Array], Array], slopes: Callable[[Array], Array], steps: int
) -> tuple[Array, float]:
    """Return the end of at most `steps` damped Gauss-Newton steps of the free unknowns, and its squared residual.

    `slopes` gives the residual's derivatives by the free unknowns, (N, U).
    """
    r = residual(x)
    cost, damping = float(r @ r), 1e-3
    for _ in range(steps):
        A = slopes(x)
        normal, gradient = A.T @ A, A.T @ r
        for _ in range(steps):
            trial = x.copy()
            trial[free] += step_of(normal, gradient, damping + 1e-10)
            moved = residual(trial)
            now = float(moved @ moved)
            if np.isfinite(now) and now < cost:
                break
            damping = max(10 * damping, 1e-3)
        else:
            break
        fall, x, r, cost, damping = (cost - now) / cost, trial, moved, now, damping / 5
        if fall < 1e-3:
            break
    return x, cost


def white_covariance(matrix: Array, more: float) -> Array:
    """Return the covariance of unknowns whose weighted errors are white with a variance of 1, (U, U)."""
    scale = sizes(matrix)
    found: Array = np.linalg.inv(matrix / np.outer(scale, scale) + more * np.eye(len(matrix))) / np.outer(scale, scale)
    return found


def steps_without(matrix: Array, load: Array, more: float) -> Array:
    """Return the steps without each of B blocks in turn, (B, U), of normal equations by block, (B, U, U), (B, U)."""
    left, pull = matrix.sum(axis=0) - matrix, load.sum(axis=0) - load
    # as `step_of`, all blocks at once
    scale = np.sqrt(np.maximum(np.diagonal(left, axis1=1, axis2=2), 1e-300))
    left /= scale[:, :, None] * scale[:, None, :]
    own = np.arange(load.shape[1])
    left[:, own, own] += more
    found: Array = -np.linalg.solve(left, (pull / scale)[:, :, None])[:, :, 0] / scale
    return found


def jackknife(left_out: Array, about: float | None = None) -> Array:
    """Return the covariance (U, U) of unknowns from their values without each of B blocks in turn, (B, U).

    Deviations are those from their mean, or from `about`.

    The residual's own memory is in what a block changes. Few blocks tell a variance badly: it is that of a normal
    distribution whose 95 % interval is Student's.
    """
    count = len(left_out)
    offset = left_out - (left_out.mean(axis=0) if about is None else about)
    return np.asarray(beyond_normal(count - 1) ** 2 * (count - 1) / count * offset.T @ offset)
