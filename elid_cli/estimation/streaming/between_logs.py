"""Several logs together: the covariance of what is fitted to all of them, and whether they disagree.

Every log's scores (columns times residual) are those of its own fit, so their long-run covariances add. What its
residual under the common fit sums to beyond that is exact from its triangles, and says by how much its own fit is away
from the common one. That of all parameters together and that of each are judged by their chance; where they are no
chance, the scatter of those parameters that surely moved counts as noise as well (clusters: Cameron and Miller 2015, J.
Human Resources 50), by Student's distribution with as many degrees of freedom as there are logs but one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.long_run import beyond_normal, pieces, small_sample, uncertain
from elid_cli.estimation.streaming.merged import MergedTriangles, counted
from elid_cli.estimation.streaming.reduced_log import ReducedLog
from elid_cli.estimation.streaming.scores import lifted

DOUBT = 1e-3
"""Probability with which logs that agree are said to disagree, by all parameters together and by the largest alone."""
MOVED = 0.01
"""Chance below which a parameter of logs that disagree counts as one of those that differ."""
SHRUNK = 1e-3
"""Share of all logs' information below which a log's own fit stays with the common one."""


@dataclass(frozen=True)
class Together:
    """Covariances of the whitened scores of several logs under a common solution, (r, r)."""

    solution: Solution
    within: Array
    """Of every log's own noise, wide enough for normal intervals to hold with as little as each log says of it."""
    noise: Array
    """Of every log's own noise as it is estimated, (logs, r, r)."""
    shares: Array
    """Every log's share of the whitened information, (logs, r, r); they sum up to about the identity."""
    sums: Array
    """Every log's sum of scores, (logs, r)."""
    pieces: Array
    """Independent pieces of every log that its noise is known from, (logs,)."""

    @property
    def logs(self) -> int:
        """How many logs there are."""
        return len(self.sums)

    @cached_property
    def expected(self) -> Array:
        """Covariance of each log's sum of scores where all logs have the same parameters, (logs, r, r).

        The common fit has taken the log's share of every log's scores out of its sum.
        """
        whole, one = self.noise.sum(axis=0), np.eye(self.noise.shape[1])
        return np.array([
            (one - share) @ own @ (one - share).T + share @ (whole - own) @ share.T
            for own, share in zip(self.noise, self.shares, strict=True)
        ])  # fmt: skip

    @cached_property
    def pulls(self) -> Array:
        """By how much each log's own solution of the basis is away from the common one, (logs, r)."""
        return np.array([own @ sums for own, sums in zip(self._own, self.sums, strict=True)])

    @cached_property
    def _own(self) -> Array:
        """What turns each log's sum of scores into its distance from the common solution, (logs, r, r)."""
        size = self.shares.shape[1]
        return np.array([
            self.solution.inverse @ np.linalg.solve(share + SHRUNK * np.eye(size), np.eye(size))
            for share in self.shares
        ])  # fmt: skip

    def chances(self, transform: Array) -> Array:
        """Return the chance that noise alone moves the parameters transform @ solution as far in any log, (b,)."""
        from scipy.special import fdtrc

        own = transform[:, self.solution.basis]
        least = np.ones(len(transform))
        for pull, turn, expected, known in zip(self.pulls, self._own, self.expected, self.pieces, strict=True):
            along = own @ turn
            variance = np.einsum("bi,ij,bj->b", along, expected, along)
            ratio = np.divide((own @ pull) ** 2, variance, out=np.zeros(len(own)), where=variance > 0)
            least = np.minimum(least, fdtrc(1.0, max(float(known), 1.0), ratio))
        apart = self.logs if self.logs > 2 else 1  # two logs are away from each other, which is one distance
        return np.minimum(least * apart, 1.0)

    @cached_property
    def disagree(self) -> bool:
        """Whether the logs differ by more than their noise."""
        if self.logs < 2:
            return False
        chances = self.chances(self._basis)
        return self.pooled < DOUBT or float(chances.min()) * len(chances) < DOUBT

    @property
    def _basis(self) -> Array:
        """What picks the solution's basis out of its values, (r, p + e)."""
        unit = np.zeros((len(self.solution.basis), len(self.solution.values)))
        unit[np.arange(len(unit)), self.solution.basis] = 1.0
        return unit

    @cached_property
    def pooled(self) -> float:
        """Chance that noise alone makes the sums of scores as large, all together.

        Their squares are compared with what is expected of them, and no covariance is inverted, which is known from
        hardly more pieces than it has columns (Dempster 1958, Ann. Math. Statist. 29).
        """
        from scipy.special import fdtrc

        mean = float(np.trace(self.expected, axis1=1, axis2=2).sum())
        variance = 2.0 * float(np.sum(self.expected**2)) * self.logs / (self.logs - 1)
        if not mean > 0:
            return 1.0
        return float(fdtrc(2.0 * mean**2 / variance, max(float(self.pieces.sum()), 1.0), np.sum(self.sums**2) / mean))

    @property
    def covariance(self) -> Array:
        """Covariance of the solution's basis with what surely differs between the logs, (r, r)."""
        return self._covariance(self._basis, 1.0)

    def of_few(self, transform: Array) -> Array:
        """Return the same, wide enough for intervals of the normal distribution to hold with as few logs, (r, r).

        What the fit takes along is chosen without: to leave a delay out is no caution.

        Parameters
        ----------
        transform
            The parameters transform @ solution of which those that differ are told, (b, p + e).
        """
        return self._covariance(transform, beyond_normal(self.logs - 1))

    def _covariance(self, transform: Array, wide: float) -> Array:
        found = self.solution.inverse @ self.within @ self.solution.inverse.T
        if not self.disagree:
            return np.asarray(found)
        own = transform[:, self.solution.basis]
        apart = np.linalg.pinv(own) @ (self.pulls @ own.T * self.moved(transform)).T
        return np.asarray(found + wide**2 / (self.logs * (self.logs - 1)) * (apart @ apart.T))

    def moved(self, transform: Array) -> NDArray[np.bool_]:
        """Return which of the parameters transform @ solution surely differ between the logs, (b,)."""
        if not self.disagree:
            return np.zeros(len(transform), dtype=bool)
        chances = self.chances(transform)
        return np.asarray(chances <= max(MOVED, float(chances.min())), dtype=np.bool_)


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
    size, count = len(solution.basis), len(logs)
    noise, shares, sums = np.zeros((count, size, size)), np.zeros((count, size, size)), np.zeros((count, size))
    instants, lags = np.array([log.facts.instants for log in logs]), []
    rows = sum(1 for weight in solution.weights.values() if weight > 0.0)
    for k, log in enumerate(logs):
        values, lift = lifted(solution, log.layout, merged, nuisances)
        scores = next((s for s in log.scores if s.nuisances == tuple(nuisances)), log.scores[0])
        noise[k] = lift.T @ scores.gram @ lift
        lags.append(scores.bandwidth)
        if count > 1:
            sums[k], shares[k] = _of_triangles(log, gliding, solution, values, _inverse(solution, merged, nuisances))
    known = np.array([pieces(int(n), lag) for n, lag in zip(instants, lags, strict=True)])
    # each log's residual is that of its own fit, which took as many parameters out of each
    noise *= np.array([small_sample(int(n), size, b, rows) for n, b in zip(instants, lags, strict=True)])[:, None, None]
    within = noise.sum(axis=0) * uncertain(int(instants.sum()), float(np.average(lags, weights=instants)))
    return Together(solution, within, noise, shares, sums, known)


