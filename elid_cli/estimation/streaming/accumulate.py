"""Triangles that grow block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.filtered_rows import FilteredBlock
from elid_cli.estimation.regression.observation import REVERSAL_SHARE
from elid_cli.estimation.regression.triangles import Triangle, factor_of, onto
from elid_cli.estimation.stretches import stretches_between
from elid_cli.model.regressor import EstimationRow, RegressorPlan
from elid_cli.signals.signals import Signals


@dataclass(frozen=True)
class ReductionBlock:
    """Rows of a block, each once: the program's outputs, n rates of torque, ones, n torques.

    `picks` names, for every row group, its columns among them, then those of the delay and offset of its torque
    channel, and last its torque.
    """

    first: int
    last: int
    segment: int
    rows: Array
    """(rows, last - first); in single precision where that suffices."""
    picks: Sequence[NDArray[np.intp]]
    use: NDArray[np.bool_]
    """Instants away from reversals, (n, last - first)."""
    known: NDArray[np.bool_]
    """Instants at which the torque is known, (n, last - first)."""

    @property
    def instants(self) -> int:
        """Number of instants."""
        return self.last - self.first

    def single(self) -> ReductionBlock:
        """Return the block in single precision, which takes half the room."""
        return replace(self, rows=self.rows.astype(np.float32))


def kept(block: FilteredBlock, plan: RegressorPlan, signals: Signals) -> ReductionBlock:
    """Return a block as it is reduced."""
    distinct, (n, count) = len(block.rows), block.tau.shape
    known = np.isfinite(block.tau)
    reversing = (block.reversal > REVERSAL_SHARE) & ~signals.still[:, None]
    rows = np.empty((distinct + 2 * n + 1, count))
    rows[:distinct] = block.rows
    rows[distinct : distinct + n] = block.tau_rate
    rows[distinct + n] = 1.0
    rows[distinct + n + 1 :] = block.tau
    measured = rows[distinct:]
    if not np.isfinite(measured.sum()):
        measured[~np.isfinite(measured)] = 0.0  # marked as unknown; as a number it must not spread
    picks = [
        np.append(
            block.place[item.slots], [distinct + item.row.joint, distinct + n, distinct + n + 1 + item.row.joint]
        ).astype(np.intp)
        for item in plan.rows
    ]
    return ReductionBlock(block.first, block.last, block.segment, rows, picks, known & ~reversing, known)


WAITING = 2000
"""Equations that are reduced at a time."""


class GrowingTriangle:
    """A triangle to which equations are added; they wait until there are enough of them for one QR."""

    def __init__(self, width: int) -> None:
        self.count = 0
        self.power = 0.0
        self._factor = np.zeros((width, width), order="F")
        self._reduced = False
        self._parts: list[Array] = []
        self._waiting = 0

    def add(self, system: Array) -> None:
        """Add equations, (width, m), the last row the torque; the array is the triangle's from now on."""
        self.count += system.shape[1]
        self.power += float(system[-1] @ system[-1])
        self._parts.append(system)
        self._waiting += system.shape[1]
        if self._waiting > WAITING:
            self._reduce()

    def factor(self) -> Array:
        """Return the triangle of all that was added; of few equations, these."""
        if not self._reduced:
            return np.ascontiguousarray(factor_of(np.concatenate(self._parts, axis=1).T))
        if self._waiting:
            self._reduce()
        return np.ascontiguousarray(self._factor)

    def _reduce(self) -> None:
        whole = self._parts[0] if len(self._parts) == 1 else np.concatenate(self._parts, axis=1)
        self._factor = onto(self._factor, whole.T)
        self._parts, self._waiting, self._reduced = [], 0, True


class TriangleAccumulator:
    """The triangles of a log.

    Parameters
    ----------
    layout
        Row groups and the numbers of their columns.
    instants
        Instants of the whole log.
    folds
        Contiguous stretches that it is split into.
    """

    def __init__(self, layout: Sequence[tuple[EstimationRow, NDArray[np.intp]]], instants: int, folds: int) -> None:
        self._layout = layout
        self._instants = max(instants, 1)
        self._folds = folds
        self._found: tuple[dict[tuple[EstimationRow, int], GrowingTriangle], ...] = ({}, {})

    def add(self, block: ReductionBlock) -> None:
        """Add the equations of a block."""
        fold = stretches_between(block.first, block.last, self._instants, self._folds)
        bounds = np.flatnonzero(np.diff(fold, prepend=-1, append=self._folds)).tolist()
        marks = [
            (start, found, self._marked(use, start, stop))
            for start, stop in pairwise(bounds)
            for found, use in zip(self._found, (block.use, block.known & ~block.use), strict=True)
        ]
        for (row, _), pick in zip(self._layout, block.picks, strict=True):
            system = block.rows.take(pick, axis=0)
            for start, found, marked in marks:
                chosen = marked[row.joint]
                if len(chosen):
                    whole = len(chosen) == block.instants
                    growing = found.setdefault((row, int(fold[start])), GrowingTriangle(len(pick)))
                    growing.add(system if whole else system.take(chosen, axis=1))

    @staticmethod
    def _marked(use: NDArray[np.bool_], start: int, stop: int) -> list[NDArray[np.intp]]:
        """Return the instants of a fold at which each joint's equations count."""
        return [np.flatnonzero(joint[start:stop]) + start for joint in use]

    def triangles(self) -> tuple[tuple[Triangle, ...], tuple[Triangle, ...]]:
        """Return what has grown: away from reversals, and around them."""
        index = dict(self._layout)
        steady, reversing = (
            tuple(
                Triangle(row, fold, index[row], growing.factor(), growing.count, growing.power)
                for (row, fold), growing in found.items()
            )
            for found in self._found
        )
        return steady, reversing
