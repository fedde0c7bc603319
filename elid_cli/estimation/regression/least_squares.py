"""Weighted least squares from triangles: a well-conditioned basis inside, base parameters outside.

The leftmost base that is printed can be ill-conditioned (PUMA 560: 1.1e4 against 4.2 for a pivoted one), so the
system is solved for the columns that a pivoted QR prefers and converted exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.regression.triangles import Triangles, factor_of
from elid_cli.lapack import lapack
from elid_cli.model.regressor import EstimationRow

DATA_TOLERANCE = 1e-7
"""Pivot below which a column of the log depends on others, relative to the largest, columns of unit norm."""
ROUNDING = 1e-13
"""Norm below which a standard parameter's column is zero, relative to the largest."""
TIE = 1e-10
"""Part of their norm by which later columns come short of earlier ones."""
WEIGHT_ITERATIONS = 6
FIRM = 1e-3
"""Pivot of unit columns from which on weights are iterated by normal equations."""
LOWEST = 1e-5
"""Share of a row group's torque below which its residual counts as this, so that a perfect fit stays finite."""


_EPSILON = float(np.finfo(float).eps)


@lru_cache(maxsize=64)
def _upper(rows: int, columns: int) -> NDArray[np.bool_]:
    """Return which elements of a matrix lie on and above its diagonal."""
    return np.triu(np.ones((rows, columns), dtype=bool))


@dataclass(frozen=True)
class Solution:
    """A least-squares solution over all columns (p + e), zero outside the pivoted basis."""

    values: Array
    basis: NDArray[np.intp]
    """Columns that were solved for, (r,)."""
    others: NDArray[np.intp]
    """Remaining columns."""
    dependence: Array
    """others = basis @ dependence, (r, len(others)); what the log shows, exact dependencies included."""
    inverse: Array
    """Inverse of the weighted triangle of the basis, (r, r): covariance = inverse @ inverse.T for unit weights."""
    corner: Array
    """Triangle of the scaled basis, (r, r)."""
    margin: float
    """Smallest kept pivot over the largest dropped one."""
    weights: Mapping[EstimationRow, float]

    @cached_property
    def condition(self) -> float:
        """Condition number of the scaled basis."""
        return float(np.linalg.cond(self.corner))

    @cached_property
    def live(self) -> NDArray[np.intp]:
        """Columns that are not zero, in the basis or dependent on it, in ascending order."""
        return np.sort(np.concatenate([self.basis, self.others[self.dependence.any(axis=0)]]))

    def determined(self, column: int) -> bool:
        """Whether the data determine one column's coefficient by itself; columns of the basis may stand for sums."""
        unit = np.zeros((1, len(self.values)))
        unit[0, column] = 1.0
        return bool(self.estimable(unit)[0])

    def estimable(self, transform: Array) -> NDArray[np.bool_]:
        """Return which rows of `transform` (b, p + e) the data determine, (b,)."""
        gap = transform[:, self.others] - transform[:, self.basis] @ self.dependence
        size = np.abs(transform[:, self.basis]) @ np.abs(self.dependence) + np.abs(transform[:, self.others])
        small: NDArray[np.bool_] = np.abs(gap) <= 1e-5 * np.maximum(size, 1e-300) + 1e-12
        return np.asarray(small.all(axis=1), dtype=np.bool_)


def solve(
    triangles: Triangles,
    weights: Mapping[EstimationRow, float],
    folds: Sequence[int] | None = None,
    rank: int | None = None,
    basis: NDArray[np.intp] | None = None,
) -> Solution:
    """Solve one weighted system.

    Parameters
    ----------
    triangles
        Reduced data.
    weights
        Weight of every row group (one over its residual rms).
    folds
        Folds to use, default all.
    rank
        Largest possible rank (structural base parameters + extra columns), or None.
    basis
        Columns to solve for; default: chosen by pivoting.

    Raises
    ------
    DataError
        If no column is excited.
    """
    system = triangles.stacked(weights, folds)
    return solve_system(system, triangles.parameters, weights, rank, basis)


