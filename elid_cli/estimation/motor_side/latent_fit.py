"""Least squares over the links' unknown motion and the unknowns together, and what the answer's errors are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.iteration import Iteration
from elid_cli.estimation.motor_side.latent import PARTS, Latent, Model
from elid_cli.estimation.motor_side.normal import Normal, Rows, Schur

HUBER = 4.0
"""Torque residual in standard deviations beyond which it counts less."""
_TRIES = 9
SHARES = (1.0, 0.3, 0.1)
"""Shares of a step that are tried: friction's kinks, which move with the path, make a whole one too long."""
_CRAWLS, _WAITS = 2, 6
"""Shorter steps from which on the path of a whole one is fitted once more, and how many to wait where that fails."""
_BLOCKS = 20
"""Blocks of time whose scores tell of correlated residuals."""
_SETTLED = 0.1
"""Move of every compliance, in standard errors, below which iteration may end."""


@dataclass(frozen=True)
class LatentFit:
    """Where a fit ended."""

    problem: Latent
    x: Array
    coefficients: Array
    model: Model
    cost: float
    foreseen: float
    """Cost that the last step's linear equations end at: friction's kinks make the way there long, and hardly move
    its end."""
    freedom: int
    residuals: tuple[Array, Array]
    """Of positions (N, n) and low-passed rows (rows, n + 3 m), over their noise."""
    free: NDArray[np.intp]
    steps: int
    root: Array
    """Square roots of the low-passed rows' robust weights, (rows, n + 3 m)."""
    schur: Schur
    """The undamped Schur complement."""

    @property
    def chi(self) -> float:
        """Cost per degree of freedom: 1 is noise."""
        return self.cost / self.freedom

    @property
    def compliance(self) -> Array:
        """C = 1/K of every joint, (n,)."""
        return self.x[self.problem.unknowns["c"]]

    @cached_property
    def covariance(self) -> Array:
        """Inverse of the undamped Schur complement, in unit noise, (size, size); zeros where held."""
        schur = self.schur
        unit = np.linalg.pinv(schur.matrix * schur.scale[:, None] * schur.scale, hermitian=True)
        return self._whole(schur.scale[:, None] * unit * schur.scale)

    @cached_property
    def block_covariance(self) -> Array:
        """The same from the scores of blocks of time, which keep the residual's correlation."""
        problem, count = self.problem, self.problem.log.count
        sums = np.zeros((_BLOCKS, len(self.free)))
        rows = Rows(problem, self.model, self.x, self.residuals, self.root, self.free)
        for pieces, part, A, P, r in rows:
            cells = pieces.first_knot[part, None] * problem.log.n + np.arange(A.shape[2])
            scores = (P - A @ self.schur.following[cells]) * r[:, :, None]
            places, several = pieces.rows[part], A.shape[1] // pieces.rows.shape[1]
            block = np.repeat((pieces.centres * _BLOCKS // count)[places][:, None], several, axis=1).ravel()
            np.add.at(sums, block, scores.reshape(-1, scores.shape[2]))
        sums -= sums.mean(axis=0)
        inverse = self.covariance[np.ix_(self.free, self.free)]
        return self._whole(inverse @ (sums.T @ sums) @ inverse * _BLOCKS / (_BLOCKS - 1))

    @cached_property
    def errors(self) -> Array:
        """Standard errors of all unknowns, (size,): the larger of the two, the first widened by the misfit."""
        own = np.diag(self.covariance) * max(1.0, self.chi)
        found: Array = np.sqrt(np.maximum(np.maximum(own, np.diag(self.block_covariance)), 0.0))
        return found

    def _whole(self, part: Array) -> Array:
        whole = np.zeros((len(self.x), len(self.x)))
        whole[np.ix_(self.free, self.free)] = part
        return whole


def fit(
    problem: Latent, x: Array, coefficients: Array, free: NDArray[np.bool_], how: Iteration | None = None
) -> LatentFit:
    """Fit coefficients (knots, n) and the free unknowns from where they stand, by Gauss-Newton with damping.

    Raises
    ------
    numpy.linalg.LinAlgError
        The normal equations are singular.
    """
    return _Descent(problem, free, how or Iteration()).run(x.copy(), coefficients.copy())


class _Step(NamedTuple):
    """A step that lowers the cost."""

    x: Array
    coefficients: Array
    residual: tuple[Array, Array, Model]
    cost: float
    foreseen: float
    move: Array
    """The whole one's, of the free unknowns."""
    schur: Schur
    unit: Array


class _Descent:
    def __init__(self, problem: Latent, free: NDArray[np.bool_], how: Iteration) -> None:
        self.problem, self.how = problem, how
        free = free.copy()
        for name in PARTS:
            if name not in problem.parts:
                free[problem.unknowns[name]] = False
        self.free = np.flatnonzero(free)
        spread = problem.prior_spread
        self.pull = np.where(np.isfinite(spread), 1 / spread**2, 0.0)
        self.damping = 1e-3
        self.short = 0
        """Steps that had to be shorter than foreseen; negative while a path fitted once more is not tried again."""

    def _weight(self, tau: Array) -> Array:
        if not self.how.robust:
            return np.ones_like(tau)
        size = np.abs(tau)
        found: Array = np.where(size > HUBER, HUBER / np.maximum(size, 1e-12), 1.0)
        return found

    def _cost(self, theta: Array, tau: Array, weight: Array, x: Array) -> float:
        miss = x - self.problem.prior_mean
        return float(np.sum(theta**2) + np.sum(weight * tau**2) + np.sum(self.pull * miss**2))

    def run(self, x: Array, coefficients: Array) -> LatentFit:
        problem = self.problem
        theta, tau, now = problem.residual(coefficients, x)
        weight = self._weight(tau)
        cost, taken = self._cost(theta, tau, weight, x), 0
        foreseen: list[float] = []
        costs = [cost]
        for _ in range(self.how.steps):
            root = np.sqrt(weight)
            rows = Rows(problem, now, x, (theta, tau), root, self.free)
            normal = Normal(rows, self.pull[self.free], (x - problem.prior_mean)[self.free])
            step = self._stepped(normal, coefficients, x, weight, cost)
            if step is None:
                break
            there, trial, after, lower = step.coefficients, step.x, step.residual, step.cost
            foreseen.append(step.foreseen)
            fall, taken = (cost - lower) / cost, taken + 1
            coefficients, x, (theta, tau, now) = there, trial, after
            weight = self._weight(tau)
            cost = self._cost(theta, tau, weight, x)
            costs.append(cost)
            slow = taken >= self.how.least and fall < self.how.tolerance
            if self.how.decided(cost, fall, foreseen) or (slow and (self._settled(step) or self.how.creeps(costs))):
                break
        undamped = normal.eliminated(0.0)
        if undamped is None:
            raise np.linalg.LinAlgError("singular")
        freedom = theta.size + tau.size - coefficients.size - len(self.free)
        return LatentFit(
            problem, x, coefficients, now, cost, min([*foreseen[-1:], cost]), freedom, (theta, tau), self.free, taken,
            root, undamped,
        )  # fmt: skip

    def _stepped(self, normal: Normal, coefficients: Array, x: Array, weight: Array, cost: float) -> _Step | None:
        """Return the first step that lowers the cost: shorter ones of a direction, then directions that are damped."""
        for attempt in range(_TRIES):
            schur = normal.eliminated(self.damping)
            if schur is None:
                self.damping = max(10 * self.damping, 1e-4)
                continue
            move, unit = normal.move(schur, self.damping)
            path = schur.path(move).reshape(coefficients.shape)
            foreseen = max(cost - schur.fall(move), 0.0)
            for share in SHARES:
                trial = x.copy()
                trial[self.free] += share * move
                there = coefficients + share * path
                after = self.problem.residual(there, trial)
                lower = self._cost(after[0], after[1], weight, trial)
                if share == 1.0 and not lower < cost and self.short >= _CRAWLS:
                    there, after, lower = self._followed(there, trial, after, weight, lower)
                    self.short = self.short if lower < cost else -_WAITS
                if np.isfinite(lower) and lower < cost * (1 + 1e-9):
                    self.short += share < 1.0
                    if attempt == 0 and share == 1.0:
                        self.damping = max(self.damping / 8, 1e-10)
                    return _Step(trial, there, after, lower, foreseen, move, schur, unit)
            self.damping = max(10 * self.damping, 1e-8)
        return None

    def _followed(
        self, there: Array, x: Array, now: tuple[Array, Array, Model], weight: Array, cost: float
    ) -> tuple[Array, tuple[Array, Array, Model], float]:
        """Return the path's coefficients fitted once more to where the unknowns went, the residual and its cost.

        Products of a step's moves leave more of finely measured positions than the step gains: without this, a fit of
        such a log crawls along its valley.
        """
        rows = Rows(self.problem, now[2], x, now[:2], np.sqrt(weight), self.free[:0])
        schur = Normal(rows, np.zeros(0), np.zeros(0)).eliminated(0.0)
        if schur is not None:
            nearer = there + schur.path(np.zeros(0)).reshape(there.shape)
            after = self.problem.residual(nearer, x)
            lower = self._cost(after[0], after[1], weight, x)
            if lower < cost:
                return nearer, after, lower
        return there, now, cost

    def _settled(self, step: _Step) -> bool:
        if not self.how.settle:
            return True
        deviation = step.schur.scale * np.sqrt(np.abs(np.diag(np.linalg.pinv(step.unit, hermitian=True))))
        c = np.isin(self.free, self.problem.unknowns["c"])
        enough = np.maximum(_SETTLED * deviation[c], self.how.near * np.abs(step.x[self.free[c]]))
        return bool(np.all(np.abs(step.move[c]) < enough))
