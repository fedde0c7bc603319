"""Spline collocation: unknown trajectory and parameters together, by maximum likelihood.

Minimised over spline coefficients c of all channels, linear parameters p and shapes z of declared effects:

    sum ((y - B c) / sigma)^2 + sum ((Y(c; z) p - [0; u]) / rho)^2

Sensor noise is where it belongs, in the positions, so no bias is left. The equations of motion enter as link and
motor rows with fixed rho: a rho estimated from the link rows' own residual would drive every parameter to zero.
Coefficients are ordered knot by knot, so that the normal matrix is banded (half-bandwidth 6 x channels) with a dense
border for p and z; a banded Cholesky factor and a Schur complement solve it in linear time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.smoothing import DEGREE, basis

Array = NDArray[np.float64]

_ORDER = DEGREE + 1
HUBER = 3.0
"""Residual in standard deviations beyond which an equation counts less."""
_STEPS = (1e-6, 1e-6, 1e-4)
"""Relative steps of differences in position, velocity and acceleration."""
_GROW = 3
"""Step at which the equations' noise is raised to what their residual shows."""
_SETTLED = 0.2
"""Fall of the cost, in units of one squared standard deviation, below which the iteration ends."""
_CHUNK = 3000
"""Collocation points whose Jacobian is held at a time."""


@dataclass(frozen=True)
class Piece:
    """One segment of the log.

    `measured` and `weight` are (channels, intervals, stride): samples and one over their noise (0: missing);
    `torque` is (rows, intervals, points): right-hand side at the collocation points; `mask` scales rows there.
    """

    measured: Array
    weight: Array
    torque: Array
    mask: Array
    start: Array
    """Coefficients to start from, (intervals + 5, channels)."""

    @property
    def intervals(self) -> int:
        """Number of knot intervals."""
        return int(self.measured.shape[1])


@dataclass(frozen=True)
class States:
    """Values and two derivatives of every channel at collocation points, (3, channels, instants)."""

    values: Array
    piece: int
    first: int
    """First instant within the piece."""


@dataclass(frozen=True)
class Equations:
    """What the robot contributes: residual of link and motor rows, and their parameter columns.

    `residual(states, p, z)` returns (rows, instants); `columns(states, z)` returns (rows, parameters, instants).
    """

    residual: Callable[[States, Array, Array], Array]
    columns: Callable[[States, Array], Array]
    trust: Callable[[States], Array]
    """Weight of every row at given states, (rows, instants): small where a motor reverses or sticks."""


@dataclass(frozen=True)
class Setting:
    """Knots, points and noise."""

    dt: float
    stride: int
    points: int
    """Collocation points per knot interval."""
    scale: Array
    """Size of each derivative of each channel for finite differences, (3, channels)."""

    @property
    def width(self) -> float:
        """Knot spacing, s."""
        return self.stride * self.dt

    def at_points(self) -> Array:
        """Return basis weights at the collocation points, (3, points, 6)."""
        every = self.stride // self.points
        u = (np.arange(self.points) * every + 0.5 * (every - 1)) / self.stride
        return np.array([basis(u, d) / self.width**d for d in range(3)])

    def at_samples(self) -> Array:
        """Return basis weights at the samples, (stride, 6)."""
        return basis(np.arange(self.stride) / self.stride)


@dataclass
class Iterate:
    """The unknowns."""

    coefficients: list[Array]
    p: Array
    z: Array


@dataclass(frozen=True)
class Outcome:
    """The end of the iteration."""

    p: Array
    z: Array
    coefficients: list[Array]
    covariance: Array
    """Covariance of (p, z) from autocorrelation-aware scores."""
    costs: tuple[float, ...]
    rho: Array
    residual: Array
    """Root mean square of the rows' residuals, (rows,)."""


def coefficients_to_states(setting: Setting, coefficients: Array) -> Array:
    """Return states at the collocation points, (3, channels, intervals * points)."""
    windows = np.lib.stride_tricks.sliding_window_view(coefficients, _ORDER, axis=0)
    weights = setting.at_points()
    values = np.einsum("jcl,dpl->dcjp", windows, weights, optimize=True)
    return np.ascontiguousarray(values.reshape(3, coefficients.shape[1], -1))


