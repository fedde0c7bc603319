"""The whitened least-squares problem of one step of the search, projected off what the present model spans."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.whitening import JointWhitener, stack
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns, full_columns
from elid_cli.model.regressor import EstimationRow

LAGS = 50
"""Lags over which the remaining correlation of the scores is summed."""
LEAST_SHARE = 0.02
"""Least share of equations that count as independent."""


@dataclass(frozen=True)
class Gain:
    """What adding columns would gain; what only the better candidates are asked for is computed when asked."""

    whole: float
    """Gain in log-likelihood with every instant counted: what candidates for one residual are compared by."""
    coefficients: Array
    """Fitted coefficients of the columns, (d,)."""
    width: int
    """Columns that were not already explained."""
    count: int
    """Whitened equations."""
    judged: Callable[[], tuple[float, Array, Array]] = field(repr=False)
    """Computes share, folds and energy."""

    @cached_property
    def _judgement(self) -> tuple[float, Array, Array]:
        return self.judged()

    def settled(self) -> Gain:
        """Return the same with everything computed, so that the columns need not be kept."""
        known = self._judgement
        return replace(self, judged=lambda: known)

    @property
    def share(self) -> float:
        """Share of the equations that counts as independent."""
        return self._judgement[0]

    @property
    def likelihood(self) -> float:
        """Gain in log-likelihood, only instants counted that what is left over leaves independent."""
        return self.whole * self.share

    @property
    def folds(self) -> Array:
        """Reduction of the squared whitened residual per fold, predicted from the other folds, (folds,)."""
        return self._judgement[1]

    @property
    def energy(self) -> Array:
        """Share of the columns' squares per fold, (folds,): where the effect acts at all."""
        return self._judgement[2]

    @property
    def acting(self) -> NDArray[np.bool_]:
        """Folds in which the effect acts, (folds,)."""
        return self.energy > 0.01


@dataclass(frozen=True)
class Stretch:
    """Where the equations of one channel in one fold stand."""

    channel: int
    fold: int
    slice: slice


@dataclass(frozen=True)
class _Unit:
    """Columns of length one that the model does not span."""

    parts: Mapping[int, Array]
    """What they are in the channels that they act on, (k, d) by number of the channel …"""
    aside: list[int]
    """… and the other channels, …"""
    shared: Array
    """… where they are the basis times the negative of this, (r, d)."""
    gram: Array
    """Their Gram matrix, (d, d)."""
    live: NDArray[np.bool_]
    """Which of all columns they are."""
    size: Array
    """Their sizes before they were scaled, (d,)."""


