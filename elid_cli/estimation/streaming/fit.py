"""The default fit from triangles alone, the same decisions in the same order as `fitting.fit_log` takes them.

First every torque channel has a delay and an offset and reversals are left out; the residual there decides which
joints' reversals count; then nuisances that are not significant go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.default_fit import STICKING
from elid_cli.estimation.regression.least_squares import Solution, reweighted
from elid_cli.estimation.regression.nuisances import beyond_doubt
from elid_cli.estimation.regression.triangles import Triangle, Triangles, factor_of
from elid_cli.model.regressor import EstimationRow

_ORDER = {"link": 0, "sum": 1, "motor": 2}


@dataclass(frozen=True)
class MergedTriangles:
    """Triangles of one log or of several together, with columns for every nuisance there may be."""

    parameters: int
    joints: int
    folds: int
    steady: tuple[Triangle, ...]
    reversing: tuple[Triangle, ...]

    def chosen(self, gliding: NDArray[np.bool_], nuisances: Sequence[int]) -> Triangles:
        """Return the triangles to fit: reversals of the `gliding` joints (n,) and some nuisances only.

        Nuisance k < n is the delay, k >= n the offset of torque channel k mod n; they are numbered anew from p on.
        """
        counted = [*self.steady, *(t for t in self.reversing if gliding[t.row.joint])]
        number = np.full(self.parameters + 2 * self.joints, -1, dtype=np.intp)
        number[: self.parameters] = np.arange(self.parameters)
        number[self.parameters + np.array(nuisances, dtype=np.intp)] = self.parameters + np.arange(len(nuisances))
        items = []
        for triangle in combined(counted):
            kept = number[triangle.index] >= 0
            factor = triangle.factor[:, np.append(kept, True)]
            items.append(replace(triangle, index=number[triangle.index[kept]], factor=factor))
        rows = sorted({t.row for t in items}, key=lambda row: (_ORDER[row.kind], row.joint))
        return Triangles(tuple(items), self.parameters, len(nuisances), self.folds, tuple(rows))

    @property
    def nuisances(self) -> list[int]:
        """Delay and offset of every channel that has equations."""
        present = sorted({t.row.joint for t in self.steady})
        return [*present, *(self.joints + k for k in present)]


@dataclass(frozen=True)
class MergedFit:
    """A fit to triangles."""

    triangles: Triangles
    solution: Solution
    covariance: Array
    """Covariance of the solution's basis, (r, r)."""
    nuisances: tuple[int, ...]
    gliding: NDArray[np.bool_]
    """Joints whose reversals count, (n,)."""


Covariance = Callable[[Solution, Sequence[int], NDArray[np.bool_]], Array]
"""(solution, its nuisances, gliding joints) -> covariance of its basis (r, r)."""


def combined(items: Iterable[Triangle]) -> list[Triangle]:
    """Return one triangle for every row group and fold, in their order."""
    groups: dict[tuple[EstimationRow, int], list[Triangle]] = {}
    for triangle in items:
        groups.setdefault((triangle.row, triangle.fold), []).append(triangle)
    merged = []
    for (row, _), members in sorted(groups.items(), key=lambda g: (_ORDER[g[0][0].kind], g[0][0].joint, g[0][1])):
        first = members[0]
        if len(members) > 1:
            factor = factor_of(np.concatenate([t.factor for t in members]))
            count, power = sum(t.count for t in members), sum(t.power for t in members)
            first = replace(first, factor=factor, count=count, power=power)
        merged.append(replace(first, row=row))
    return merged


def fit_stock(stock: MergedTriangles, rank: int, dt: float, covariance: Covariance) -> MergedFit:
    """Fit triangles by the default estimator.

    Parameters
    ----------
    stock
        All triangles.
    rank
        Number of structural base parameters.
    dt
        Sample time, s: a longer delay is no nuisance of sampling.
    covariance
        Gives the covariance of a solution's basis.
    """
    none = np.zeros(stock.joints, dtype=bool)
    every = stock.nuisances
    steady = stock.chosen(none, every)
    gliding = glides(stock, steady, reweighted(steady, rank + steady.extras).values, every)
    triangles = stock.chosen(gliding, every) if gliding.any() else steady
    solution = reweighted(triangles, rank + triangles.extras)
    spread = covariance(solution, every, gliding)
    kept = significant(stock, solution, spread, every, dt)
    if kept != every:
        triangles = stock.chosen(gliding, kept)
        solution = reweighted(triangles, rank + triangles.extras)
        spread = covariance(solution, kept, gliding)
    return MergedFit(triangles, solution, spread, tuple(kept), gliding)


def glides(stock: MergedTriangles, steady: Triangles, values: Array, nuisances: Sequence[int]) -> NDArray[np.bool_]:
    """Return the joints whose residual at reversals is no larger than elsewhere, (n,)."""
    everywhere = stock.chosen(np.ones(stock.joints, dtype=bool), nuisances)
    result = np.zeros(stock.joints, dtype=bool)
    for k in range(stock.joints):
        row = EstimationRow("sum", k)
        outside, both = steady.of(row), everywhere.of(row)
        count = sum(t.count for t in both) - sum(t.count for t in outside)
        if not outside or count == 0:
            continue
        squares = sum(t.squares(values) for t in outside)
        inside = max(sum(t.squares(values) for t in both) - squares, 0.0) / count
        result[k] = np.sqrt(inside) < STICKING * np.sqrt(squares / sum(t.count for t in outside))
    return result


def significant(
    stock: MergedTriangles, solution: Solution, covariance: Array, nuisances: Sequence[int], dt: float
) -> list[int]:
    """Return the nuisances whose coefficient is significant; a delay must be no longer than one sample (`nuisance`)."""
    values, deviations = np.full((2, len(nuisances)), np.nan)
    for k in range(len(nuisances)):
        where = np.flatnonzero(solution.basis == stock.parameters + k)
        if len(where) and solution.determined(stock.parameters + k):
            values[k] = solution.values[stock.parameters + k]
            deviations[k] = np.sqrt(covariance[where[0], where[0]])
    delays = np.array([nuisance < stock.joints for nuisance in nuisances], dtype=bool)
    return [k for k, firm in zip(nuisances, beyond_doubt(values, deviations, delays, dt), strict=True) if firm]
