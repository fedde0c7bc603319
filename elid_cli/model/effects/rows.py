"""Where columns go: the motor row, the link row, or both rows of a transmission with opposite signs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns
from elid_cli.model.effects.scene import EquationRow

# np.array, not np.stack: the same rows in a tenth of the time where a simulator asks for one instant


def motor_row(joint: int, *columns: Array) -> Columns:
    """Return columns (N,) that act on the motor of `joint`."""
    return {EquationRow("motor", joint): np.array(columns)}


def link_row(joint: int, *columns: Array) -> Columns:
    """Return columns (N,) that act on the link of `joint`."""
    return {EquationRow("link", joint): np.array(columns)}


def spring_rows(joint: int, *columns: Array) -> Columns:
    """Return columns (N,) of a torque in the transmission, positive where it pulls the link back to the motor."""
    stacked = np.array(columns)
    return {EquationRow("link", joint): stacked, EquationRow("motor", joint): -stacked}


def derivative(values: Array, dt: float, starts: Sequence[int] = (0,)) -> Array:
    """Return the time derivative of samples (N,) or (N, n) by central differences, segment by segment.

    Segments of fewer than three samples get 0.
    """
    rate = np.zeros_like(values)
    bounds = [*sorted(set(starts) | {0}), len(values)]
    for start, stop in pairwise(bounds):
        if stop - start >= 3:
            rate[start:stop] = np.gradient(values[start:stop], dt, axis=0, edge_order=2)
    return rate
