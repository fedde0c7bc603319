"""How well a linear step explains stretches of simulated motion that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

HARMLESS = 0.02
"""Part of a block's squared error by which it may grow without being harmed."""
ELSEWHERE = 0.1
"""Part of what an effect takes away that it must take from other blocks than the one it helps most."""
MORE = 1.5
"""Times the squared error that something else leaves which is clearly more."""
DAMPING = 1e-7
"""Of the normal equations' diagonal: columns that the motion does not show stay at 0."""


@dataclass(frozen=True)
class Blocks:
    """Normal equations of an error e (N,) against columns, by block of time: (..., B, c, c), (..., B, c), (B,)."""

    matrix: Array
    load: Array
    square: Array

    @classmethod
    def of(cls, columns: Array, error: Array, edges: NDArray[np.intp]) -> Blocks:
        """Return them of columns (N, c) and an error (N,); blocks begin at `edges`."""
        both = np.concatenate([columns, error[:, None]], axis=1)
        whole = np.array([part.T @ part for part in np.split(both, edges[1:])])
        return cls(whole[:, :-1, :-1], whole[:, :-1, -1], whole[:, -1, -1])

    def beside(self, known: Array, more: Array, edges: NDArray[np.intp]) -> Blocks:
        """Return those of E sets of d further columns each, (E, B, c + d, c + d).

        Parameters
        ----------
        known
            The columns and the error that these are of, (N, c + 1).
        more
            The further columns, (N, E, d).
        edges
            Where blocks begin.
        """
        sets, added, c = more.shape[1], more.shape[2], known.shape[1] - 1
        matrix = np.empty((sets, len(self.square), c + added, c + added))
        load = np.empty((sets, len(self.square), c + added))
        matrix[:, :, :c, :c], load[:, :, :c] = self.matrix, self.load
        for k, (have, new) in enumerate(zip(np.split(known, edges[1:]), np.split(more, edges[1:]), strict=True)):
            across = (have.T @ new.reshape(len(new), -1)).reshape(c + 1, sets, added)
            matrix[:, k, :c, c:], load[:, k, c:] = across[:-1].transpose(1, 0, 2), across[-1]
            matrix[:, k, c:, :c] = across[:-1].transpose(1, 2, 0)
            matrix[:, k, c:, c:] = np.einsum("nei,nej->eij", new, new)
        return Blocks(matrix, load, self.square)

    def left(self, use: NDArray[np.bool_] | slice = slice(None)) -> Array:
        """Return the squared error of every block, (..., B), predicted by a step that was fitted to the others."""
        matrix, load = self.matrix[..., use, :][..., use], self.load[..., use]
        whole, pull = matrix.sum(axis=-3, keepdims=True), load.sum(axis=-2, keepdims=True)
        scale = np.sqrt(np.maximum(np.diagonal(whole, axis1=-2, axis2=-1), 1e-300))
        rest = (whole - matrix) / (scale[..., :, None] * scale[..., None, :]) + DAMPING * np.eye(scale.shape[-1])
        step = -np.linalg.solve(rest, ((pull - load) / scale)[..., None])[..., 0] / scale
        found = self.square + 2 * (step * load).sum(axis=-1) + np.einsum("...i,...ij,...j->...", step, matrix, step)
        return np.asarray(np.maximum(found, 0.0))


def gain(without: Array, with_it: Array) -> tuple[float, float]:
    """Return the part of the squared error that is taken from blocks not fitted to, and the part of blocks not harmed.

    What one block alone tells is no effect that lasts: then none counts as helped.
    """
    before, better = float(without.sum()), without - with_it
    if before <= 0 or better.sum() <= 0:
        return 0.0, 0.0
    lasting = better.sum() - better.max() >= ELSEWHERE * better.sum()
    helped = float(np.mean(better > -HARMLESS * without)) if lasting else 0.0
    return float(better.sum()) / before, helped
