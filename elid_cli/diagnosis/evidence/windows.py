"""Whether an effect that acts for a moment stands out from what is left at all other moments.

A push from outside happens once. Where the rest of the log holds residuals of the same size that nothing explains, the
moment is one of many, and a name for it alone would be a wrong one: a stop that is touched at every pass, a friction
that builds up at every reversal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.fit.state import State, without
from elid_cli.estimation.regression.covariance import residuals

Array = NDArray[np.float64]

ACTS = 0.01
"""Part of its largest power from which an effect acts."""
MOMENT = 0.25
"""Part of the log up to which an effect is one of a moment."""
STANDS_OUT = 1.5
"""Ratio of its residual to that of any other moment of the same length."""


def acting(state: State, number: int) -> NDArray[np.bool_]:
    """Return the instants at which an effect acts, (M,)."""
    size = np.zeros(state.log.observation.instants)
    for row, values in state.columns[number].rows.items():
        power = np.sum(values**2, axis=0) * state.log.observation.group(row).use
        size = np.maximum(size, power / max(float(power.max(initial=0.0)), 1e-300))
    return size > ACTS


def one_of_many(state: State, number: int) -> bool:
    """Whether effect `number` takes from a moment what other moments hold unexplained, too."""
    inside = acting(state, number)
    length = int(np.count_nonzero(inside))
    if not 0 < length < MOMENT * len(inside):
        return False
    lacking = without(state, number)
    before = residuals(lacking.log.observation, lacking.solution.values, lacking.extras)
    after = residuals(state.log.observation, state.solution.values, state.extras)
    ratios = []
    for row in state.columns[number].rows:
        if row not in state.triangles.rows:
            continue
        key, use = (row.kind, row.joint), state.log.observation.group(row).use
        unit = max(state.floor.rms[row], 1e-4 * state.triangles.torque_rms(row))
        own = float(np.sqrt(np.mean(np.square(before[key][inside & use])))) if (inside & use).any() else 0.0
        others = _windows(np.square(after[key]), use & ~inside, length)
        ratios.append(own / max(float(np.sqrt(others)), unit))
    return bool(ratios) and max(ratios) < STANDS_OUT


def _windows(squares: Array, use: NDArray[np.bool_], length: int) -> float:
    """Return the largest mean of squares over windows of `length` instants that are used at least by half."""
    window = np.ones(length)
    count = np.convolve(use.astype(float), window, mode="valid")
    total = np.convolve(np.where(use, squares, 0.0), window, mode="valid")
    full = count >= 0.5 * length
    return float(np.max(total[full] / count[full], initial=0.0))