def solve_system(
    system: Array,
    parameters: int,
    weights: Mapping[EstimationRow, float],
    rank: int | None = None,
    basis: NDArray[np.intp] | None = None,
) -> Solution:
    """Solve weighted equations [columns | target], (rows, p + e + 1), p of the columns standard parameters' (`solve`).

    Raises
    ------
    DataError
        If no column is excited.
    ValueError
        If a number is not finite.
    """
    columns, target, width = system[:, :-1], system[:, -1], system.shape[1] - 1
    if not np.isfinite(system).all():
        raise ValueError("the equations hold NaN or infinity")
    # scaled to one, all columns tie for the first pivot: the first shall have it on every machine, not rounding
    norms = np.linalg.norm(columns, axis=0) * (1.0 + TIE * np.arange(width))
    # a standard parameter's column that is zero but for rounding must not be scaled up to a direction of its own
    rounding = np.zeros(width)
    rounding[:parameters] = ROUNDING * norms[:parameters].max(initial=0.0)
    live = np.flatnonzero(norms > rounding) if basis is None else basis[norms[basis] > 0]
    if not len(live) or not system.shape[0] or rank == 0:
        raise DataError("the log excites no parameter", hint="check that torque and motion are in the log: elid info")
    reflected, order, tau, _, _ = lapack().dgeqp3(np.array(columns[:, live] / norms[live], order="F"), overwrite_a=1)
    order -= 1
    r = np.where(_upper(len(tau), len(live)), reflected[: len(tau)], 0.0)
    pivots = np.abs(r.diagonal())
    count = int(np.sum(pivots > DATA_TOLERANCE * pivots[0]))
    if rank is not None:
        count = min(count, rank)
    margin = float(pivots[count - 1] / max(pivots[count] if count < len(pivots) else 0.0, _EPSILON))
    kept, dropped = live[order[:count]], live[order[count:]]
    corner = r[:count, :count]
    turned = lapack().dormqr("L", "T", reflected[:, : len(tau)], tau, target[:, None], 64)[0]
    values = np.zeros(width)
    values[kept] = lapack().dtrtrs(corner, turned[:count, 0])[0] / norms[kept]
    rest = lapack().dtrtrs(corner, r[:count, count:])[0] if len(dropped) else np.zeros((count, 0))
    # rounding must not look like a dependence: coefficients here are between columns of unit norm
    rest = np.where(np.abs(rest) < 1e-9, 0.0, rest)
    absent = np.ones(width, dtype=bool)
    absent[live] = False
    dead = np.flatnonzero(absent)
    dependence = np.concatenate(
        [rest * norms[dropped][None] / norms[kept][:, None], np.zeros((count, len(dead)))], axis=1
    )
    inverse = lapack().dtrtri(corner)[0] / norms[kept][:, None]
    return Solution(
        values,
        kept,
        np.concatenate([dropped, dead]).astype(np.intp),
        dependence,
        inverse,
        corner,
        margin,
        dict(weights),
    )


def reweighted(triangles: Triangles, rank: int | None = None) -> Solution:
    """Solve with each row group weighted by its own residual, iterated.

    Only rows with a measured right-hand side may be weighted so: a homogeneous row group would drive its own weight
    to infinity and every parameter to zero. Triangles keep the solution: it is asked for again.
    """
    solved = cast(dict[int | None, Solution], triangles.solved)
    if rank not in solved:
        solved[rank] = _reweighted(triangles.joined(), rank)
    return solved[rank]


