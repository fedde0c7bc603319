"""Several logs together: the covariance of what is fitted to all of them, and whether they disagree.

Every log's scores (columns times residual) are those of its own fit, so their long-run covariances add. What its
residual under the common fit sums to beyond that is exact from its triangles; where these sums scatter from log to log
by more than noise makes them, the scatter counts as noise as well (clusters: Cameron and Miller 2015, J. Human
Resources 50), by Student's distribution with as many degrees of freedom as there are logs but one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.long_run import beyond_normal
from elid_cli.estimation.streaming.merged import MergedTriangles, counted
from elid_cli.estimation.streaming.reduced_log import ReducedLog
from elid_cli.estimation.streaming.scores import lifted, widening
from elid_cli.model.regressor import EstimationRow

DOUBT = 1e-3
"""Probability with which logs that agree are said to disagree."""


@dataclass(frozen=True)
class Together:
    """Covariances of the whitened scores of several logs under a common solution, (r, r)."""

    solution: Solution
    within: Array
    """Of every log's own noise."""
    between: Array
    """Of what the logs' sums of scores differ by; of logs that agree about the same."""
    sums: Array
    """Every log's sum of scores, (logs, r)."""

    @property
    def logs(self) -> int:
        """How many logs there are."""
        return len(self.sums)

    @property
    def disagree(self) -> bool:
        """Whether the logs differ by more than their noise."""
        if self.logs < 2:
            return False
        from scipy.special import chdtri

        ratio = float(np.trace(np.linalg.pinv(self.within, hermitian=True) @ self.between)) * (self.logs - 1)
        return ratio > float(chdtri(len(self.within) * (self.logs - 1), DOUBT))

    @property
    def covariance(self) -> Array:
        """Covariance of the solution's basis, (r, r)."""
        return self._covariance(1.0)

    @property
    def of_few(self) -> Array:
        """The same, wide enough for intervals of the normal distribution to hold with as few logs as there are, (r, r).

        What the fit takes along is chosen without: to leave a delay out is no caution.
        """
        return self._covariance(beyond_normal(self.logs - 1) ** 2)

    def _covariance(self, wide: float) -> Array:
        meat = self.within + wide * self.between if self.disagree else self.within
        return np.asarray(self.solution.inverse @ meat @ self.solution.inverse.T)

    def pulls(self, transform: Array) -> Array:
        """Return by how much each log moves the parameters transform @ solution from where the others have them.

        Shape (logs, b), to first order in their share of all data.
        """
        own = transform[:, self.solution.basis] @ self.solution.inverse
        return np.asarray(self.sums @ own.T)

    def ratios(self, transform: Array) -> Array:
        """Return the variance between logs over that within for the parameters transform @ solution, (b,)."""
        own = transform[:, self.solution.basis] @ self.solution.inverse
        within, between = (np.einsum("bi,ij,bj->b", own, meat, own) for meat in (self.within, self.between))
        return np.where(within > 0, between / np.where(within > 0, within, 1.0), 0.0)


def together(
    logs: Sequence[ReducedLog],
    merged: MergedTriangles,
    solution: Solution,
    nuisances: Sequence[int],
    gliding: NDArray[np.bool_],
) -> Together:
    """Return what several logs say of a common solution.

    Parameters
    ----------
    logs, merged
        The logs, and their triangles together.
    solution, nuisances, gliding
        The solution, the numbers of its nuisances, and the joints whose reversals count, (n,).
    """
    size = len(solution.basis)
    within, sums, lags = np.zeros((size, size)), np.zeros((len(logs), size)), []
    for k, log in enumerate(logs):
        values, lift = lifted(solution, log.layout, merged, nuisances)
        scores = next((s for s in log.scores if s.nuisances == tuple(nuisances)), log.scores[0])
        within += lift.T @ scores.gram @ lift
        lags.append(scores.bandwidth)
        if len(logs) > 1:
            sums[k] = _sum_of_scores(log, gliding, values, lift)
    instants = np.array([log.facts.instants for log in logs])
    within *= widening(solution, int(instants.sum()), float(np.average(lags, weights=instants)))
    between = sums.T @ sums * (len(logs) / (len(logs) - 1)) if len(logs) > 1 else np.zeros_like(within)
    return Together(solution, within, between, sums)


def _sum_of_scores(log: ReducedLog, gliding: NDArray[np.bool_], values: Array, lift: Array) -> Array:
    """Return the whitened sum of a log's scores, (r,), under what `lifted` made of a solution: `values`, `lift`."""
    own: dict[EstimationRow, Array] = {}
    for triangle in counted(log, gliding):
        factor = triangle.factor
        scores = (factor[:, -1] - factor[:, :-1] @ values[triangle.index]) @ factor[:, :-1]
        own[triangle.row] = own[triangle.row] + scores if triangle.row in own else scores
    raw = [own.get(row, np.zeros(len(index))) for row, index in log.layout]
    return np.asarray(np.concatenate(raw) @ lift)
