"""Normal equations of windows whose states are unknown as well, by piece of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.normal_equations import step_of

SMALL = 1e-9
"""Of the diagonal: directions that the motion does not show stay where they are."""


@dataclass(frozen=True)
class Eliminated:
    """Normal equations of the C unknowns, window by window, and what they leave to the windows' s states."""

    matrix: Array
    """(S, C, C)."""
    load: Array
    """(S, C)."""
    square: Array
    """Squared error that the states' steps would leave, (S,)."""
    back: Array
    """Steps of the states: ``back[:, :, -1] + back[:, :, :-1] @ step of the unknowns``, (S, s, C + 1)."""


def eliminated(gram: Array, unknowns: int, damping: Array | float = 0.0) -> Eliminated:
    """Eliminate the states of windows.

    Parameters
    ----------
    gram
        Gram matrices of [unknowns, states, error], weighted, (S, C + s + 1, C + s + 1).
    unknowns
        C.
    damping
        Part of the diagonal that is added for the states (Levenberg, Marquardt), (S,).
    """
    states = gram[:, unknowns:-1, unknowns:-1]
    others = np.append(np.arange(unknowns), gram.shape[1] - 1)
    scale = np.sqrt(np.maximum(np.diagonal(states, axis1=1, axis2=2), 1e-300))
    more = np.broadcast_to(SMALL + np.asarray(damping), len(gram))[:, None, None] * np.eye(scale.shape[1])
    mixed = gram[:, unknowns:-1][:, :, others]
    back = -np.linalg.solve(states / (scale[:, :, None] * scale[:, None]) + more, mixed / scale[:, :, None])
    back /= scale[:, :, None]
    # damped states do not reach their best: the whole quadratic form at the step that they take
    whole = gram[:, others][:, :, others] + np.swapaxes(mixed, 1, 2) @ back
    whole += np.swapaxes(back, 1, 2) @ (mixed + states @ back)
    return Eliminated(whole[:, :-1, :-1], whole[:, :-1, -1], whole[:, -1, -1], back)


def left_out(gram: Array, unknowns: int, blocks: NDArray[np.intp]) -> Array:
    """Return the steps of the unknowns without each block of time in turn, (B, C).

    Parameters
    ----------
    gram
        Gram matrices of S windows, each in P pieces, (S, P, C + s + 1, C + s + 1).
    unknowns
        C.
    blocks
        Block of every piece, (S, P).
    """
    windows = gram.sum(axis=1)
    whole = eliminated(windows, unknowns)
    matrix, load = whole.matrix.sum(axis=0), whole.load.sum(axis=0)
    found = []
    for block in np.unique(blocks):
        inside = blocks == block
        hit = inside.any(axis=1)
        rest = eliminated(windows[hit] - (gram[hit] * inside[hit][:, :, None, None]).sum(axis=1), unknowns)
        found.append(step_of(matrix + (rest.matrix - whole.matrix[hit]).sum(axis=0),
                             load + (rest.load - whole.load[hit]).sum(axis=0), SMALL))  # fmt: skip
    return np.array(found)