def _reweighted(whole: Triangles, rank: int | None) -> Solution:
    scales = {row: whole.torque_rms(row) for row in whole.rows}
    weights = {row: 1.0 / scale for row, scale in scales.items() if np.isfinite(scale) and scale > 0}
    start = solve(whole, weights, None, rank)
    groups = _Groups.of(whole, start.basis)
    least = np.array([LOWEST * scales[row] if row in weights else np.inf for row in groups.rows])
    values = start.values[start.basis]
    for _ in range(WEIGHT_ITERATIONS):
        weight = 1.0 / np.maximum(groups.rms(values), least)
        found = groups.solved(weight)
        if found is None:
            weights = {row: w for row, w in zip(groups.rows, weight.tolist(), strict=True) if row in weights}
            found = solve(whole, weights, None, rank, start.basis).values[start.basis]
        values = found
    weights = {row: w for row, w in zip(groups.rows, weight.tolist(), strict=True) if row in weights}
    return solve(whole, weights, None, rank)


@dataclass(frozen=True)
class _Groups:
    """The row groups' equations in the columns of a basis, stacked: what is solved with one weight after the other."""

    rows: tuple[EstimationRow, ...]
    lengths: NDArray[np.intp]
    """Equations of each row group …"""
    counts: Array
    """… and instants that they stand for."""
    stack: Array
    """Equations [columns | target], (k, b + 1); last what is known of the columns."""
    grams: Array
    """Their Gram matrices, (row groups, b + 1, b + 1)."""
    known: Array
    """That of what is known, (b + 1, b + 1)."""

    @cached_property
    def equations(self) -> int:
        """Equations of all row groups together."""
        return int(self.lengths.sum())

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """First equation of each row group."""
        return np.asarray(np.cumsum(self.lengths) - self.lengths)

    @classmethod
    def of(cls, whole: Triangles, basis: NDArray[np.intp]) -> _Groups:
        """Return those of joined triangles."""
        place = np.full(whole.width, -1, dtype=np.intp)
        place[basis] = np.arange(len(basis))
        parts = []
        for triangle in whole.items:
            there = place[triangle.index] >= 0
            part = np.zeros((triangle.factor.shape[0], len(basis) + 1))
            part[:, place[triangle.index[there]]] = triangle.factor[:, :-1][:, there]
            part[:, -1] = triangle.factor[:, -1]
            parts.append(part)
        prior = np.zeros((0, len(basis) + 1)) if whole.prior is None else whole.prior[:, np.append(basis, whole.width)]
        return cls(
            tuple(triangle.row for triangle in whole.items),
            np.array([len(part) for part in parts]),
            np.array([float(triangle.count) for triangle in whole.items]),
            np.concatenate([*parts, prior]),
            np.array([part.T @ part for part in parts]),
            prior.T @ prior,
        )

    def rms(self, values: Array) -> Array:
        """Return the residual rms of every row group, N·m."""
        left = (self.stack @ np.append(values, -1.0))[: self.equations]
        return np.sqrt(np.add.reduceat(left**2, self.starts) / self.counts)

    def solved(self, weight: Array) -> Array | None:
        """Return the solution with a weight of every row group; None where a column may depend on the others.

        By the normal equations of unit columns, where these are far from singular: only weights follow from it, and
        residuals feel an error of the solution in second order.
        """
        gram = np.tensordot(weight**2, self.grams, axes=1) + self.known
        norms = np.sqrt(gram.diagonal()[:-1])
        if len(self.stack) <= len(norms) or not norms.all():
            return None
        corner, fault = lapack().dpotrf(gram[:-1, :-1] / (norms[:, None] * norms))
        if fault == 0 and corner.diagonal().min() > FIRM:
            return np.asarray(lapack().dpotrs(corner, gram[:-1, -1] / norms)[0] / norms)
        each = np.ones(len(self.stack))
        each[: self.equations] = np.repeat(weight, self.lengths)
        return _least_squares(self.stack * each[:, None])


def _least_squares(system: Array) -> Array | None:
    """Return the solution of equations [columns | target]; None where a column may depend on the others."""
    norms = np.linalg.norm(system[:, :-1], axis=0)
    system[:, :-1] /= norms
    factor = factor_of(system)
    pivots = np.abs(np.diag(factor)[: len(norms)])
    if not pivots.min() > 10 * DATA_TOLERANCE:
        return None
    return np.asarray(lapack().dtrtrs(factor[:-1, :-1], factor[:-1, -1])[0] / norms)
