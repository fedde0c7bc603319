"""Banded systems with a dense border; leverage.

Coefficients are ordered knot by knot, so that the normal matrix is banded (half-bandwidth 6 x channels) with a dense
border for p and z; a banded Cholesky factor and a Schur complement solve it in linear time.

Fitted residuals are smaller than the noise, and correlated by the fit over as long as its columns last: the kernel's
sum over the scores falls short of their long-run covariance by what it collects of that. Where the noise is white, or
remembers for less long than the columns last, the share that is left is known (Bell and McCaffrey 2002 for clusters).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.collocation.problem import Further, Iterate, Problem
from elid_cli.estimation.regression.long_run import NARROWEST, KernelSum
from elid_cli.lapack import lapack
from elid_cli.signals.splines import ORDER

LEAST_LEFT = 0.5
"""Smallest share of a long-run variance that is believed to be left."""
LASTING = 0.4
"""How much more of noise that remembers for long a fit takes out than of white noise. Measured: with a memory of 50 ms
(planar arm, 100 logs) errors were 1.05 of standard errors that did not know of it."""


def left(information: Array, inverse: Array, stretch: NDArray[np.intp], bandwidth: float, together: int = 1) -> Array:
    """Return the share of every estimate's long-run variance that the kernel's sum over fitted scores holds, (p,).

    Parameters
    ----------
    information
        What each instant adds to the normal matrix, (M, p, p): its scores' covariance J in white noise.
    inverse
        Inverse A of the normal matrix, (p, p). Scores of a fit have covariance J_t - J_t A J_t at an instant and
        -J_t A J_s between two.
    stretch
        Number of the stretch of every instant, (M,).
    bandwidth
        The kernel's, instants.
    together
        Instants that one matrix stands for.
    """
    size = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    size[size == 0] = 1.0
    unit = inverse / size[None]
    spread, turn = np.linalg.eigh(inverse / np.outer(size, size))
    half = size[:, None] * turn * np.sqrt(np.maximum(spread, 0.0))
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    shares = np.ones(len(inverse))
    for k in range(len(inverse)):
        moved = information @ unit[:, k]
        whole = float(np.sum(moved @ unit[:, k]))
        if not whole > 0:
            continue
        taken = KernelSum(len(inverse), (bandwidth + 1.0) / together - 1.0)
        series = np.ascontiguousarray((moved @ half).T)
        for number, (start, stop) in enumerate(zip(starts, [*starts[1:], len(stretch)], strict=True)):
            taken.feed(series[:, start:stop], number)
        shares[k] = 1.0 - float(np.trace(taken.total())) / whole
    lasting = 1.0 + LASTING * (1.0 - NARROWEST / max(bandwidth, NARROWEST))
    return np.clip(1.0 - lasting * (1.0 - shares), LEAST_LEFT, 1.0)


_DAMPED, _HALVINGS = (-14.0, 6.0), 9
"""Range of the damping of the shapes, powers of ten of their own curvature, and how often it is halved."""
_SENSED = 1.15
"""How much smaller a variance is than the sensors' noise as it is estimated makes it. Measured on 200 logs of a planar
arm (90 dB, 1 % of white torque noise): errors of 0.92 to 1.10 standard errors rms; 0.87 to 1.06 with 1."""
_TAKEN = 0.3
"""Largest part of the long-run variance of two answers' difference that the parameters are taken to explain."""
_HELD = 2**27
"""Bytes of what the instants add to the normal matrix, from which on neighbours count as one."""


@dataclass(frozen=True)
class NormalEquations:
    """A piece's normal equations; coefficients are ordered knot by knot, the channels of a knot side by side."""

    band: Array
    """Lower band of the coefficients' matrix: of each, what it shares with those that follow, (knots * C, 6 C)."""
    border: Array
    """Columns of p, z and further terms, and last the gradient, (knots * C, size + 1)."""
    corner: Array
    """The matrix of p, z and further terms, and last their gradient, (size + 1, size + 1)."""


def normal_equations(
    problem: Problem, number: int, now: Iterate, size: int, further: Further | None
) -> NormalEquations:
    """Return the normal equations of piece `number` with `size` columns of p, z and further terms; 0: they are held."""
    piece, coefficients = problem.pieces[number], now.coefficients[number]
    knots, channels = coefficients.shape
    width = ORDER * channels
    band, border = np.zeros((knots, channels, width)), np.zeros((knots, channels, size + 1))
    band[:, :, ::channels] = piece.information
    corner = np.zeros((size + 1, size + 1))
    for part in problem.parts(piece):
        slopes, columns = problem.linearised(number, now, part, further, held=not size)
        turned = slopes.transpose(0, 2, 1)
        inner, across = np.matmul(turned, slopes), np.matmul(turned, columns)
        for k in range(width):
            later, channel = divmod(k, channels)
            band[part.start + later : part.stop + later, channel, : width - k] += inner[:, k, k:]
        for k in range(ORDER):
            border[part.start + k : part.stop + k] += across[:, k * channels : (k + 1) * channels]
        flat = columns.reshape(-1, size + 1)
        corner += flat.T @ flat
    pulls = (problem.misfit(piece, coefficients) * piece.weight) @ problem.samples
    for k in range(ORDER):
        border[k : k + piece.intervals, :, size] -= pulls[:, :, k].T
    band[:, :, 0] += 1e-12 * band[:, :, 0].max()
    return NormalEquations(band.reshape(-1, width), border.reshape(-1, size + 1), corner)


