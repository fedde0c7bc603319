"""Gains of all drives and the base parameters from two logs, of which the second was recorded with a known payload.

A drive's logged torque v_j, in whatever unit, is torque over its gain g_j. With h_j = 1 / g_j, base parameters b and a
payload that adds P m + Q f to them (m its known mass, f what is unknown of it), the rows of joint j are

    v_j = h_j Y_j (b + s (P m + Q f)) + offset + delay dv_j/dt,    s = 0 without, 1 with the payload,

as in Gautier and Briot, "Global identification of joint drive gains and dynamic parameters of robots", J. Dyn. Sys.
Meas. Control 136 (2014). There g_j multiplies the logged torque, which makes its noise one of the regressors; here the
torque stays on the side that least squares take as noisy, and the bilinear problem is solved by Gauss and Newton. The
payload's mass alone gives h its scale: without it (b, h) and (c b, h / c) predict the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.covariance import bandwidth_of, summed
from elid_cli.estimation.regression.long_run import small_sample, uncertain
from elid_cli.estimation.regression.triangles import factor_of

STEPS = 60
"""Gauss-Newton steps at most."""
SETTLED = 1e-9
"""Relative decrease of the squares at which they end."""
UNSEEN = 1e-10
"""Singular value, of columns of length one, below which a direction is not told by the data."""
OUTSIDE = 1e-4
"""Part of a gain's direction that may lie in what is not told."""
REWEIGHTED = 3


@dataclass(frozen=True)
class DriveRows:
    """The equations of one joint, M instants."""

    columns: Array
    """Of the base parameters, (b, M)."""
    nuisances: Array
    """Constant and time derivative of the torque, (2, M)."""
    torque: Array
    """As logged, (M,)."""
    use: NDArray[np.bool_]
    """Instants that count, (M,)."""


@dataclass(frozen=True)
class PairFit:
    """What two logs say of the gains."""

    gain: Array
    """N·m (N) per unit of the logged torque, (n,); NaN where the logs do not tell it."""
    std_error: Array
    """(n,), of correlated residuals."""
    relative: Array
    """Covariance of the gains' relative errors, (n, n); NaN where they are not told."""


def fit_pair(
    rows: Sequence[DriveRows | None],
    carried: NDArray[np.bool_],
    segment: NDArray[np.intp],
    known: Array,
    unknown: Array,
) -> PairFit:
    """Estimate the gain of every drive.

    Parameters
    ----------
    rows
        Equations of every joint; None: no torque.
    carried, segment
        Whether the payload is carried at each instant, and which segment of the logs the instant is of, (M,).
    known, unknown
        What the payload adds to the base parameters: known part (b,), a column for each unknown (b, u).
    """
    problem = _Problem.of(rows, carried, known, unknown)
    solution = problem.start()
    for _ in range(REWEIGHTED):
        problem = problem.weighted(solution)
        solution = problem.solve(solution)
    inverse, told = problem.inverse(solution)
    gain, deviation = np.full((2, len(rows)), np.nan)
    relative = np.full((len(rows), len(rows)), np.nan)
    targets = [(j, problem.place_of_gain(k)) for k, j in enumerate(problem.joints) if told[problem.place_of_gain(k)]]
    if not targets:
        return PairFit(gain, deviation, relative)
    scores = problem.scores(solution, rows, carried, inverse[[place for _, place in targets]])
    bandwidth = bandwidth_of(np.ascontiguousarray(scores.T))
    covariance = summed(scores, segment, bandwidth) * uncertain(len(segment), bandwidth)
    covariance *= small_sample(len(segment), len(solution), bandwidth, len(problem.joints))
    for k, (j, place) in enumerate(targets):
        gain[j] = 1.0 / solution[place]
        deviation[j] = np.sqrt(covariance[k, k]) / solution[place] ** 2
    joints, own = [j for j, _ in targets], solution[[place for _, place in targets]]
    relative[np.ix_(joints, joints)] = covariance / np.outer(own, own)
    return PairFit(gain, deviation, relative)


