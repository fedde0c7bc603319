"""A log cut into pieces of time, in which the equations' operators are small dense matrices.

Every row of the equations reaches over a few knots only: filter, differences and splines are bands. Products of general
sparse matrices spend their time on indices; those of some fifty samples by some thirty knots are plain ones.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.motor_log import MotorLog
from elid_cli.estimation.motor_side.operators import KnotSpline
from elid_cli.signals.splines import ORDER

SAMPLES = 32
"""Samples of a piece."""
_NUMBERS = 150_000
"""Numbers in one matrix of a turn: they stay in the cache."""
_STENCILS = 4 + 2
"""Samples to either side that a difference, and one of few samples within it, reach; near an end all are there."""


class Pieces:
    """Pieces of a log, each with a window of samples and one of knots that its rows reach.

    Parameters
    ----------
    log, spline
        The log and the links' splines.
    rows, centres
        The torque rows' low-pass (rows, N), sparse, and the samples that its rows lie on, (rows,).
    levels
        How many joints lie between one whose rotor loads others and the last of these, at least 1.
    """

    def __init__(
        self, log: MotorLog, spline: KnotSpline, rows: Any, centres: NDArray[np.intp], levels: int = 1
    ) -> None:
        self._log, self._spline, self._rows = log, spline, rows
        count = log.count
        reach = int(np.diff(rows.indptr).max()) // 2 + 1
        margin = reach + levels * _STENCILS
        starts = np.arange(0, count, SAMPLES)
        width = min(SAMPLES + 2 * margin, count)
        self._start = np.clip(starts - margin, 0, count - width)
        self._window = self._start[:, None] + np.arange(width)
        knots = spline.first[self._window]
        self.knots = int((knots.max(axis=1) - knots.min(axis=1)).max()) + ORDER
        self.first_knot = np.minimum(knots.min(axis=1), spline.count - self.knots)
        """First knot of every piece's window, (C,)."""
        self.samples, self.sampled = _grouped(np.arange(count) // SAMPLES, len(starts))
        """Samples of every piece, (C, SAMPLES), and which of these exist."""
        self.torques, self.filtered = _grouped(centres // SAMPLES, len(starts))
        """Torque rows of every piece, (C, R), and which of these exist."""
        self.low_pass = self._dense(rows, self.torques) * self.filtered[:, :, None]
        """The low-pass from the window's samples, (C, R, S)."""
        self.levels = levels

    def __len__(self) -> int:
        return len(self._start)

    @cached_property
    def reach(self) -> int:
        """Most knots between two that one row touches."""
        touched = (self.low_pass != 0).astype(float)
        for _ in range(self.levels):
            touched = touched @ (self.rates[0] != 0) @ (self.short_rates[0] != 0)
        touched = touched @ (self.basis != 0) > 0
        first, last = touched.argmax(axis=2), self.knots - 1 - touched[:, :, ::-1].argmax(axis=2)
        return int((last - first)[self.filtered].max())

    def _dense(self, matrix: Any, rows: NDArray[np.intp]) -> Array:
        """Return rows (C, R) of a sparse matrix over the window's samples, (C, R, S); what lies outside is left out."""
        part = matrix[rows.ravel()].tocoo()
        piece, row = part.row // rows.shape[1], part.row % rows.shape[1]
        column = part.col - self._start[piece]
        inside = (column >= 0) & (column < self._window.shape[1])
        found = np.zeros((*rows.shape, self._window.shape[1]))
        found[piece[inside], row[inside], column[inside]] = part.data[inside]
        return found

    @cached_property
    def _values(self) -> list[Array]:
        """The basis values that are not zero, and their first and second derivatives, (N, 6) each."""
        return [self._spline.values(order) for order in range(3)]

    @cached_property
    def basis(self) -> Array:
        """The basis at the window's samples, (C, S, W)."""
        return self.spread(self._values[0], slice(None))

    @cached_property
    def rates(self) -> list[Array]:
        """First and second differences within the window, (C, S, S)."""
        return [self._dense(matrix, self._window) for matrix in self._log.rates]

    @cached_property
    def short_rates(self) -> list[Array]:
        """Those over few samples, (C, S, S)."""
        return [self._dense(matrix, self._window) for matrix in self._log.short_rates]

    @cached_property
    def filtered_acceleration(self) -> Array:
        """The low-pass of second differences, (C, R, S)."""
        return np.asarray(self.low_pass @ self.rates[1])

    def own(self, values: Array, part: slice) -> Array:
        """Return the rows of a piece's own samples out of its window's, (C, SAMPLES, ...); none past the end."""
        place = np.minimum(self.samples - self._start[:, None], self._window.shape[1] - 1)[part]
        there = self.sampled[part]
        found: Array = values[np.arange(len(place))[:, None], place]
        found *= there.reshape(*there.shape, *[1] * (values.ndim - 2))
        return found

    def seen(self, values: Array, part: slice) -> Array:
        """Return values (N, ...) at the window's samples, (C, S, ...)."""
        return values[self._window[part]]

    def supported(self, slopes: Array) -> Array:
        """Return sum over d of slopes[d] (N, n) times the d-th derivatives of the six basis values, (N, 6 n)."""
        found = np.zeros((slopes.shape[1], ORDER, slopes.shape[2]))
        for order, slope in enumerate(slopes):
            found += self._values[order][:, :, None] * slope[:, None]
        return found.reshape(len(found), -1)

    def spread(self, six: Array, part: slice) -> Array:
        """Return what stands on six knots, (N, 6 n), at the window's samples over its knots, (C, S, W n)."""
        window, n = self._window[part], six.shape[1] // ORDER
        found = np.zeros((*window.shape, self.knots * n))
        place = (self._spline.first[window] - self.first_knot[part, None]) * n
        place += np.arange(window.size).reshape(window.shape) * found.shape[2]
        found.reshape(-1)[place[:, :, None] + np.arange(ORDER * n)] = six[window]
        return found

    def rows_of(self, theta: Array, tau: Array, part: slice) -> Array:
        """Return values of positions (N, n, ...) and torque rows (rows, n, ...) piece by piece, (C, n (T + R), ...).

        Rows are ordered by joint, positions first; those that do not exist are zero.
        """
        parts = []
        for values, every, exists in ((theta, self.samples, self.sampled), (tau, self.torques, self.filtered)):
            place, there = every[part], exists[part]
            picked = values[place] * there.reshape(*there.shape, *[1] * (values.ndim - 1))
            parts.append(np.moveaxis(picked, 2, 1))
        return np.concatenate(parts, axis=2).reshape(len(parts[0]), -1, *theta.shape[2:])

    def batches(self, n: int) -> list[slice]:
        """Return the pieces in turns of which the derivatives of n joints' rows fit the cache."""
        many = max(1, _NUMBERS // (self._window.shape[1] * self.knots * n))
        return [slice(first, first + many) for first in range(0, len(self), many)]

    def added(self, pieces: Array, first: int, total: Array) -> None:
        """Add values of pieces (C, W n, ...), from number `first` on, to those of all coefficients (K n, ...)."""
        n = pieces.shape[1] // self.knots
        for start, values in zip(self.first_knot[first:].tolist(), pieces, strict=False):
            total[start * n : (start + self.knots) * n] += values

    def added_band(self, pieces: Array, first: int, band: Array) -> None:
        """Add symmetric matrices (C, W n, W n), from number `first` on, to one in upper band storage (., K n)."""
        reach, width = len(band) - 1, pieces.shape[1]
        n = width // self.knots
        row, column = (place.ravel() for place in np.indices((width, width)))
        upper = np.flatnonzero((column >= row) & (column - row <= reach))
        place = (reach + row[upper] - column[upper]) * band.shape[1] + column[upper]
        starts = self.first_knot[first : first + len(pieces)] * n
        index = starts[:, None] + place
        band += np.bincount(
            index.ravel(), pieces.reshape(len(pieces), -1)[:, upper].ravel(), minlength=band.size
        ).reshape(band.shape)


def _grouped(piece: NDArray[np.intp], pieces: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the numbers of the items that belong to every piece, and which of the places are taken."""
    number = np.bincount(piece, minlength=pieces)
    first = np.r_[0, np.cumsum(number)[:-1]]
    place = first[:, None] + np.arange(number.max())
    there: NDArray[np.bool_] = np.arange(number.max()) < number[:, None]
    return np.minimum(place, len(piece) - 1), there
