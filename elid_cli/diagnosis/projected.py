"""The whitened least-squares problem of one step of the search, projected off what the present model spans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.whitening import JointWhitener, stack
from elid_cli.model import Row
from elid_cli.observation import Observation
from elid_cli.reduction import Extra, full_columns
from elid_cli.solve import Solution

Array = NDArray[np.float64]

_LAGS = 25
"""Lags over which the whitened residual's remaining correlation is summed."""


@dataclass(frozen=True)
class Gain:
    """What adding columns would gain."""

    likelihood: float
    """Gain in log-likelihood."""
    coefficients: Array
    """Fitted coefficients of the columns, (d,)."""
    width: int
    """Columns that were not already explained."""
    folds: Array
    """Reduction of the squared whitened residual per fold, predicted from the other folds, (folds,)."""
    energy: Array
    """Share of the columns' squares per fold, (folds,): where the effect acts at all."""
    count: int

    @property
    def acting(self) -> NDArray[np.bool_]:
        """Folds in which the effect acts, (folds,)."""
        return self.energy > 0.01


@dataclass(frozen=True)
class Projected:
    """Whitened residual and an orthonormal basis of what the model spans, channels one after the other."""

    whiteners: tuple[JointWhitener, ...]
    places: tuple[slice, ...]
    """Where each joint's channels lie in the stacked vector."""
    basis: Array
    """(total, r)"""
    residual: Array
    """(total,)"""
    channel: NDArray[np.intp]
    """Channel of each stacked instant."""
    fold: NDArray[np.intp]
    """Fold of each stacked instant; -1 where it does not count."""
    folds: int
    instants: int

    @property
    def count(self) -> int:
        """Number of whitened equations that count."""
        return int(np.count_nonzero(self.fold >= 0))

    def whiten(self, rows: Mapping[Row, Array]) -> tuple[Array, list[int]] | None:
        """Return whitened, scaled columns (total, d) and the joints they touch, or None where they are all masked."""
        if not rows:
            return None
        width = next(iter(rows.values())).shape[0]
        result = np.zeros((len(self.residual), width))
        touched = []
        for number, (whitener, place) in enumerate(zip(self.whiteners, self.places, strict=True)):
            series = stack(rows, whitener, self.instants)
            if series is None:
                continue
            white = whitener.apply(series)
            seen = (self.fold[place] >= 0)[:, None]
            result[place] = white.transpose(0, 2, 1).reshape(-1, width) * seen
            touched.append(number)
        if not touched:
            return None
        return result, touched

    def gain(self, rows: Mapping[Row, Array]) -> Gain | None:
        """Score columns given as row -> (d, M); None where the model explains them already."""
        white = self.whiten(rows)
        if white is None:
            return None
        columns, _ = white
        before = np.linalg.norm(columns, axis=0)
        if not np.isfinite(before).all() or not (before > 0).any():
            return None
        columns = columns - self.basis @ (self.basis.T @ columns)
        after = np.linalg.norm(columns, axis=0)
        live = after > 1e-4 * before
        if not live.any():
            return None
        unit = columns[:, live] / after[live]
        coefficients = np.zeros(len(before))
        solved, _, rank, _ = np.linalg.lstsq(unit, self.residual, rcond=1e-6)
        coefficients[live] = solved / after[live]
        rest = self.residual - unit @ solved
        likelihood = 0.0
        for number in np.unique(self.channel):
            here = (self.channel == number) & (self.fold >= 0)
            old, new = float(np.sum(self.residual[here] ** 2)), float(np.sum(rest[here] ** 2))
            n = int(np.count_nonzero(here))
            if n and old > 0 and new > 0:
                likelihood += 0.5 * n * np.log(old / new) * independent_share(rest, here)
        folds, energy = self._cross_validated(unit)
        return Gain(likelihood, coefficients, int(rank), folds, energy, self.count)

    def _cross_validated(self, unit: Array) -> tuple[Array, Array]:
        gram = np.array([unit[self.fold == f].T @ unit[self.fold == f] for f in range(self.folds)])
        load = np.array([unit[self.fold == f].T @ self.residual[self.fold == f] for f in range(self.folds)])
        gains = np.zeros(self.folds)
        for f in range(self.folds):
            left = np.linalg.lstsq(gram.sum(axis=0) - gram[f], load.sum(axis=0) - load[f], rcond=1e-9)[0]
            gains[f] = 2 * left @ load[f] - left @ gram[f] @ left
        power = np.trace(gram, axis1=1, axis2=2)
        return gains, power / max(float(power.sum()), 1e-300)