@dataclass(frozen=True)
class _Problem:
    """The equations as triangles [columns | nuisances | torque] of every joint without and with the payload."""

    joints: tuple[int, ...]
    factors: tuple[tuple[Array, Array], ...]
    """Per joint: without, with the payload."""
    counts: tuple[int, ...]
    known: Array
    unknown: Array
    weights: tuple[float, ...]

    @staticmethod
    def of(rows: Sequence[DriveRows | None], carried: NDArray[np.bool_], known: Array, unknown: Array) -> _Problem:
        joints = tuple(j for j, item in enumerate(rows) if item is not None and item.use.any())
        factors, counts = [], []
        for j in joints:
            item = rows[j]
            assert item is not None
            system = np.vstack([item.columns, item.nuisances, item.torque]).T
            factors.append((factor_of(system[item.use & ~carried]), factor_of(system[item.use & carried])))
            counts.append(int(np.count_nonzero(item.use)))
        return _Problem(joints, tuple(factors), tuple(counts), known, unknown, (1.0,) * len(joints))

    @property
    def base(self) -> int:
        return len(self.known)

    @property
    def width(self) -> int:
        return self.place_of_gain(len(self.joints))

    def place_of_gain(self, k: int) -> int:
        """Return the place of the k-th joint's h among the unknowns: b, f, then h, offset, delay of every joint."""
        return self.base + int(self.unknown.shape[1]) + 3 * k

    def _loaded(self, solution: Array, loaded: int) -> Array:
        """Return the base parameters without (0) or with (1) the payload."""
        payload = self.known + self.unknown @ solution[self.base : self.base + self.unknown.shape[1]]
        return np.asarray(solution[: self.base] + loaded * payload)

    def start(self) -> Array:
        """Return unknowns from the linear problem in which gains multiply the torque, its rows weighted by and by."""
        sizes = np.ones(len(self.joints))
        for _ in range(REWEIGHTED):
            found = self._linear(sizes)
            residuals = [np.concatenate([self.rows_of(found, k, s)[1] for s in (0, 1)]) for k in range(len(sizes))]
            gains = 1.0 / np.array([found[self.place_of_gain(k)] or np.inf for k in range(len(sizes))])
            spread = np.array([np.linalg.norm(r) / np.sqrt(n) for r, n in zip(residuals, self.counts, strict=True)])
            sizes = np.maximum(np.abs(gains) * spread, 1e-300)
        return found

    def _linear(self, sizes: Array) -> Array:
        """Return unknowns with residuals in N·m of given sizes (n,), then h of every joint from its own rows."""
        b, u = self.base, self.unknown.shape[1]
        system = []
        for k, pair in enumerate(self.factors):
            for loaded, factor in enumerate(pair):
                part = np.zeros((len(factor), self.width + 1))
                place = self.place_of_gain(k)
                part[:, :b] = -factor[:, :b]
                part[:, b : b + u] = -loaded * (factor[:, :b] @ self.unknown)
                part[:, place] = factor[:, -1]
                part[:, place + 1 : place + 3] = -factor[:, b : b + 2]
                part[:, -1] = loaded * (factor[:, :b] @ self.known)
                system.append(part / sizes[k])
        whole = np.concatenate(system)
        found = _least_squares(whole[:, :-1], whole[:, -1])
        for k, pair in enumerate(self.factors):
            model = [np.column_stack([f[:, :b] @ self._loaded(found, s), f[:, b : b + 2]]) for s, f in enumerate(pair)]
            torque = np.concatenate([factor[:, -1] for factor in pair])
            place = self.place_of_gain(k)
            found[place : place + 3] = _least_squares(np.concatenate(model), torque)
        return found

    def weighted(self, solution: Array) -> _Problem:
        """Return the problem with every joint's rows weighted by one over their residual."""
        plain = _Problem(self.joints, self.factors, self.counts, self.known, self.unknown, (1.0,) * len(self.joints))
        sizes = []
        for k, count in enumerate(self.counts):
            residual = np.concatenate([plain.rows_of(solution, k, s)[1] for s in (0, 1)])
            torque = float(np.sqrt(sum(np.sum(f[:, -1] ** 2) for f in self.factors[k]) / count))
            sizes.append(max(float(np.linalg.norm(residual)) / np.sqrt(count), 1e-9 * torque, 1e-300))
        return _Problem(
            self.joints, self.factors, self.counts, self.known, self.unknown, tuple(1.0 / size for size in sizes)
        )

    def rows_of(self, solution: Array, k: int, loaded: int) -> tuple[Array, Array]:
        """Return (Jacobian of the model (rows, width), residual (rows,)) of one joint in one log, weighted."""
        return self.equations(solution, k, loaded, self.factors[k][loaded])

    def equations(self, solution: Array, k: int, loaded: int, system: Array) -> tuple[Array, Array]:
        """Return the same of any rows [columns | nuisances | torque], (rows, b + 3)."""
        b, u, place = self.base, self.unknown.shape[1], self.place_of_gain(k)
        h, alone = solution[place], system[:, :b] @ self._loaded(solution, loaded)
        jacobian = np.zeros((len(system), self.width))
        jacobian[:, :b] = h * system[:, :b]
        if loaded:
            jacobian[:, b : b + u] = h * (system[:, :b] @ self.unknown)
        jacobian[:, place] = alone
        jacobian[:, place + 1 : place + 3] = system[:, b : b + 2]
        residual = system[:, -1] - h * alone - system[:, b : b + 2] @ solution[place + 1 : place + 3]
        return self.weights[k] * jacobian, self.weights[k] * residual

    def whole(self, solution: Array) -> tuple[Array, Array]:
        parts = [self.rows_of(solution, k, s) for k in range(len(self.joints)) for s in (0, 1)]
        return np.concatenate([j for j, _ in parts]), np.concatenate([r for _, r in parts])

    def solve(self, solution: Array) -> Array:
        """Return the unknowns of least squares, from nearby ones, by damped Gauss-Newton steps."""
        jacobian, residual = self.whole(solution)
        squares, damping = float(residual @ residual), 1e-6
        for _ in range(STEPS):
            step = _least_squares(jacobian, residual, damping)
            further = self.whole(solution + step)
            after = float(further[1] @ further[1])
            if not after <= squares:
                damping *= 10.0
                if damping > 1e6:
                    break
                continue
            solution, (jacobian, residual) = solution + step, further
            damping = max(damping / 10.0, 1e-12)
            settled, squares = squares - after < SETTLED * squares, after
            if settled:
                break
        return solution

    def inverse(self, solution: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the inverse of the normal matrix (width, width), and whether the data tell each unknown."""
        jacobian, _ = self.whole(solution)
        scale = np.linalg.norm(jacobian, axis=0)
        seen = scale > 0
        scale[~seen] = 1.0
        _, sizes, vectors = np.linalg.svd(jacobian / scale, full_matrices=True)
        sizes = np.append(sizes, np.zeros(len(vectors) - len(sizes)))
        kept = sizes > UNSEEN * sizes[0]
        told = seen & (np.linalg.norm(vectors[~kept], axis=0) < OUTSIDE)
        half = vectors[kept].T / sizes[kept] / scale[:, None]
        return half @ half.T, told

    def scores(
        self, solution: Array, rows: Sequence[DriveRows | None], carried: NDArray[np.bool_], directions: Array
    ) -> Array:
        """Return what every instant's residual moves the unknowns in some directions by, (directions, M)."""
        found = np.zeros((len(directions), len(carried)))
        for k, j in enumerate(self.joints):
            item = rows[j]
            assert item is not None
            system = np.vstack([item.columns, item.nuisances, item.torque]).T
            for loaded, here in enumerate((item.use & ~carried, item.use & carried)):
                jacobian, residual = self.equations(solution, k, loaded, system[here])
                found[:, here] += (jacobian @ directions.T).T * residual
        return found


def _least_squares(columns: Array, target: Array, damping: float = 0.0) -> Array:
    """Return the shortest solution in units of the columns' lengths, damped."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    left, sizes, right = np.linalg.svd(columns / scale, full_matrices=False)
    kept = sizes > UNSEEN * sizes[0]
    inverse = np.where(kept, sizes / np.where(kept, sizes**2 + damping * sizes[0] ** 2, 1.0), 0.0)
    return np.asarray(right.T @ (inverse * (left.T @ target)) / scale)
