"""Cholesky's factor of a banded matrix, and solutions with many right-hand sides by blocks as wide as the band.

LAPACK's own solver takes one right-hand side after the other through the whole band.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.lapack import lapack


class BandedFactor:
    """U of A = Uᵀ U, of a symmetric matrix in upper band storage, (b + 1, N).

    Raises
    ------
    numpy.linalg.LinAlgError
        A is not positive definite.
    """

    def __init__(self, band: Array) -> None:
        factor, info = lapack().dpbtrf(np.asfortranarray(band), overwrite_ab=1)
        if info:
            raise np.linalg.LinAlgError("not positive definite")
        self._width, self._size = len(band) - 1, band.shape[1]
        self._values: Array = factor.ravel(order="F")
        self._below = np.asfortranarray(np.tri(self._width))

    def forward(self, sides: Array) -> Array:
        """Return Uᵀ^-1 times sides (N, k)."""
        found = sides.copy()
        for start, stop in self._blocks():
            here = found[start:stop]
            if start:
                before = start - self._width
                here -= self._lower(before, start, start, stop).T @ found[before:start]
            here[:] = lapack().dtrtrs(self._dense(start, stop, start, stop), here, trans=1)[0]
        return found

    def back(self, sides: Array) -> Array:
        """Return U^-1 times sides (N, k)."""
        found = sides.copy()
        for start, stop in reversed(self._blocks()):
            here = found[start:stop]
            if stop < self._size:
                after = min(stop + self._width, self._size)
                here -= self._lower(start, stop, stop, after) @ found[stop:after]
            here[:] = lapack().dtrtrs(self._dense(start, stop, start, stop), here)[0]
        return found

    def _blocks(self) -> list[tuple[int, int]]:
        starts = range(0, self._size, self._width)
        return [(start, min(start + self._width, self._size)) for start in starts]

    def _lower(self, first: int, last: int, left: int, right: int) -> Array:
        """Return the same where all that lies in the band is left of the diagonal, and zeros right of it."""
        found: Array = self._dense(first, last, left, right) * self._below[: last - first, : right - left]
        return found

    def _dense(self, first: int, last: int, left: int, right: int) -> NDArray[np.float64]:
        """Return U[first:last, left:right]; what lies outside of its band is of other columns."""
        b = self._width
        begin = b + first + left * b
        shape, strides = (last - first, right - left), (self._values.itemsize, b * self._values.itemsize)
        return np.lib.stride_tricks.as_strided(self._values[begin:], shape, strides, writeable=False)
