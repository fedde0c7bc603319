"""Whether the error that a trajectory fit leaves has a memory.

What noise without memory moves is known from the normal equations alone, far better than from a few blocks of time. So
these are asked only whether that is what the log shows. The slopes of the loss, summed over parts of the log, scatter
as the normal equations of those parts say if nothing but such noise is left; what a model lacks, however little, moves
neighbouring samples alike, and the sums scatter more.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.normal_equations import sizes, white_covariance
from elid_cli.estimation.trajectory.block_sums import DAMPING, Equations

SHOWN = 2.0
"""Standard deviations from which the sums scatter more than without a memory."""


def has_memory(found: Equations) -> bool:
    """Whether errors near each other in time are alike, by sums over blocks of time or over their parts."""
    parts = ((found.matrix, found.load), (found.short_matrix, found.short_load))
    return any(len(load) > 0 and excess(matrix, load, found.spread) > SHOWN for matrix, load in parts)


def _side_by_side(root: Array, parts: Array) -> Array:
    """Return the solutions X of root X = part, (B, U, U), of a root (U, U) and parts (B, U, U)."""
    count, size, _ = parts.shape
    solved = np.asarray(np.linalg.solve(root, parts.transpose(1, 0, 2).reshape(size, -1)), dtype=np.float64)
    return np.moveaxis(solved.reshape(size, count, size), 1, 0)


def without_memory(found: Equations) -> Array:
    """Return the covariance of unknowns that an error without memory would leave, (U, U); 0 of what is not shown."""
    whole = found.matrix.sum(axis=0)
    inverse: Array = found.spread * white_covariance(whole, DAMPING)
    hidden = np.diag(whole) <= 0
    inverse[hidden], inverse[:, hidden] = 0.0, 0.0
    return inverse


def excess(matrix: Array, load: Array, spread: float) -> float:
    """Return by how much sums scatter more than those of an error without memory, in standard deviations.

    Parameters
    ----------
    matrix, load
        Normal equations of every part of a log at their solution, (B, U, U) and (B, U).
    spread
        Variance of the error in their units.

    With R'R the sum of all matrices, the load of a part divided by R' has a covariance of P - P² times the variance,
    P the part's matrix divided by R' and R: the solution takes P² out. Where no unknown is shown, there are no sums.
    """
    shown = np.diag(matrix.sum(axis=0)) > 0
    if not shown.any():
        return 0.0
    matrix, load = matrix[:, shown][:, :, shown], load[:, shown]
    scale = sizes(matrix.sum(axis=0))
    matrix = matrix / np.outer(scale, scale)
    root = np.linalg.cholesky(matrix.sum(axis=0) + DAMPING * np.eye(len(scale)))
    sums = np.linalg.solve(root, (load / scale).T)
    # of all parts side by side: the root is divided up once
    half = _side_by_side(root, matrix)
    share = _side_by_side(root, half.transpose(0, 2, 1))
    once, twice = float(np.trace(share, axis1=1, axis2=2).sum()), float(np.sum(share**2))
    return (float(np.sum(sums**2)) / spread - (once - twice)) / float(np.sqrt(2.0 * twice))