@dataclass(frozen=True)
class Projected:
    """Whitened residual and an orthonormal basis of what the model spans.

    Only equations that count are kept, stacked channel by channel and, within a channel, fold by fold.
    """

    whiteners: tuple[JointWhitener, ...]
    seen: tuple[NDArray[np.intp], ...]
    """Per joint: which instants of its channels, one after the other, are kept."""
    places: tuple[slice, ...]
    """Per joint: where they stand in the stack."""
    basis: Array
    """(K, r)"""
    residual: Array
    """(K,)"""
    stretches: tuple[Stretch, ...]
    folds: int
    instants: int

    @property
    def count(self) -> int:
        """Number of whitened equations that count, K."""
        return len(self.residual)

    @cached_property
    def channels(self) -> list[slice]:
        """Return where each channel stands in the stack."""
        found: dict[int, slice] = {}
        for item in self.stretches:
            first = found[item.channel].start if item.channel in found else item.slice.start
            found[item.channel] = slice(first, item.slice.stop)
        return list(found.values())

    @cached_property
    def _grams(self) -> tuple[Array, Array]:
        """Gram matrix of the basis in each channel and its product with the residual, (channels, r, r) and (…, r).

        With them the basis is not read where columns do not act: what they leave there is the basis's own.
        """
        parts = [(self.basis[channel], self.residual[channel]) for channel in self.channels]
        return np.array([b.T @ b for b, _ in parts]), np.array([b.T @ r for b, r in parts])

    def _whitened(self, rows: Mapping[EstimationRow, Array]) -> dict[int, Array]:
        """Return whitened columns (k, d) in the channels of the joints that they act on, by number of the channel."""
        found: dict[int, Array] = {}
        for whitener, seen, place in zip(self.whiteners, self.seen, self.places, strict=True):
            series = stack(rows, whitener, self.instants)
            if series is None:
                continue
            columns = whitener.apply(series).transpose(0, 2, 1).reshape(-1, series.shape[1])[seen]
            for number, channel in enumerate(self.channels):
                if place.start <= channel.start < place.stop:
                    found[number] = columns[channel.start - place.start : channel.stop - place.start]
        return found

    def gain(self, rows: Mapping[EstimationRow, Array]) -> Gain | None:
        """Score columns given as row -> (d, M); None where the model explains them already."""
        unit = self._unit(rows)
        if unit is None:
            return None
        grams, loads = self._grams
        gram, load = unit.gram, -unit.shared.T @ loads[unit.aside].sum(axis=0)
        for number, part in unit.parts.items():
            load += part.T @ self.residual[self.channels[number]]
        solved, rank = _least_squares(gram, load)
        coefficients = np.zeros(len(unit.live))
        coefficients[unit.live] = solved / unit.size
        back = unit.shared @ solved
        whole = 0.0
        for number, channel in enumerate(self.channels):
            old = self.residual[channel]
            power = float(old @ old)
            if number in unit.parts:
                new = old - unit.parts[number] @ solved
                left = float(new @ new)
            else:
                left = power + float(back @ (2.0 * loads[number] + grams[number] @ back))
            if power > 0 and left > 0:
                whole += 0.5 * len(old) * float(np.log(power / left))

        def judged() -> tuple[float, Array, Array]:
            full = self._full(unit)
            share = self._independent_share(full, self.residual - full @ solved)
            return share, *self._cross_validated(full, self.stretches)

        return Gain(whole, coefficients, rank, self.count, judged)

    def taken(self, rows: Mapping[EstimationRow, Array]) -> float:
        """Return the part of the squared residual that columns take, fold by fold predicted from the other folds.

        Counted are the joints that the rows belong to.
        """
        unit = self._unit(rows)
        if unit is None:
            return 0.0
        places = self.touched(rows)
        own = [s for s in self.stretches if any(p.start <= s.slice.start < p.stop for p in places)]
        squares = sum(float(self.residual[s.slice] @ self.residual[s.slice]) for s in own)
        gains, _ = self._cross_validated(self._full(unit), own)
        return max(float(gains.sum()), 0.0) / max(squares, 1e-300)

    def _unit(self, rows: Mapping[EstimationRow, Array]) -> _Unit | None:
        """Return columns of length one that the model does not span; None where it spans them all."""
        columns = self._whitened(rows)
        if not columns:
            return None
        aside = [k for k in range(len(self.channels)) if k not in columns]
        before = np.sum([np.sum(part**2, axis=0) for part in columns.values()], axis=0)
        if not np.isfinite(before).all() or not np.any(before):
            return None
        shared = np.sum([self.basis[self.channels[k]].T @ part for k, part in columns.items()], axis=0)
        gram = shared.T @ self._grams[0][aside].sum(axis=0) @ shared
        for number, part in columns.items():
            part -= self.basis[self.channels[number]] @ shared
            gram += part.T @ part
        size = np.sqrt(np.maximum(np.diag(gram), 0.0))
        live = size > 1e-4 * np.sqrt(before)
        if not live.any():
            return None
        size = size[live]
        parts = {number: part[:, live] / size for number, part in columns.items()}
        return _Unit(parts, aside, shared[:, live] / size, gram[np.ix_(live, live)] / np.outer(size, size), live, size)

    def _full(self, unit: _Unit) -> Array:
        """Return unit columns in all equations, (K, d)."""
        full: Array = -self.basis @ unit.shared
        for number, part in unit.parts.items():
            full[self.channels[number]] = part
        return full

    def touched(self, rows: Mapping[EstimationRow, Array]) -> list[slice]:
        """Return the places of the joints that some rows belong to."""
        joints = zip(self.whiteners, self.places, strict=True)
        return [place for whitener, place in joints if any(row in rows for row in whitener.rows)]

    def _independent_share(self, unit: Array, rest: Array) -> float:
        """Return the share of equations that count as independent for orthonormal columns (K, d).

        It is the ratio of what the scores unit * rest would scatter, were they independent, to what they scatter with
        their neighbours: noise whose colour the sensors do not explain counts only as far as it lies in the columns'
        own band. Taken from the residual after the columns: the right ones leave noise and keep their weight.
        """
        scores = unit * rest[:, None]
        alone, together = float(np.sum(scores**2)), 0.0
        for channel in self.channels:
            # Bartlett's weights are what sums over moving windows make of a series
            total = np.cumsum(np.pad(scores[channel], ((LAGS + 2, LAGS + 1), (0, 0))), axis=0)
            together += float(np.sum((total[LAGS + 1 :] - total[: -LAGS - 1]) ** 2)) / (LAGS + 1)
        return float(np.clip(alone / together, LEAST_SHARE, 1.0)) if together > 0 else 1.0

    def _cross_validated(self, unit: Array, counted: Sequence[Stretch]) -> tuple[Array, Array]:
        """Return the fall of the squared residual on the stretches counted, and the columns' power, both per fold."""
        width = unit.shape[1]
        gram, load = np.zeros((self.folds, width, width)), np.zeros((self.folds, width))
        own_gram, own_load = (gram, load) if counted is self.stretches else (gram.copy(), load.copy())
        for item in self.stretches:
            part = unit[item.slice]
            gram[item.fold] += part.T @ part
            load[item.fold] += part.T @ self.residual[item.slice]
        for item in counted if own_gram is not gram else ():
            part = unit[item.slice]
            own_gram[item.fold] += part.T @ part
            own_load[item.fold] += part.T @ self.residual[item.slice]
        gains = np.zeros(self.folds)
        for f in range(self.folds):
            left, _ = _least_squares(gram.sum(axis=0) - gram[f], load.sum(axis=0) - load[f])
            gains[f] = 2 * left @ own_load[f] - left @ own_gram[f] @ left
        power = np.trace(gram, axis1=1, axis2=2)
        return gains, power / max(float(power.sum()), 1e-300)


