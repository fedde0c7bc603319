"""Normal equations of a trajectory fit, summed over blocks of time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.trajectory.loss import Weighed
from elid_cli.estimation.trajectory.unknowns import Unknowns
from elid_cli.model.runs import Run

BLOCKS = 6
"""Blocks of a recording, each of which is left out in turn for the standard errors (METHODS of leaving out blocks)."""
DAMPING = 1e-6
"""Of the normal equations' diagonal: directions that the motion does not show stay where they are."""
COURSE = 8
"""Parts of a block over which two fits are compared."""
SHORT = 16
"""Parts of a block whose sums tell whether the error has a memory."""


@dataclass(frozen=True)
class Equations:
    """What one pass over the recordings says: sums over blocks of J'J and J'e, and squares of e."""

    matrix: Array
    """(B, U, U), weighted; bent as the loss is: what noise moves follows it."""
    straight: Array
    """The same as the weights alone have it: a difference that is no noise follows that; 0 where columns were given."""
    load: Array
    """(B, U)."""
    short_matrix: Array
    """`matrix` and `load` of every part of every block, (B·SHORT, U, U) …"""
    short_load: Array
    """… and (B·SHORT, U); none where columns were given."""
    squares: Array
    """Sum of squares of the error of every joint in every block, rad² (m²), (B, n)."""
    lighter: Array
    """The same with large errors counted less: what the fit makes small."""
    scores: Array
    """Sum of squares of its slope by the error, rad² (m²), (B, n) …"""
    curvature: Array
    """… and of its second derivative, (B, n)."""
    sizes: Array
    """Sum of the error's size, rad (m), (B, n)."""
    course: Array
    """`lighter` of every part of every block, (B·COURSE, n)."""
    counts: Array
    """Samples of every block, (B,)."""
    spans: tuple[tuple[int, float, float], ...]
    """Recording, first and last time of every block, s."""

    @property
    def rms(self) -> Array:
        """Rms error of every joint, rad (m), (n,)."""
        found: Array = np.sqrt(self.squares.sum(axis=0) / self.counts.sum())
        return found

    @property
    def size(self) -> Array:
        """What the fit makes small: the same with large errors counted less, (n,)."""
        found: Array = np.sqrt(self.lighter.sum(axis=0) / self.counts.sum())
        return found

    @property
    def spread(self) -> float:
        """Variance of an error without memory, in units of the normal equations (Huber's of an M-estimator)."""
        size, bend = np.maximum(self.size, 1e-12), np.maximum(self.curvature.sum(axis=0), 1e-12)
        return float(np.mean(self.scores.sum(axis=0) / (size**2 * bend)))

    def holding(self, part: slice) -> Equations:
        """Return the equations of unknowns of which some stay where they are."""
        own = np.ones(self.load.shape[1])
        own[part] = 0.0
        both = np.outer(own, own)
        return replace(
            self, matrix=self.matrix * both, straight=self.straight * both, load=self.load * own,
            short_matrix=self.short_matrix * both, short_load=self.short_load * own,
        )  # fmt: skip


def parts_of(edges: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Yield parts of a stretch between edges (P + 1,) that are of one length L: their numbers, (p,), and rows, (p, L).

    Sums over all of them are made by few calls.
    """
    lengths = np.diff(edges)
    for length in np.unique(lengths):
        numbers = np.flatnonzero(lengths == length)
        yield numbers, edges[numbers, None] + np.arange(length)


def of_parts(values: Array, rows: NDArray[np.intp]) -> Array:
    """Return values (N, J, c) of parts of one length by their rows (p, L), (p, L·J, c).

    Of one joint samples stay side by side in memory, as they are in the columns: products round as theirs do.
    """
    taken = np.take(values.transpose(1, 2, 0), rows, axis=2)
    return taken.transpose(2, 3, 0, 1).reshape(len(rows), -1, values.shape[2])


def summed(
    run: Run, seen: Weighed, columns: Array, weights: Array, bend: Array, unknowns: Unknowns, *, whole: bool
) -> Equations:
    """Return the sums over every block of one stretch."""
    edges = np.linspace(0, len(seen.error), BLOCKS + 1).astype(int)
    scale, count = seen.light * weights, columns.shape[2]
    parts = BLOCKS * SHORT if whole else BLOCKS
    at = np.linspace(0, len(seen.error), parts + 1).astype(int)
    straight, matrices, loads = (
        np.zeros((BLOCKS, count, count)),
        np.zeros((parts, count, count)),
        np.zeros((parts, count)),
    )
    every = unknowns.chain_of == len(unknowns.chains)
    for chain, joints in enumerate(unknowns.chains):  # their unknowns and the delays move them, no others
        own = np.flatnonzero((unknowns.chain_of == chain) | every)
        products, pulls = np.empty((parts, len(own), len(own))), np.empty((parts, len(own)))
        light = columns[:, joints[:, None], own] * scale[:, joints, None]
        bending = light * bend[joints, None]
        force = seen.error[:, joints] * scale[:, joints]
        for numbers, rows in parts_of(at):
            plain, bent = (of_parts(part, rows) for part in (light, bending))
            pulls[numbers] = np.matmul(plain.transpose(0, 2, 1), force[rows].reshape(len(numbers), -1, 1))[..., 0]
            products[numbers] = np.matmul(bent.transpose(0, 2, 1), bent)
        loads[:, own] += pulls
        matrices[:, own[:, None], own] += products
        for k, (a, b) in enumerate(pairwise(edges.tolist()) if whole else ()):
            flat = light[a:b].reshape(-1, len(own))
            np.matmul(flat.T, flat, out=products[k])
        if whole:
            straight[:, own[:, None], own] += products[:BLOCKS]
    sums = (part.reshape(BLOCKS, -1, *part.shape[1:]).sum(axis=1) for part in (matrices, loads))
    short = slice(None) if whole else slice(0)

    def by_block(values: Array, starts: NDArray[np.intp] = edges) -> Array:
        found: Array = np.add.reduceat(values, starts[:-1], axis=0)
        return found

    course = np.linspace(0, len(seen.error), BLOCKS * COURSE + 1).astype(int)

    return Equations(
        next(sums), straight, next(sums), matrices[short], loads[short], by_block(seen.error**2), by_block(seen.loss),
        by_block((seen.error * seen.light**2) ** 2), by_block(seen.bend), by_block(np.abs(seen.error)),
        by_block(seen.loss, course), np.diff(edges),
        tuple((run.source, float(run.t[a]), float(run.t[b - 1])) for a, b in pairwise(edges)),
    )  # fmt: skip
