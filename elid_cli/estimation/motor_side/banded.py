"""Cholesky's factor of a banded matrix, and solutions with many right-hand sides by blocks as wide as the band.

LAPACK's own solver takes one right-hand side after the other through the whole band.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import as_strided

from elid_cli._types import Array
from elid_cli.lapack import lapack

FEW = 3
"""Right-hand sides up to which LAPACK's solver is the quicker one."""


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
        self._factor, self._size = factor, band.shape[1]
        self._blocks: tuple[Array, Array] | None = None

    def forward(self, sides: Array) -> Array:
        """Return Uᵀ^-1 times sides (N, k)."""
        if sides.shape[1] <= FEW:
            return self._one_by_one(sides, 1)
        (own, beside), found, solve = self._dense(), self._in_blocks(sides), lapack().dtrtrs
        for k, here in enumerate(found):
            if k:
                here -= found[k - 1] @ beside[k - 1]
            here[:] = solve(own[k], here.T, trans=1, overwrite_b=1)[0].T
        return self._in_rows(found)

    def back(self, sides: Array) -> Array:
        """Return U^-1 times sides (N, k)."""
        if sides.shape[1] <= FEW:
            return self._one_by_one(sides, 0)
        (own, beside), found, solve = self._dense(), self._in_blocks(sides), lapack().dtrtrs
        for k in reversed(range(len(found))):
            here = found[k]
            if k < len(beside):
                here -= found[k + 1] @ beside[k].T
            here[:] = solve(own[k], here.T, overwrite_b=1)[0].T
        return self._in_rows(found)

    def _one_by_one(self, sides: Array, trans: int) -> Array:
        return np.ascontiguousarray(lapack().dtbtrs(self._factor, sides, trans="T" if trans else "N")[0])

    def _dense(self) -> tuple[Array, Array]:
        """Return U's blocks on the diagonal, (m, b, b), and those right of them, (m - 1, b, b), by views of the band.

        The last ones are filled up with those of the identity. What lies outside of the band in a view is of other
        columns: LAPACK does not look below the diagonal, and right of the band the second ones are zero.
        """
        if self._blocks is None:
            b = len(self._factor) - 1
            many = -(-self._size // b)
            values = np.zeros(many * b * (b + 1) + b)
            values[: self._factor.size] = self._factor.ravel(order="F")
            values[b + (b + 1) * np.arange(self._size, many * b)] = 1.0
            apart, step = (b + 1) * b, values.itemsize
            strides = apart * step, step, b * step
            own = as_strided(values[b:], (many, b, b), strides, writeable=False)
            right = as_strided(values[b + b * b :], (many - 1, b, b), strides, writeable=False)
            self._blocks = own, right * np.tri(b)
        return self._blocks

    def _in_blocks(self, sides: Array) -> Array:
        """Return sides (N, k) in blocks of rows, each turned over, (m, k, b): LAPACK solves in place there."""
        b = len(self._factor) - 1
        many, wide = -(-self._size // b), sides.shape[1]
        whole = np.zeros((many * b, wide))
        whole[: self._size] = sides
        return np.ascontiguousarray(whole.reshape(many, b, wide).transpose(0, 2, 1))

    def _in_rows(self, blocks: Array) -> Array:
        wide = blocks.shape[1]
        return np.ascontiguousarray(blocks.transpose(0, 2, 1).reshape(-1, wide)[: self._size])