@dataclass(frozen=True)
class EliminatedTrajectory:
    """The quadratic that is left of the cost when the trajectory is eliminated: c + 2 g'x + x'Q x, x about `now`."""

    matrix: Array
    """Q, (p + z + further, p + z + further)."""
    gradient: Array
    """g, (p + z + further,)."""
    factors: list[Array]
    """Per piece: lower band of the Cholesky factor L of the coefficients' matrix."""
    forward: list[Array]
    """Per piece: L^-1 of the border, and of the gradient (last column)."""

    @property
    def solved(self) -> list[Array]:
        """Per piece: what moves of x, and the gradient (last column), move the coefficients by, negated."""
        return [self._back(number, series) for number, series in enumerate(self.forward)]

    def _back(self, number: int, series: Array) -> Array:
        """Return L^-T of series of a piece, (knots * C, columns)."""
        return np.asarray(lapack().dtbtrs(self.factors[number], series, uplo="L", trans="T")[0])

    def move(self, now: Iterate, longest: float) -> Iterate:
        """Return the move to the least of the quadratic with no shape z moved by more than `longest`.

        What holds the shapes back is a damping of them alone (Levenberg, Marquardt): the rest follows them.
        """
        first, size = len(now.p), len(self.gradient)
        if not size:  # p and z are held
            return Iterate(self._trajectory(now, self.gradient), np.zeros_like(now.p), np.zeros_like(now.z))
        x: Array = -_inverse(self.matrix) @ self.gradient
        if size > first and np.max(np.abs(x[first:])) > longest:
            shapes = np.diag((np.arange(size) >= first) * float(np.median(np.diag(self.matrix)[first:])))
            low, high = _DAMPED
            for _ in range(_HALVINGS):  # as little damping as does: along a flat valley a little more is far too much
                middle = 0.5 * (low + high)
                x = -_inverse(self.matrix + 10.0**middle * shapes) @ self.gradient
                low, high = (middle, high) if np.max(np.abs(x[first:])) > longest else (low, middle)
            x[first:] = np.clip(x[first:], -longest, longest)
        return Iterate(self._trajectory(now, x), x[:first], x[first:])

    def _trajectory(self, now: Iterate, x: Array) -> list[Array]:
        """Return the move of the coefficients that goes with a move of x."""
        moves = [-self._back(k, series[:, :-1] @ x + series[:, -1]) for k, series in enumerate(self.forward)]
        return [move.reshape(own.shape) for move, own in zip(moves, now.coefficients, strict=True)]


def eliminate_trajectory(
    problem: Problem, now: Iterate, prior: tuple[Array, Array], further: Further | None = None
) -> EliminatedTrajectory:
    """Eliminate the trajectory.

    Parameters
    ----------
    problem, now
        The problem and where it is linearised.
    prior
        (matrix, gradient) of what is known of (p, z) beforehand, with zeros for further columns; empty where p and z
        are held.
    further
        Columns of terms that are not in the model.
    """
    matrix, gradient = prior[0].copy(), prior[1].copy()
    factors, forward = [], []
    for number in range(len(problem.pieces)):
        piece = normal_equations(problem, number, now, len(gradient), further)
        factor, failed = lapack().dpbtrf(piece.band.T, lower=1, overwrite_ab=1)
        if failed:
            raise np.linalg.LinAlgError("the trajectory's normal matrix is not positive definite")
        series = lapack().dtbtrs(factor, piece.border, uplo="L")[0]
        left = piece.corner - series.T @ series
        matrix += left[:-1, :-1]
        gradient += left[:-1, -1]
        factors.append(factor)
        forward.append(series)
    return EliminatedTrajectory(matrix, gradient, factors, forward)


def covariance_at(problem: Problem, now: Iterate, prior: tuple[Array, Array]) -> tuple[Array, list[Array]]:
    """Return the covariance of (p, z) that the residuals' autocorrelation-aware scores show at `now`, and influences.

    Influences are what each interval of knots moves (p, z) by, an array (intervals, p + z) per piece.

    Where the sensors' noise alone makes a variance larger than they do, by more than noise that is assumed is not all
    there, that counts: a trajectory that is as free as this one takes a part of the noise out of the residuals, a
    quarter of the standard errors of what lies in the links' rows. What is known beforehand is as it is assumed.
    """
    system = eliminate_trajectory(problem, now, prior)
    size = len(system.gradient)
    inverse = _inverse(system.matrix)
    shown, influence, white = _sandwich(problem, now, [solved[:, :size] for solved in system.solved], inverse)
    known = inverse @ prior[0] @ inverse
    shown += known
    assumed = inverse @ white @ inverse + known
    ratio = np.diag(assumed) / np.maximum(np.diag(shown), 1e-300)
    wider = np.where(np.isfinite(ratio) & (np.diag(shown) > 0), np.maximum(ratio / _SENSED, 1.0), 1.0) ** 0.5
    return np.asarray(shown * wider[:, None] * wider[None]), influence


