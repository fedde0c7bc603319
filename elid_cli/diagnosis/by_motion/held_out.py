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
DAMPING = 1e-7
"""Of the normal equations' diagonal: columns that the motion does not show stay at 0."""


@dataclass(frozen=True)
class Blocks:
    """Normal equations of an error e (N,) against columns, by block of time: (B, c, c), (B, c), (B,)."""

    matrix: Array
    load: Array
    square: Array

    @classmethod
    def of(cls, columns: Array, error: Array, edges: NDArray[np.intp]) -> Blocks:
        """Return them of columns (N, c) and an error (N,); blocks begin at `edges`."""
        both = np.concatenate([columns, error[:, None]], axis=1)
        whole = np.array([part.T @ part for part in np.split(both, edges[1:])])
        return cls(whole[:, :-1, :-1], whole[:, :-1, -1], whole[:, -1, -1])

    def left(self, use: NDArray[np.bool_] | slice = slice(None)) -> Array:
        """Return the squared error of every block, (B,), predicted by a step that was fitted to the others."""
        matrix = self.matrix[:, use][:, :, use]
        load = self.load[:, use]
        whole, pull = matrix.sum(axis=0), load.sum(axis=0)
        scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
        found = np.empty(len(matrix))
        for k, (own, own_pull) in enumerate(zip(matrix, load, strict=True)):
            rest = (whole - own) / np.outer(scale, scale) + DAMPING * np.eye(len(scale))
            step = -np.linalg.solve(rest, (pull - own_pull) / scale) / scale
            found[k] = self.square[k] + 2 * step @ own_pull + step @ own @ step
        return np.maximum(found, 0.0)


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
