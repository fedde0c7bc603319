"""A block of a log as its reduction takes it: what stands in a row group picked by number, marks of what counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.regression.filtered_rows import Block
from elid_cli.estimation.regression.observation import REVERSAL_SHARE
from elid_cli.model.regressor import Plan
from elid_cli.signals.signals import Signals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kept:
    """Rows of a block, each once: the program's outputs, n rates of torque, ones, n torques.

    `picks` names, for every row group, its columns among them, then those of the delay and offset of its torque
    channel, and last its torque.
    """

    first: int
    last: int
    stretch: int
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

    def single(self) -> Kept:
        """Return the block in single precision, which takes half the room."""
        return replace(self, rows=self.rows.astype(np.float32))


def kept(block: Block, plan: Plan, signals: Signals) -> Kept:
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
    return Kept(block.first, block.last, block.stretch, rows, picks, known & ~reversing, known)
