"""The whitened least-squares problem of one step of the search, projected off what the present model spans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.gain import Gain, Judgement, Unit
from elid_cli.diagnosis.fit.whitening import JointWhitener, stack
from elid_cli.model.regressor import EstimationRow

LAGS = 50
"""Lags over which the remaining correlation of the scores is summed."""
AT_ONCE = 50_000
"""Values of columns that are whitened and projected at once."""
SPANNED, WEAK = 1e-4, 1e-2
"""Part of a column that the model does not span up to which it counts as spanned, and below which it is projected."""
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
                for number, gain in zip(batch, self._gains([candidates[k] for k in batch]), strict=True):
                    found[number] = gain
        return found

    def _gains(self, candidates: Sequence[Mapping[EstimationRow, Array]]) -> list[Gain | None]:
        """Score candidates whose columns act in the same rows, with the same number of columns d."""
        products = self._products(candidates)
        if products is None:
            return [None] * len(candidates)
        solved, rank = _least_squares(products.grams.sum(axis=1), products.loads.sum(axis=1))
        grown = np.einsum("ncde,ne->ncd", products.grams, solved) - 2.0 * products.loads
        left = self._powers + np.einsum("ncd,nd->nc", grown, solved)
        sizes = np.array([channel.stop - channel.start for channel in self.channels])
        shown = (self._powers > 0) & (left > 0)
        falls = np.log(np.where(shown, self._powers, 1.0) / np.where(shown, left, 1.0))
        whole = 0.5 * falls @ sizes
        coefficients = solved / products.size
        return [
            Gain(float(whole[k]), coefficients[k], int(rank[k]), self.count, (self, rows)) if rank[k] else None
            for k, rows in enumerate(candidates)
        ]

    def prepared(self) -> Projected:
        """Return the same with everything computed that all candidates need."""
        _ = self._grams, self._powers
        return self

    def judged(self, candidates: Sequence[Mapping[EstimationRow, Array]]) -> list[Judgement]:
        """Return the judgement on each candidate's columns, of which the model does not span all."""
        units = [unit for rows in candidates for unit in [self._unit(rows)] if unit is not None]
        found = []
        # the basis is far larger than the columns: it is read once for all of them
        for full, unit in zip(self._full(units), units, strict=True):
            share = self._independent_share(full, self.residual - full @ unit.solved)
            found.append(Judgement(share, *self._cross_validated(full, self.stretches)))
        return found

    @cached_property
    def independent(self) -> float:
        """Return the share of the equations that count as independent for the model's own columns."""
        return self._independent_share(self.basis, self.residual)

    @cached_property
    def _powers(self) -> Array:
        """Square of the residual in each channel, (channels,)."""
        return np.array([self.residual[channel] @ self.residual[channel] for channel in self.channels])

    def taken(self, rows: Mapping[EstimationRow, Array]) -> float:
        """Return the part of the squared residual that columns take, fold by fold predicted from the other folds.

        Counted are the joints that the rows belong to.
        """
        unit = self._unit(rows) if rows else None
        if unit is None:
            return 0.0
        places = self.touched(rows)
        own = [s for s in self.stretches if any(p.start <= s.slice.start < p.stop for p in places)]
        squares = sum(float(self.residual[s.slice] @ self.residual[s.slice]) for s in own)
        gains, _ = self._cross_validated(self._full([unit])[0], own)
        return max(float(gains.sum()), 0.0) / max(squares, 1e-300)

    def _products(self, candidates: Sequence[Mapping[EstimationRow, Array]]) -> _Products | None:
        """Return the products of columns that act in the same rows; None where the problem has none of these."""
        parts = self._whitened({row: np.concatenate([c[row] for c in candidates]) for row in candidates[0]})
        if not parts:
            return None
        products = self._sums(parts, len(candidates), projected=False)
        # what the model spans nearly all of is first projected itself: of its square too little is left
        weak = np.flatnonzero((products.size < WEAK * products.before).any(axis=1))
        if len(weak):
            width = products.size.shape[1]
            where = (weak[:, None] * width + np.arange(width)).ravel()
            sums = self._sums({k: part[where] for k, part in parts.items()}, len(weak), projected=True)
            for all_of, some in zip(products, sums, strict=True):
                all_of[weak] = some
        return products

    def _sums(self, parts: dict[int, Array], count: int, *, projected: bool) -> _Products:
        """Return products of whitened columns of `count` candidates; `projected`: the columns are projected first."""

        def apart(columns: Array) -> Array:
            return columns.reshape(count, -1, columns.shape[1])

        spanned = {k: part @ self.basis[self.channels[k]] for k, part in parts.items()}
        shared = np.sum(list(spanned.values()), axis=0)
        width = len(shared) // count
        before = np.sqrt(np.sum([np.einsum("dk,dk->d", part, part) for part in parts.values()], axis=0))
        grams, loads = np.empty((count, len(self.channels), width, width)), np.empty((count, len(self.channels), width))
        own = apart(shared)
        if projected:
            for k, part in parts.items():
                part -= shared @ self.basis[self.channels[k]].T
        for k, channel in enumerate(self.channels):
            if k in parts and projected:
                grams[:, k] = apart(parts[k]) @ apart(parts[k]).transpose(0, 2, 1)
                loads[:, k] = apart(parts[k]) @ self.residual[channel]
                continue
            grams[:, k] = apart(shared @ self._grams[0][k]) @ own.transpose(0, 2, 1)
            loads[:, k] = -own @ self._grams[1][k]
            if k in parts:
                crossed = apart(spanned[k]) @ own.transpose(0, 2, 1)
                grams[:, k] += apart(parts[k]) @ apart(parts[k]).transpose(0, 2, 1)
                grams[:, k] -= crossed + crossed.transpose(0, 2, 1)
                loads[:, k] += apart(parts[k]) @ self.residual[channel]
        size = np.sqrt(np.maximum(np.einsum("ncdd->nd", grams), 0.0))
        before = before.reshape(count, width)
        size = np.where(size > SPANNED * before, size, np.inf)  # what the model spans is left out
        none = ~np.isfinite(before).all(axis=1)
        size[none], grams[none], loads[none] = np.inf, 0.0, 0.0
        scale = size[:, None, :]
        unit = grams / (scale[..., None] * scale[:, :, None, :])
        return _Products(before, size, unit, loads / scale, own)

    def _unit(self, rows: Mapping[EstimationRow, Array]) -> Unit | None:
        """Return columns of length one that the model does not span; None where it spans them all."""
        parts = self._whitened(rows)
        if not parts:
            return None
        sums = self._sums(parts, 1, projected=True)
        live = np.isfinite(sums.size[0])
        if not live.any():
            return None
        solved, _ = _least_squares(sums.grams.sum(axis=1), sums.loads.sum(axis=1))
        size = sums.size[0][live][:, None]
        own = {k: part[live] / size for k, part in parts.items()}
        return Unit(own, sums.shared[0][live] / size, solved[0][live])

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
        lefts, _ = _least_squares(gram.sum(axis=0) - gram, load.sum(axis=0) - load)
        for f, left in enumerate(lefts):
            gains[f] = 2 * left @ own_load[f] - left @ own_gram[f] @ left
        power = np.trace(gram, axis1=1, axis2=2)
        return gains, power / max(float(power.sum()), 1e-300)


class _Products(NamedTuple):
    """What the scores of several candidates are computed from."""

    before: Array
    """Sizes of their whitened columns, (n, d) …"""
    size: Array
    """… and of what the model does not span of them, (n, d); infinite where it spans them."""
    grams: Array
    """Gram matrices of that in every channel, scaled to length one, (n, channels, d, d) …"""
    loads: Array
    """… and its products with the residual, (n, channels, d)."""
    shared: Array
    """Products of the whitened columns with the basis, (n, d, r)."""


def _least_squares(gram: Array, load: Array) -> tuple[Array, NDArray[np.intp]]:
    """Solve normal equations (…, d, d) of a few unit columns, leaving out directions they hardly span.

    Returns the solutions (…, d) and the number of directions.
    """
    values, vectors = np.linalg.eigh(gram)
    live = values > 1e-10 * np.maximum(values[..., -1:], 1e-300)
    turned = np.einsum("...de,...d->...e", vectors, load) / np.where(live, values, np.inf)
    return np.einsum("...de,...e->...d", vectors, turned), live.sum(axis=-1)
