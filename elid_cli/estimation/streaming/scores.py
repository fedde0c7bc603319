"""Long-run covariance of one log's scores (column times residual), from the blocks that were kept of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.long_run import KernelSum, Persistence, small_sample, uncertain
from elid_cli.estimation.streaming.accumulate import ReductionBlock
from elid_cli.estimation.streaming.merged import MergedTriangles
from elid_cli.estimation.streaming.reduced_log import Scores
from elid_cli.model.regressor import EstimationRow


class LogScores:
    """Scores of one log for the solutions that the fit asks about.

    Parameters
    ----------
    layout
        Row groups and the numbers of their columns.
    stock
        The log's triangles.
    blocks
        All of the log, in order.
    """

    def __init__(
        self,
        layout: Sequence[tuple[EstimationRow, NDArray[np.intp]]],
        stock: MergedTriangles,
        blocks: Sequence[ReductionBlock],
    ) -> None:
        self._layout, self._stock, self._blocks = layout, stock, blocks
        self.made: list[Scores] = []
        self._known: dict[tuple[tuple[int, ...], bytes], Array] = {}

    def covariance(self, solution: Solution, nuisances: Sequence[int], gliding: NDArray[np.bool_]) -> Array:
        """Return the covariance of a solution's basis, and keep what it was made of.

        Two solutions with the same nuisances and the same reversals are one.
        """
        key = (tuple(nuisances), gliding.tobytes())
        if key in self._known:
            return self._known[key]
        values, lift = lifted(solution, self._layout, self._stock, nuisances)
        live = live_columns(solution, self._stock, nuisances)
        weights = np.array([solution.weights.get(row, 0.0) ** 2 for row, _ in self._layout])
        residuals = [self._residuals(block, values, gliding) for block in self._blocks]
        memory = Persistence(len(live))
        for block, residual in zip(self._blocks, residuals, strict=True):
            memory.feed(self._summed(block, residual * weights[:, None].astype(residual.dtype), len(values))[live])
        bandwidth = memory.bandwidth
        total = KernelSum(len(lift), bandwidth)
        for block, residual in zip(self._blocks, residuals, strict=True):
            total.feed(self._scores(block, residual), block.segment)
        self.made.append(Scores(total.total(), bandwidth, tuple(nuisances)))
        meat = lift.T @ self.made[-1].gram @ lift * widening(solution, memory.instants, bandwidth)
        found: Array = solution.inverse @ meat @ solution.inverse.T
        self._known[key] = found
        return found

    def _residuals(self, block: ReductionBlock, values: Array, gliding: NDArray[np.bool_]) -> Array:
        """Return every row group's residual where it counts and 0 elsewhere, (groups, m)."""
        factors = np.zeros((len(self._layout), len(block.rows)), dtype=block.rows.dtype)
        for number, ((_, index), pick) in enumerate(zip(self._layout, block.picks, strict=True)):
            np.add.at(factors[number], pick[:-1], -values[index].astype(factors.dtype))
            factors[number, pick[-1]] += 1.0
        residuals: Array = factors @ block.rows
        for number, (row, _) in enumerate(self._layout):
            use = (block.known if gliding[row.joint] else block.use)[row.joint]
            residuals[number, ~use] = 0.0
        return residuals

    def _summed(self, block: ReductionBlock, residuals: Array, width: int) -> Array:
        """Return the scores of every column, (p + 2n, m), summed over row groups."""
        summed = np.zeros((width, block.instants), dtype=residuals.dtype)
        for number, ((_, index), pick) in enumerate(zip(self._layout, block.picks, strict=True)):
            own = block.rows.take(pick[:-1], axis=0)
            own *= residuals[number]
            summed[index] += own
        return summed

    def _scores(self, block: ReductionBlock, residuals: Array) -> Array:
        """Return the scores of every row group's columns, (s, m), unweighted."""
        scores = np.empty((sum(len(index) for _, index in self._layout), block.instants), dtype=residuals.dtype)
        place = 0
        for number, pick in enumerate(block.picks):
            here = scores[place : place + len(pick) - 1]
            np.take(block.rows, pick[:-1], axis=0, out=here, mode="clip")
            here *= residuals[number]
            place += len(here)
        return scores


def lifted(
    solution: Solution,
    layout: Sequence[tuple[EstimationRow, NDArray[np.intp]]],
    stock: MergedTriangles,
    nuisances: Sequence[int],
) -> tuple[Array, Array]:
    """Return the solution over all columns (p + 2n,), and what turns raw scores into whitened ones, (s, r)."""
    columns = _numbers(stock, nuisances)
    values = np.zeros(stock.parameters + 2 * stock.joints)
    values[columns] = solution.values
    inverse = np.zeros((len(values), len(solution.basis)))
    inverse[columns[solution.basis]] = solution.inverse
    parts = [solution.weights.get(row, 0.0) ** 2 * inverse[index] for row, index in layout]
    return values, np.concatenate(parts)


def live_columns(solution: Solution, stock: MergedTriangles, nuisances: Sequence[int]) -> NDArray[np.intp]:
    """Return the numbers of a solution's columns that are not zero, among all p + 2n."""
    return _numbers(stock, nuisances)[solution.live]


def _numbers(stock: MergedTriangles, nuisances: Sequence[int]) -> NDArray[np.intp]:
    first = stock.parameters
    return np.concatenate([np.arange(first), first + np.array(nuisances, dtype=np.intp)]).astype(np.intp)


def widening(solution: Solution, instants: int, bandwidth: float) -> float:
    """Return the factor on a long-run covariance of a solution's whitened scores for what is fitted and uncertain."""
    rows = sum(1 for weight in solution.weights.values() if weight > 0.0)
    return small_sample(instants, len(solution.basis), bandwidth, rows) * uncertain(instants, bandwidth)
