"""The equations' rows in groups that reach the same few knots: their derivatives are small dense matrices.

Every row reaches over a few samples only, and a sample over six knots: filter, differences and splines are bands.
Products of general sparse matrices spend their time on indices; those of fifty samples by thirty knots are plain ones.

A row is told by its taps: what it does to the samples around the one that it lies in the middle of, (rows, taps).
"""

from __future__ import annotations

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
        self._samples: dict[int, NDArray[np.intp]] = {}
        self._places: dict[tuple[int, int, int], NDArray[np.intp]] = {}

    def of(self, values: Array, part: slice) -> Array:
        """Return values (rows, n, ...) group by group, (C, R n, ...): zero where a row does not exist."""
        there = self.there[part]
        found: Array = values[self.rows[part]] * there.reshape(*there.shape, *[1] * (values.ndim - 1))
        return found.reshape(len(found), there.shape[1] * values.shape[1], *values.shape[2:])

    def turns(self, n: int) -> list[slice]:
        """Return the groups in turns whose matrices of n joints fit the cache together."""
        many = _NUMBERS / (max(self._window.shape[1], n * self.rows.shape[1]) * self.knots * n)
        edges = np.linspace(0, len(self.rows), max(1, round(len(self.rows) / many)) + 1).round().astype(int).tolist()
        return [slice(first, last) for first, last in pairwise(edges) if last > first]

    @cached_property
    def basis(self) -> Array:
        """The basis at the window's samples, (C, S, W)."""
        return self.spread(self._values, slice(None))

    def spread(self, six: Array, part: slice) -> Array:
        """Return what stands on six knots, (N, 6 n), at the window's samples over its knots, (C, S, W n)."""
        window, n = self._window[part], six.shape[1] // ORDER
        found = np.zeros(window.size * self.knots * n)
        found[self._spread_to(n, part)] = six.take(window.ravel(), axis=0).ravel()
        return found.reshape(*window.shape, -1)

    def _spread_to(self, n: int, part: slice) -> NDArray[np.intp]:
        """Return where `spread` puts n columns per knot, (C S 6 n,): one index is twice as fast as rows of them."""
        name = n, part.start, part.stop
        if name not in self._places:
            offset = self._offset[part] * n
            place = offset.ravel() + np.arange(offset.size) * (self.knots * n)
            self._places[name] = (place[:, None] + np.arange(ORDER * n)).ravel()
        return self._places[name]

    def samples(self, wide: int) -> NDArray[np.intp]:
        """Return the samples that so many taps of every row stand on, (rows, wide); beyond the ends the last ones."""
        if wide not in self._samples:
            place = self.centres[:, None] + np.arange(-(wide // 2), wide // 2 + 1)
            self._samples[wide] = np.clip(place, 0, len(self._values) - 1)
        return self._samples[wide]

    def touched(self, wide: int, part: slice) -> tuple[slice, slice]:
        """Return which of the window's samples so many taps of a group's rows touch, and which of its knots these."""
        first, last = self._beside - wide // 2, self._beside + int(self._apart[-1]) + wide // 2
        offset = self._offset[part]
        knots = slice(int(offset[:, first].min()), int(offset[:, last].max()) + ORDER)
        return slice(first, last + 1), knots

    def dense(self, taps: Array, part: slice) -> Array:
        """Return rows of taps on the samples that they touch, (C, R, samples)."""
        rows, there, wide = self.rows[part], self.there[part], taps.shape[1]
        found = np.zeros((*rows.shape, int(self._apart[-1]) + wide))
        group, row, item = found.strides
        apart = int(self._apart[1]) if len(self._apart) > 1 else 0
        there_of = np.lib.stride_tricks.as_strided(found, (*rows.shape, wide), (group, row + apart * item, item))
        np.multiply(taps[rows], there[:, :, None], out=there_of)
        return found

    def added(self, values: Array, part: slice, total: Array) -> None:
        """Add values on windows, (C, W n, ...), to those of all coefficients (K n, ...)."""
        n = values.shape[1] // self.knots
        for start, window in zip(self.first_knot[part].tolist(), values, strict=True):
            total[start * n : (start + self.knots) * n] += window

    def added_squares(self, values: Array, part: slice, band: Array) -> None:
        """Add AᵀA of matrices A on windows, (C, rows, W n), to a banded matrix whose columns are rows of `band`.

        `band` is (K n, b + 1), upper band storage turned over. Beyond the band AᵀA is zero: no row reaches so far.
        """
        reach, width = band.shape[1] - 1, values.shape[2]
        square = np.empty((len(values), width, reach + width))
        square[:, :, :reach] = 0.0
        np.matmul(values.transpose(0, 2, 1), values, out=square[:, :, reach:])
        group, row, item = square.strides
        shape = len(values), width, reach + 1
        skewed = np.lib.stride_tricks.as_strided(square, shape, (group, row + item, item), writeable=False)
        n = width // self.knots
        for start, window in zip((self.first_knot[part] * n).tolist(), skewed, strict=True):
            band[start : start + width] += window


def summed(taps: Array, others: Array) -> Array:
    """Return the sum of two rows of taps of unlike width."""
    wide, narrow = (taps, others) if taps.shape[1] >= others.shape[1] else (others, taps)
    found = wide.copy()
    margin = (wide.shape[1] - narrow.shape[1]) // 2
    found[:, margin : margin + narrow.shape[1]] += narrow
    return found