def independent_share(rest: Array, here: NDArray[np.bool_]) -> float:
    """Return the share of a channel's instants that count as independent, from the correlation that is left.

    Taken from the residual *after* the candidate: the right candidate leaves white noise and keeps its full weight,
    while noise of a colour that the sensors do not explain deflates every candidate alike.
    """
    series = rest[here]
    n = len(series)
    if n < 4 * _LAGS:
        return 1.0
    spectrum = np.abs(np.fft.rfft(series, 2 * n)) ** 2
    covariance = np.fft.irfft(spectrum)[: _LAGS + 1]
    if covariance[0] <= 0:
        return 1.0
    rho = covariance[1:] / covariance[0]
    negative = np.flatnonzero(rho < 2.0 / np.sqrt(n))
    last = int(negative[0]) if len(negative) else _LAGS
    return float(1.0 / (1.0 + 2.0 * np.sum(rho[:last])))


def project(
    observation: Observation,
    extras: Sequence[Extra],
    solution: Solution,
    joints: tuple[JointWhitener, ...],
    fold: NDArray[np.intp],
    folds: int,
) -> Projected:
    """Whiten the present model's equations and project the residual.

    Parameters
    ----------
    observation, extras, solution
        The present model and its fit.
    joints
        Whiteners of the joints.
    fold
        Fold of each instant, (M,); -1 for instants that the search must not see.
    folds
        Number of folds.
    """
    instants = observation.instants
    columns_of = {
        group.row: _dense(group.row, observation, extras, solution) for group in observation.groups if group.count
    }
    parts, targets, places, channels, labels = [], [], [], [], []
    first = 0
    adapted = []
    for number, whitener in enumerate(joints):
        r = len(whitener.rows)
        seen = whitener.use & (fold >= 0)
        series = np.array([columns_of[row] for row in whitener.rows])
        whitener = whitener.mixed_by(series[:, -1:], seen)
        adapted.append(whitener)
        mask = np.tile(seen, r)
        white = whitener.apply(series).transpose(0, 2, 1).reshape(r * instants, -1) * mask[:, None]
        parts.append(white[:, :-1])
        targets.append(white[:, -1])
        places.append(slice(first, first + r * instants))
        first += r * instants
        channels.append(np.repeat(np.arange(r), instants) + 2 * number)
        labels.append(np.where(mask, np.tile(fold, r), -1))
    columns, target = np.concatenate(parts), np.concatenate(targets)
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0] / norms[norms > 0]
    basis, triangle = np.linalg.qr(columns)
    kept = np.abs(np.diag(triangle)) > 1e-9
    basis = basis[:, kept]
    target = target - basis @ (basis.T @ target)
    return Projected(
        tuple(adapted),
        tuple(places),
        basis,
        target,
        np.concatenate(channels),
        np.concatenate(labels),
        folds,
        instants,
    )


def _dense(row: Row, observation: Observation, extras: Sequence[Extra], solution: Solution) -> Array:
    """Return the basis columns and, last, the residual of a row group, (r + 1, M)."""
    group = observation.group(row)
    index, columns = full_columns(group, extras, observation.parameters)
    place = {int(column): k for k, column in enumerate(solution.basis)}
    dense = np.zeros((len(solution.basis) + 1, observation.instants))
    for k, column in enumerate(index):
        if int(column) in place:
            dense[place[int(column)]] = columns[k]
    dense[-1] = group.target - solution.values[index] @ columns
    return dense