def _least_squares(gram: Array, load: Array) -> tuple[Array, int]:
    """Solve normal equations of a few unit columns, leaving out directions they hardly span."""
    values, vectors = np.linalg.eigh(gram)
    live = values > 1e-10 * max(float(values[-1]), 1e-300)
    solution: Array = vectors[:, live] @ ((vectors[:, live].T @ load) / values[live])
    return solution, int(live.sum())


def project(
    observation: Observation,
    extras: Sequence[ExtraColumns],
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
    parts, targets, places, kept, adapted = [], [], [], [], []
    stretches: list[Stretch] = []
    first = 0
    channels = 0
    for whitener in joints:
        r = len(whitener.rows)
        seen = whitener.use & (fold >= 0)
        series = np.array([columns_of[row] for row in whitener.rows])
        whitener = whitener.mixed_by(series[:, -1:], seen)
        adapted.append(whitener)
        instant = np.flatnonzero(seen)
        instant = instant[np.argsort(fold[instant], kind="stable")]
        index = np.concatenate([instant + k * instants for k in range(r)])
        white = whitener.apply(series).transpose(0, 2, 1).reshape(r * instants, -1)[index]
        parts.append(white[:, :-1])
        targets.append(white[:, -1])
        kept.append(index)
        places.append(slice(first, first + len(index)))
        edges = np.searchsorted(fold[instant], np.arange(folds + 1))
        for k in range(r):
            start = first + k * len(instant)
            stretches += [
                Stretch(channels + k, f, slice(start + int(edges[f]), start + int(edges[f + 1]))) for f in range(folds)
            ]
        first += len(index)
        channels += r
    columns, target = np.concatenate(parts), np.concatenate(targets)
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0] / norms[norms > 0]
    basis, triangle = np.linalg.qr(columns)
    basis = basis[:, np.abs(np.diag(triangle)) > 1e-9]
    target = target - basis @ (basis.T @ target)
    return Projected(tuple(adapted), tuple(kept), tuple(places), basis, target, tuple(stretches), folds, instants)


def _dense(row: EstimationRow, observation: Observation, extras: Sequence[ExtraColumns], solution: Solution) -> Array:
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
