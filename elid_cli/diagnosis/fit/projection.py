"""The whitened least-squares problem of one step of the search, projected off what the present model spans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.gain import Gain, Judgement, Unit
from elid_cli.diagnosis.fit.whitening import JointWhitener, stack
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns, full_columns
from elid_cli.model.regressor import EstimationRow

LAGS = 50
"""Lags over which the remaining correlation of the scores is summed."""
AT_ONCE = 200_000
"""Values of columns that are whitened and projected at once."""
LEAST_SHARE = 0.02
"""Least share of equations that count as independent."""


@dataclass(frozen=True)
class Stretch:
    """Where the equations of one channel in one fold stand."""

    channel: int
    fold: int
    slice: slice


@dataclass(frozen=True)
class Projected:
    """Whitened residual and an orthonormal basis of what the model spans.

    Only equations that count are kept, stacked channel by channel and, within a channel, fold by fold.
    """

    whiteners: tuple[JointWhitener, ...]
    seen: tuple[NDArray[np.intp], ...]
    """Per joint: which instants of its channels are kept, fold by fold."""
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
        """Return whitened columns (d, k) in the channels of the joints that they act on, by number of the channel."""
        found: dict[int, Array] = {}
        number = 0
        for whitener, seen in zip(self.whiteners, self.seen, strict=True):
            series = stack(rows, whitener, self.instants)
            if series is not None:
                found |= {number + k: white[:, seen] for k, white in enumerate(whitener.apply(series))}
            number += len(whitener.rows)
        return found

    def gain(self, rows: Mapping[EstimationRow, Array]) -> Gain | None:
        """Score columns given as row -> (d, M); None where the model explains them already."""
        return self.gains([rows])[0]

    def gains(self, candidates: Sequence[Mapping[EstimationRow, Array]]) -> list[Gain | None]:
        """Score several candidates' columns, those that act in the same rows together (see `gain`)."""
        found: list[Gain | None] = [None] * len(candidates)
        alike: dict[tuple[frozenset[EstimationRow], int], list[int]] = {}
        for number, rows in enumerate(candidates):
            if rows:
                alike.setdefault((frozenset(rows), len(next(iter(rows.values())))), []).append(number)
        for (_, width), numbers in alike.items():
            each = max(1, AT_ONCE // (width * self.instants))
            for first in range(0, len(numbers), each):
                batch = numbers[first : first + each]
                for number, unit in zip(batch, self._units([candidates[k] for k in batch]), strict=True):
                    found[number] = None if unit is None else self._gain(unit)
        return found

    def _gain(self, unit: Unit) -> Gain:
        solved, rank = _least_squares(unit.grams.sum(axis=0), unit.loads.sum(axis=0))
        coefficients = np.zeros(len(unit.live))
        coefficients[unit.live] = solved / unit.size
        whole = 0.0
        for number, channel in enumerate(self.channels):
            power = self._powers[number]
            left = power + float(solved @ (unit.grams[number] @ solved - 2.0 * unit.loads[number]))
            if power > 0 and left > 0:
                whole += 0.5 * (channel.stop - channel.start) * float(np.log(power / left))
        return Gain(whole, coefficients, rank, self.count, (self, unit, solved))

    def prepared(self) -> Projected:
        """Return the same with everything computed that all candidates need."""
        _ = self._grams, self._powers
        return self

    def judged(self, units: Sequence[tuple[Unit, Array]]) -> list[Judgement]:
        """Return the judgement on each of some columns with their fitted coefficients (d,)."""
        found = []
        # the basis is far larger than the columns: it is read once for all of them
        everywhere = self._full([unit for unit, _ in units])
        for full, (_, solved) in zip(everywhere, units, strict=True):
            share = self._independent_share(full, self.residual - full @ solved)
            found.append(Judgement(share, *self._cross_validated(full, self.stretches)))
        return found

    @cached_property
    def independent(self) -> float:
        """Return the share of the equations that count as independent for the model's own columns."""
        return self._independent_share(self.basis, self.residual)

    @cached_property
    def _powers(self) -> list[float]:
        """Square of the residual in each channel."""
        return [float(self.residual[channel] @ self.residual[channel]) for channel in self.channels]

    def taken(self, rows: Mapping[EstimationRow, Array]) -> float:
        """Return the part of the squared residual that columns take, fold by fold predicted from the other folds.

        Counted are the joints that the rows belong to.
        """
        unit = self._units([rows])[0] if rows else None
        if unit is None:
            return 0.0
        places = self.touched(rows)
        own = [s for s in self.stretches if any(p.start <= s.slice.start < p.stop for p in places)]
        squares = sum(float(self.residual[s.slice] @ self.residual[s.slice]) for s in own)
        gains, _ = self._cross_validated(self._full([unit])[0], own)
        return max(float(gains.sum()), 0.0) / max(squares, 1e-300)

    def _units(self, candidates: Sequence[Mapping[EstimationRow, Array]]) -> list[Unit | None]:
        """Return each candidate's columns of length one that the model does not span; None where it spans them all.

        All candidates act in the same rows with the same number of columns d.
        """
        parts = self._whitened({row: np.concatenate([c[row] for c in candidates]) for row in candidates[0]})
        if not parts:
            return [None] * len(candidates)
        count, width = len(candidates), len(next(iter(candidates[0].values())))

        def apart(columns: Array) -> Array:
            return columns.reshape(count, width, -1)

        before = apart(np.sum([np.sum(part**2, axis=1) for part in parts.values()], axis=0))[:, :, 0]
        shared: Array = np.sum([part @ self.basis[self.channels[k]] for k, part in parts.items()], axis=0)
        grams = np.empty((count, len(self.channels), width, width))
        loads = np.empty((count, len(self.channels), width))
        for k, channel in enumerate(self.channels):
            if k in parts:
                parts[k] -= shared @ self.basis[channel].T
                one, other, load = apart(parts[k]), apart(parts[k]), apart(parts[k]) @ self.residual[channel]
            else:
                one, other, load = apart(shared @ self._grams[0][k]), apart(shared), -apart(shared) @ self._grams[1][k]
            grams[:, k], loads[:, k] = one @ other.transpose(0, 2, 1), load
        found: list[Unit | None] = []
        for k in range(count):
            size = np.sqrt(np.maximum(np.diag(grams[k].sum(axis=0)), 0.0))
            live = size > 1e-4 * np.sqrt(before[k])
            if not np.isfinite(before[k]).all() or not live.any():
                found.append(None)
                continue
            here, size = k * width + np.flatnonzero(live), size[live]
            own = {number: part[here] / size[:, None] for number, part in parts.items()}
            gram = grams[k][:, live][:, :, live] / np.outer(size, size)
            found.append(Unit(own, shared[here] / size[:, None], live, size, gram, loads[k][:, live] / size))
        return found

    def _full(self, units: Sequence[Unit]) -> list[Array]:
        """Return unit columns in all equations, (K, d) each."""
        shared = -self.basis @ np.concatenate([unit.shared for unit in units]).T
        edges = np.cumsum([0, *(len(unit.shared) for unit in units)])
        found = []
        for unit, first, last in zip(units, edges[:-1], edges[1:], strict=True):
            full = np.ascontiguousarray(shared[:, first:last])
            for number, part in unit.parts.items():
                full[self.channels[number]] = part.T
            found.append(full)
        return found

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
            part = scores[channel]
            total = np.zeros((len(part) + 2 * LAGS + 3, part.shape[1]))
            np.cumsum(part, axis=0, out=total[LAGS + 2 : len(part) + LAGS + 2])
            total[len(part) + LAGS + 2 :] = total[len(part) + LAGS + 1]
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
        white = whitener.apply(series)[:, :, instant].transpose(0, 2, 1).reshape(r * len(instant), -1)
        parts.append(white[:, :-1])
        targets.append(white[:, -1])
        kept.append(instant)
        places.append(slice(first, first + len(white)))
        edges = np.searchsorted(fold[instant], np.arange(folds + 1))
        for k in range(r):
            start = first + k * len(instant)
            stretches += [
                Stretch(channels + k, f, slice(start + int(edges[f]), start + int(edges[f + 1]))) for f in range(folds)
            ]
        first += len(white)
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
