"""The equations' rows in groups that reach the same few knots: their derivatives are small dense matrices.

Every row reaches over a few samples only, and a sample over six knots: filter, differences and splines are bands.
Products of general sparse matrices spend their time on indices; those of fifty samples by thirty knots are plain ones.

A row is told by its taps: what it does to the samples around the one that it lies in the middle of, (rows, taps).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.operators import KnotSpline
from elid_cli.signals.splines import ORDER

_NUMBERS = 150_000
"""Numbers in one matrix of a turn: they stay in the cache."""


class Pieces:
    """Rows in groups, each with the windows of samples and of knots that its rows reach.

    Parameters
    ----------
    spline
        The links' splines.
    centres
        The sample in the middle of every row, evenly apart, (rows,).
    reach
        Samples to either side of it that a row touches at most.
    samples
        Samples that a group's middles lie within.
    """

    def __init__(self, spline: KnotSpline, centres: NDArray[np.intp], reach: int, samples: int) -> None:
        count, last = len(centres), len(spline.first) - 1
        many = max(1, samples // int(centres[1] - centres[0]))
        group = np.arange(-(-count // many))
        place = group[:, None] * many + np.arange(many)
        self.there: NDArray[np.bool_] = place < count
        """Which places of a group are taken, (C, R)."""
        self.rows = np.minimum(place, count - 1)
        """Rows of every group, (C, R)."""
        self.centres = centres
        start, stop = np.maximum(centres - reach, 0), np.minimum(centres + reach, last)
        self.reach = int((spline.first[stop] - spline.first[start]).max()) + ORDER - 1
        """Most knots between two that one row touches."""
        self._apart, self._beside = int(centres[1] - centres[0]) * np.arange(many), reach
        """Of a group's rows, the samples between the first one's middle and their own; and those before that one."""
        length = int(self._apart[-1]) + 2 * reach + 1
        begin = centres[self.rows[:, 0]] - reach
        # beyond the ends, where no row touches anything, the last samples once more
        self._window = np.clip(begin[:, None] + np.arange(length), 0, last)
        knots = spline.first[self._window]
        self.knots = int((knots[:, -1] - knots[:, 0]).max()) + ORDER
        """Knots of a window, W."""
        self.first_knot = np.minimum(knots[:, 0], spline.count - self.knots)
        """First knot of every group's window, (C,)."""
        self._offset = knots - self.first_knot[:, None]
        self._values = spline.values(0)
        self._places: dict[tuple[int, int, int], NDArray[np.intp]] = {}

    def of(self, values: Array, part: slice) -> Array:
        """Return values (rows, n, ...) group by group, (C, n R, ...): zero where a row does not exist."""
        there = self.there[part]
        found: Array = values[self.rows[part]] * there.reshape(*there.shape, *[1] * (values.ndim - 1))
        return found.swapaxes(1, 2).reshape(len(found), there.shape[1] * values.shape[1], *values.shape[2:])

    def turns(self, n: int) -> list[slice]:
        """Return the groups in turns whose matrices of n joints fit the cache together."""
        many = _NUMBERS / (max(self._window.shape[1], n * self.rows.shape[1]) * self.knots * n)
        edges = np.linspace(0, len(self.rows), max(1, round(len(self.rows) / many)) + 1).round().astype(int).tolist()
        return [slice(first, last) for first, last in pairwise(edges) if last > first]

    @cached_property
    def basis(self) -> Array:
        """The basis at the window's samples, (C, S, W)."""
        return next(self.spread([self._values], slice(None)))

    def spread(self, sixes: Iterable[Array], part: slice) -> Iterator[Array]:
        """Yield what stands on six knots, (N, 6 n) each, at the window's samples over its knots, (C, S, W n).

        All in the same memory, one after the other: what is zero in one of them is so in all.
        """
        window, found, n = self._window[part], np.zeros(0), 0
        for six in sixes:
            if not len(found):
                n = six.shape[1] // ORDER
                found = np.zeros(window.size * self.knots * n)
            found[self._spread_to(n, part)] = six.take(window.ravel(), axis=0).ravel()
            yield found.reshape(*window.shape, -1)

    def _spread_to(self, n: int, part: slice) -> NDArray[np.intp]:
        """Return where `spread` puts n columns per knot, (C S 6 n,): one index is twice as fast as rows of them."""
        name = n, part.start, part.stop
        if name not in self._places:
            offset = self._offset[part] * n
            place = offset.ravel() + np.arange(offset.size) * (self.knots * n)
            self._places[name] = (place[:, None] + np.arange(ORDER * n)).ravel()
        return self._places[name]

    def taps(self, kernel: Array) -> Array:
        """Return the same taps (wide,) for every place of a group, (C R, wide): zero where a row does not exist."""
        return self.there.reshape(-1, 1) * kernel

    def around(self, values: Array, wide: int) -> Array:
        """Return values (N,) at the samples that so many taps of every place stand on, (C R, wide), by a view.

        Beyond the ends it is the last one.
        """
        reach, apart, count = wide // 2, int(self.centres[1] - self.centres[0]), self.there.size
        first = int(self.centres[0]) - reach
        after = first + apart * (count - 1) + wide - len(values)
        ends = np.full(max(-first, 0), values[0]), np.full(max(after, 0), values[-1])
        whole = np.concatenate([ends[0], values[max(first, 0) :], ends[1]])
        step = whole.itemsize
        return np.lib.stride_tricks.as_strided(whole, (count, wide), (apart * step, step), writeable=False)

    def touched(self, wide: int, part: slice) -> tuple[slice, slice]:
        """Return which of the window's samples so many taps of a group's rows touch, and which of its knots these."""
        first, last = self._beside - wide // 2, self._beside + int(self._apart[-1]) + wide // 2
        offset = self._offset[part]
        knots = slice(int(offset[:, first].min()), int(offset[:, last].max()) + ORDER)
        return slice(first, last + 1), knots

    def dense(self, taps: Sequence[Array], part: slice) -> Array:
        """Return rows of taps on the samples that they touch, (C, I R, samples).

        `taps`, (C R, wide) each, are I kinds of rows, in the order in which they come. They may be of unlike width.
        """
        wide, (count, many) = max(own.shape[1] for own in taps), self.there[part].shape
        found = np.zeros((count, len(taps), many, int(self._apart[-1]) + wide))
        group, _, row, item = found.strides
        apart = int(self._apart[1]) if len(self._apart) > 1 else 0
        for k, own in enumerate(taps):
            margin = (wide - own.shape[1]) // 2
            shape, strides = (count, many, own.shape[1]), (group, row + apart * item, item)
            there_of = np.lib.stride_tricks.as_strided(found[:, k, :, margin:], shape, strides)
            there_of[:] = own.reshape(*self.there.shape, -1)[part]
        return found.reshape(count, -1, found.shape[3])

    def added_products(self, values: Array, others: Array, part: slice, band: Array, sides: Array) -> None:
        """Add AᵀA and AᵀB of matrices on windows, A (C, rows, W n) and B (C, rows, k), to a banded matrix and to sides.

        `band` is (K n, b + 1), upper band storage turned over; `sides` are (K n, k). Beyond the band AᵀA is zero: no
        row reaches so far.
        """
        reach, width = band.shape[1] - 1, values.shape[2]
        # one product of unlike matrices: of Aᵀ A alone NumPy computes one half and copies it number by number
        both = np.concatenate([values, others], axis=2)
        square = np.zeros((width, reach + both.shape[2]))  # group by group in the same memory: it stays in the cache
        row, item = square.strides
        skewed = np.lib.stride_tricks.as_strided(square, (width, reach + 1), (row + item, item), writeable=False)
        product, beside = square[:, reach:], square[:, reach + width :]
        first = (self.first_knot[part] * (width // self.knots)).tolist()
        for start, own, all_of_it in zip(first, values, both, strict=True):
            np.matmul(own.T, all_of_it, out=product)
            band[start : start + width] += skewed
            sides[start : start + width] += beside


def summed(taps: Array, others: Array) -> Array:
    """Return the sum of two rows of taps of unlike width."""
    wide, narrow = (taps, others) if taps.shape[1] >= others.shape[1] else (others, taps)
    found = wide.copy()
    margin = (wide.shape[1] - narrow.shape[1]) // 2
    found[:, margin : margin + narrow.shape[1]] += narrow
    return found