def _inverse(solution: Solution, merged: MergedTriangles, nuisances: Sequence[int]) -> Array:
    """Return what turns all columns (p + 2n) into the whitened ones of a solution, (p + 2n, r)."""
    first = merged.parameters
    columns = np.concatenate([np.arange(first), first + np.array(nuisances, dtype=np.intp)]).astype(np.intp)
    found = np.zeros((first + 2 * merged.joints, len(solution.basis)))
    found[columns[solution.basis]] = solution.inverse
    return found


def _of_triangles(
    log: ReducedLog, gliding: NDArray[np.bool_], solution: Solution, values: Array, inverse: Array
) -> tuple[Array, Array]:
    """Return the whitened sum of a log's scores, (r,), and its share of the whitened information, (r, r).

    Parameters
    ----------
    log, gliding
        The log, and the joints whose reversals count.
    solution, values
        The common solution, and its values over all columns, (p + 2n,).
    inverse
        What turns all columns into the whitened ones, (p + 2n, r).
    """
    size = len(solution.basis)
    sums, share = np.zeros(size), np.zeros((size, size))
    for triangle in counted(log, gliding):
        white = solution.weights.get(triangle.row, 0.0) * (triangle.factor[:, :-1] @ inverse[triangle.index])
        left = triangle.factor[:, -1] - triangle.factor[:, :-1] @ values[triangle.index]
        sums += solution.weights.get(triangle.row, 0.0) * (left @ white)
        share += white.T @ white
    return sums, share