def variance_apart(fine: Sequence[Array], coarse: Sequence[Array], rows: int) -> Array:
    """Return the variance by which noise alone takes two answers to one log apart, (p + z,).

    Influences of either on every piece; those with finer knots have a whole number of intervals to each of the others'.
    `rows` are those that torque noise enters.
    """
    from elid_cli.estimation.regression.covariance import long_run

    apart = [a.reshape(len(b), -1, b.shape[1]).sum(axis=1) - b for a, b in zip(fine, coarse, strict=True)]
    stretch = np.repeat(np.arange(len(apart)), [len(part) for part in apart])
    whole = np.concatenate(apart)
    scale = np.maximum(np.sqrt(np.mean(whole**2, axis=0)), 1e-300)
    return np.asarray(np.diag(long_run(whole / scale, stretch, rows, _TAKEN)) * scale**2)


def driven(problem: Problem) -> int:
    """Return the number of row groups that a torque drives: what noise of the torques enters."""
    return sum(any(np.any(piece.torque[k]) for piece in problem.pieces) for k in range(len(problem.rho)))


def _inverse(matrix: Array) -> Array:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = np.linalg.pinv(matrix * scale[:, None] * scale[None], rcond=1e-13, hermitian=True)
    return np.asarray(scaled * scale[:, None] * scale[None])


def _sandwich(
    problem: Problem, now: Iterate, solved: Sequence[Array], inverse: Array
) -> tuple[Array, list[Array], Array]:
    """Return the covariance of (p, z) from the long-run covariance of their scores, interval by interval.

    With it what every interval moves them by, per piece, and the scores' covariance if all noise is the sensors'.
    """
    from elid_cli.estimation.regression.covariance import bandwidth_of, summed
    from elid_cli.estimation.regression.long_run import uncertain

    parts, stretch, information, blocks = [], [], [], []
    intervals = sum(piece.intervals for piece in problem.pieces)
    together = 1 + 4 * intervals * inverse.size // _HELD
    white = np.zeros_like(inverse)
    sensed = np.tile(problem.followed, problem.setting.points)[:, None]
    for number, piece in enumerate(problem.pieces):
        channels = now.coefficients[number].shape[1]
        influence = solved[number].reshape(-1, channels, solved[number].shape[1])
        windows = np.lib.stride_tricks.sliding_window_view(influence, ORDER, axis=0)
        scores = np.zeros((piece.intervals, solved[number].shape[1]))
        held = np.zeros((-(-piece.intervals // together), *inverse.shape), dtype=np.float32)
        for part in problem.parts(piece):
            slopes, columns = problem.linearised(number, now, part)
            local = windows[part].transpose(0, 3, 1, 2).reshape(len(slopes), slopes.shape[2], -1)
            own = columns[:, :, :-1] - np.matmul(slopes, local)
            scores[part] += np.einsum("jra,jr->ja", own, columns[:, :, -1], optimize=True)
            _add(held, part, np.matmul(own.transpose(0, 2, 1), own), together)
            flat = (own * sensed).reshape(-1, own.shape[2])
            white += flat.T @ flat
        misfit = problem.misfit(piece, now.coefficients[number]) * piece.weight
        pulls = np.einsum("cjs,sl->jcl", misfit, problem.samples, optimize=True)
        scores += np.einsum("jcl,jcal->ja", pulls, windows, optimize=True)
        for c in range(channels):
            for part in problem.parts(piece):
                seen = np.matmul(windows[part, c], problem.samples.T) * piece.weight[c][part, None, :]
                _add(held, part, np.matmul(seen, seen.transpose(0, 2, 1)), together)
                white += np.einsum("jas,jbs->ab", seen, seen, optimize=True)
        parts.append(scores)
        information.append(held)
        blocks.append(np.full(len(held), number))
        stretch.append(np.full(piece.intervals, number))
    scale = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    scale[scale == 0] = 1.0
    whole = np.concatenate(parts) * scale
    half = inverse / scale[None]
    places, bandwidth = np.concatenate(stretch).astype(np.intp), bandwidth_of(whole)
    meat = summed(np.ascontiguousarray(whole.T), places, bandwidth) * uncertain(len(whole), bandwidth)
    share = left(np.concatenate(information), inverse, np.concatenate(blocks), bandwidth, together)
    wider = 1.0 / np.sqrt(share)
    covariance: Array = half @ meat @ half.T * wider[:, None] * wider[None]
    return covariance, [scores @ inverse for scores in parts], white


def _add(held: Array, part: slice, found: Array, together: int) -> None:
    """Add the matrices of a part's intervals (m, p, p), `together` of them to one."""
    block = np.arange(part.start, part.start + len(found)) // together
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    held[block[starts]] += np.add.reduceat(found, starts, axis=0)