class Problem:
    """A collocation problem: pieces of a log, the robot's equations, noise."""

    def __init__(self, setting: Setting, pieces: Sequence[Piece], equations: Equations, rho: Array) -> None:
        self.setting = setting
        self.pieces = tuple(pieces)
        self.equations = equations
        self.rho = rho
        self._trust = [np.ones((len(rho), p.intervals * setting.points)) for p in self.pieces]
        self._weights = setting.at_points()
        self._samples = setting.at_samples()

    def trust(self, now: Iterate) -> None:
        """Decide anew where motors reverse, from the trajectory as it is now."""
        for number in range(len(self.pieces)):
            states = States(coefficients_to_states(self.setting, now.coefficients[number]), number, 0)
            self._trust[number] = self.equations.trust(states)

    def _mask(self, number: int) -> Array:
        mask: Array = self.pieces[number].mask.reshape(len(self.rho), -1) * self._trust[number]
        return mask

    def cost(self, now: Iterate) -> float:
        """Return the Huber cost."""
        total = 0.0
        for number, piece in enumerate(self.pieces):
            misfit = self._misfit(piece, now.coefficients[number])
            total += float(np.sum(misfit**2))
            scaled = np.abs(self._residual(number, now)) / self.rho[:, None] * self._mask(number)
            total += float(np.sum(np.where(scaled < HUBER, scaled**2, 2 * HUBER * scaled - HUBER**2)))
        return total

    def spread(self, now: Iterate) -> Array:
        """Return a robust standard deviation of every row's residual where it counts, (rows,)."""
        parts: list[list[Array]] = [[] for _ in self.rho]
        for number in range(len(self.pieces)):
            residual = self._residual(number, now)
            mask = self._mask(number)
            for r in range(len(self.rho)):
                parts[r].append(residual[r][mask[r] > 0.5])
        return np.array([1.4826 * float(np.median(np.abs(np.concatenate(p)))) if p else 0.0 for p in parts])

    def _misfit(self, piece: Piece, coefficients: Array) -> Array:
        windows = np.lib.stride_tricks.sliding_window_view(coefficients, _ORDER, axis=0)
        fitted = np.einsum("jcl,sl->cjs", windows, self._samples, optimize=True)
        misfit: Array = np.where(piece.weight > 0, piece.measured - fitted, 0.0) * piece.weight
        return misfit

    def _residual(self, number: int, now: Iterate) -> Array:
        piece = self.pieces[number]
        states = States(coefficients_to_states(self.setting, now.coefficients[number]), number, 0)
        residual: Array = self.equations.residual(states, now.p, now.z) - piece.torque.reshape(len(self.rho), -1)
        return residual

    def step(self, now: Iterate, prior: tuple[Array, Array], *, scores: bool = False) -> Step:
        """Return the Gauss-Newton step at `now`.

        Parameters
        ----------
        now
            The unknowns.
        prior
            (matrix, gradient) of what is known of (p, z) beforehand.
        scores
            Whether to compute the covariance of (p, z) as well.
        """
        from scipy.linalg import cho_solve_banded, cholesky_banded

        size = len(now.p) + len(now.z)
        corner, edge = prior[0].copy(), prior[1].copy()
        parts = []
        for number in range(len(self.pieces)):
            band, gradient, border, pp, gp = self._normal(number, now)
            factor = cholesky_banded(band, lower=True, check_finite=False)
            solved = cho_solve_banded((factor, True), np.column_stack([border, gradient]), check_finite=False)
            corner += pp - border.T @ solved[:, :size]
            edge += gp - border.T @ solved[:, size]
            parts.append(solved)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(corner), 1e-300))
        inverse = np.linalg.pinv(corner * scale[:, None] * scale[None], rcond=1e-13, hermitian=True)
        inverse = inverse * scale[:, None] * scale[None]
        move = -inverse @ edge
        trajectory = [
            -(solved[:, size] + solved[:, :size] @ move).reshape(now.coefficients[k].shape)
            for k, solved in enumerate(parts)
        ]
        covariance = inverse
        if scores:
            covariance = self._sandwich(now, [solved[:, :size] for solved in parts], inverse)
        return Step(move[: len(now.p)], move[len(now.p) :], trajectory, covariance)

    def _normal(self, number: int, now: Iterate) -> tuple[Array, Array, Array, Array, Array]:
        """Return (band, gradient, border, corner, corner's gradient) of one piece."""
        piece, coefficients = self.pieces[number], now.coefficients[number]
        knots, channels = coefficients.shape
        size = len(now.p) + len(now.z)
        blocks = np.zeros((_ORDER * channels, _ORDER * channels, piece.intervals))
        loads = np.zeros((_ORDER * channels, piece.intervals))
        border = np.zeros((knots * channels, size))
        corner, edge = np.zeros((size, size)), np.zeros(size)
        for part in self._parts(piece):
            G, P, r = self._linearised(number, now, part)
            blocks[:, :, part] = np.einsum("jab->abj", np.matmul(G.transpose(0, 2, 1), G))
            loads[:, part] = np.einsum("jra,jr->aj", G, r, optimize=True)
            cross = np.matmul(G.transpose(0, 2, 1), P).reshape(-1, _ORDER, channels, size)
            for k in range(_ORDER):
                place = (part.start + k) * channels
                border[place : place + cross.shape[0] * channels] += cross[:, k].reshape(-1, size)
            flat = P.reshape(-1, size)
            corner += flat.T @ flat
            edge += flat.T @ r.reshape(-1)
        misfit = self._misfit(piece, coefficients) * piece.weight
        inner = np.einsum("cjs,sl,sm->lmcj", piece.weight**2, self._samples, self._samples, optimize=True)
        pulls = np.einsum("cjs,sl->lcj", misfit, self._samples, optimize=True)
        index = np.arange(channels)
        for k in range(_ORDER):
            loads[k * channels + index] -= pulls[k]
            for m in range(_ORDER):
                blocks[k * channels + index, m * channels + index] += inner[k, m]
        return (*_banded(blocks, loads, knots, channels), border, corner, edge)

    def _parts(self, piece: Piece) -> list[slice]:
        size = max(1, _CHUNK // self.setting.points)
        return [slice(a, min(a + size, piece.intervals)) for a in range(0, piece.intervals, size)]

    def _linearised(self, number: int, now: Iterate, part: slice) -> tuple[Array, Array, Array]:
        """Return (d residual / d coefficients, d residual / d (p, z), residual), all weighted, interval by interval.

        Shapes (J, rows * points, 6 * channels), (J, rows * points, p + z), (J, rows * points).
        """
        setting, piece, rows = self.setting, self.pieces[number], len(self.rho)
        coefficients = now.coefficients[number][part.start : part.stop + DEGREE]
        count = part.stop - part.start
        values = coefficients_to_states(setting, coefficients)
        here = States(values, number, part.start * setting.points)
        channels = values.shape[1]
        residual = self.equations.residual(here, now.p, now.z)
        torque = piece.torque[:, part].reshape(rows, -1)
        mask = self._mask(number)[:, part.start * setting.points : part.stop * setting.points]
        error = residual - torque
        scaled = np.abs(error) * mask / self.rho[:, None]
        weight = mask / self.rho[:, None] * np.where(scaled > HUBER, np.sqrt(HUBER / np.maximum(scaled, 1e-300)), 1.0)
        slopes = self._slopes(here, now, residual)
        shaped = (slopes * weight[None, :, None]).reshape(3, rows, channels, count, setting.points)
        G = np.einsum("drcjp,dpl->jrplc", shaped, self._weights, optimize=True)
        columns = self.equations.columns(here, now.z)
        if len(now.z):
            columns = np.concatenate([columns, self._shape_slopes(here, now, residual)], axis=1)
        P = (columns * weight[:, None]).reshape(rows, -1, count, setting.points).transpose(2, 0, 3, 1)
        r = (error * weight).reshape(rows, count, setting.points).transpose(1, 0, 2)
        return (
            G.reshape(count, rows * setting.points, _ORDER * channels),
            P.reshape(count, rows * setting.points, -1),
            r.reshape(count, -1),
        )

    def _slopes(self, here: States, now: Iterate, residual: Array) -> Array:
        """Return d residual / d state by forward differences, (3, rows, channels, instants)."""
        channels, instants = here.values.shape[1:]
        slopes = np.zeros((3, len(self.rho), channels, instants))
        moved = here.values.copy()
        for d in range(3):
            for c in range(channels):
                step = _STEPS[d] * self.setting.scale[d, c]
                held = moved[d, c].copy()
                moved[d, c] += step
                slopes[d, :, c] = (self.equations.residual(replace(here, values=moved), now.p, now.z) - residual) / step
                moved[d, c] = held
        return slopes

    def _shape_slopes(self, here: States, now: Iterate, residual: Array) -> Array:
        slopes = np.zeros((len(self.rho), len(now.z), residual.shape[1]))
        for k in range(len(now.z)):
            moved = now.z.copy()
            moved[k] += 1e-4
            slopes[:, k] = (self.equations.residual(here, now.p, moved) - residual) / 1e-4
        return slopes

    def _sandwich(self, now: Iterate, solved: Sequence[Array], inverse: Array) -> Array:
        """Return the covariance of (p, z) from the long-run covariance of their scores, interval by interval."""
        from elid_cli.covariance import long_run

        parts, stretch = [], []
        for number, piece in enumerate(self.pieces):
            channels = now.coefficients[number].shape[1]
            influence = solved[number].reshape(-1, channels, solved[number].shape[1])
            windows = np.lib.stride_tricks.sliding_window_view(influence, _ORDER, axis=0)
            scores = np.zeros((piece.intervals, solved[number].shape[1]))
            for part in self._parts(piece):
                G, P, r = self._linearised(number, now, part)
                local = windows[part].transpose(0, 3, 1, 2).reshape(len(G), -1, P.shape[2])
                scores[part] += np.einsum("jra,jr->ja", P - np.matmul(G, local), r, optimize=True)
            misfit = self._misfit(piece, now.coefficients[number]) * piece.weight
            pulls = np.einsum("cjs,sl->jcl", misfit, self._samples, optimize=True)
            scores += np.einsum("jcl,jcal->ja", pulls, windows, optimize=True)
            parts.append(scores)
            stretch.append(np.full(piece.intervals, number))
        scale = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        scale[scale == 0] = 1.0
        whole = np.concatenate(parts) * scale
        half = inverse / scale[None]
        meat = long_run(whole, np.concatenate(stretch).astype(np.intp))
        covariance: Array = half @ meat @ half.T
        return covariance


@dataclass(frozen=True)
class Step:
    """A Gauss-Newton step and the covariance at its start."""

    p: Array
    z: Array
    coefficients: list[Array]
    covariance: Array


def _banded(blocks: Array, loads: Array, knots: int, channels: int) -> tuple[Array, Array]:
    """Add interval blocks (6 C, 6 C, J) into lower band storage (6 C, knots * C), and loads into a vector."""
    intervals = blocks.shape[2]
    band = np.zeros((_ORDER * channels, knots, channels))
    gradient = np.zeros((knots, channels))
    for k in range(_ORDER):
        for a in range(channels):
            row = k * channels + a
            gradient[k : k + intervals, a] += loads[row]
            for m in range(k + 1):
                for b in range(channels):
                    offset = (k - m) * channels + a - b
                    if offset >= 0:
                        band[offset, m : m + intervals, b] += blocks[row, m * channels + b]
    flat = band.reshape(_ORDER * channels, knots * channels)
    flat[0] += 1e-12 * flat[0].max()
    return flat, gradient.reshape(-1)


def iterate(
    problem: Problem, start: Iterate, prior: Callable[[Iterate], tuple[float, Array, Array]], steps: int
) -> Outcome:
    """Run Gauss-Newton with step halving.

    Parameters
    ----------
    problem
        The problem; its rho may grow once, where the rows' residual shows more than expected.
    start
        First unknowns.
    prior
        Returns (cost, matrix, gradient) of what is known of (p, z).
    steps
        Most steps.
    """
    now = start
    costs: list[float] = []
    for number in range(steps):
        problem.trust(now)
        if number == _GROW:
            problem.rho = np.maximum(problem.rho, problem.spread(now))
        before = problem.cost(now) + prior(now)[0]
        costs = costs or [before]
        _, matrix, gradient = prior(now)
        move = problem.step(now, (matrix, gradient))
        size = 1.0
        while True:
            trial = Iterate(
                [c + size * d for c, d in zip(now.coefficients, move.coefficients, strict=True)],
                now.p + size * move.p,
                now.z + size * np.clip(move.z, -0.5, 0.5),
            )
            cost = problem.cost(trial) + prior(trial)[0]
            if cost < before or size < 0.02:
                break
            size *= 0.5
        if not cost < before:
            break
        now = trial
        costs.append(cost)
        if number > _GROW and before - cost < max(1e-6 * cost, _SETTLED):
            break
    _, matrix, gradient = prior(now)
    last = problem.step(now, (matrix, gradient), scores=True)
    return Outcome(now.p, now.z, now.coefficients, last.covariance, tuple(costs), problem.rho, problem.spread(now))
