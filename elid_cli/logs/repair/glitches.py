"""Broken samples: single values far outside everything else that a signal does are taken as missing, and counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.mapped import extremes, let_go

Array = NDArray[np.float64]

JUDGED = ("q", "theta", "tau")
LOOKED_AT = 10_000
"""Samples (evenly taken) that tell the usual range."""
BEYOND = 10.0
"""Widths of the usual range by which a broken sample lies outside it …"""
AT_LEAST = 1.0
"""… and at least this much, in SI units."""
LONGEST = 3
"""Samples in a row that may be broken; what lasts longer is motion."""


def without_glitches(signal: str, joints: Sequence[str], values: Array, repairs: list[str]) -> Array:
    """Return the values, shape (N, k), with broken samples as NaN; the array itself where there are none."""
    if signal not in JUDGED or values.shape[0] < 2 * LONGEST:
        return values
    glance = values[:: max(1, values.shape[0] // LOOKED_AT)].copy()
    let_go(values)
    held = np.isfinite(glance)
    if not held.any(axis=0).all():
        return values
    usual: Array = np.percentile(glance, [1, 99], axis=0) if held.all() else np.nanpercentile(glance, [1, 99], axis=0)
    low, high = usual[0], usual[1]
    reach = BEYOND * (high - low) + AT_LEAST
    least, most = extremes(values)
    suspects = np.flatnonzero((least < low - reach) | (most > high + reach))
    mended = values
    for k in suspects.tolist():
        column = values[:, k]
        broken = _short((column < low[k] - reach[k]) | (column > high[k] + reach[k]))
        count = int(np.count_nonzero(broken))
        if not count:
            continue
        if mended is values:
            mended = values.copy()
        worst = float(column[broken][np.argmax(np.abs(column[broken]))])
        mended[broken, k] = np.nan
        plural = "s" * (count > 1)
        repairs.append(
            f"{signal} of {joints[k]}: {count} broken sample{plural} left out "
            f"(up to {worst:.4g}, the others are within {low[k]:.4g} and {high[k]:.4g})"
        )
    return mended


def _short(outside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the samples outside in runs of at most `LONGEST`."""
    edges = np.diff(np.concatenate([[False], outside, [False]]).astype(np.int8))
    kept = np.zeros(outside.size, dtype=bool)
    for start, stop in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        if stop - start <= LONGEST:
            kept[start:stop] = True
    return kept
