"""Holes bridged, glitches taken out, both counted."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.damage import Damage
from elid_cli.logs.repair.grid import Grid, interpolate
from elid_cli.logs.repair.timeline import fill_limit
from elid_cli.memory import extremes, let_go, writable


def fill(
    signals: dict[str, Array], grid: Grid, joints: Sequence[str], repairs: list[str], sound: Collection[int] = ()
) -> list[tuple[str, int, NDArray[np.intp]]]:
    """Bridge short runs of missing samples inside a stretch; `sound` are the identities of arrays without any.

    Returns signal, joint and the samples that were bridged.
    """
    limit = fill_limit(grid.dt)
    found: list[tuple[str, int, NDArray[np.intp]]] = []
    for signal, values in list(signals.items()):
        if id(values) in sound or np.isfinite(values.sum()):
            continue
        values = signals[signal] = writable(values)
        if signal == "temperature":
            _hold(values)
            continue
        for j in range(len(joints)):
            where = np.concatenate([start + _bridge(values[start:stop, j], limit) for start, stop in grid.bounds()])
            if where.size:
                found.append((signal, j, where))
    if found:
        signal, j, where = max(found, key=lambda item: item[2].size)
        others = f", at most as many of {len(found) - 1} others" if len(found) > 1 else ""
        bridged = f"{where.size} of {signal}.{joints[j]}{others}"
        repairs.append(Damage(f"missing samples in runs of at most {limit} bridged by interpolation: {bridged}"))
    return found


def _bridge(column: Array, limit: int) -> NDArray[np.intp]:
    """Interpolate NaN runs of at most `limit` samples that have neighbours on both sides; return their samples."""
    missing = np.isnan(column)
    none = np.zeros(0, dtype=np.intp)
    if not missing.any() or missing.all():
        return none
    edges = np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    short = (stops - starts <= limit) & (starts > 0) & (stops < column.size)
    if not short.any():
        return none
    index = np.arange(column.size, dtype=float)
    runs = zip(starts[short], stops[short], strict=True)
    wanted: NDArray[np.intp] = np.concatenate([np.arange(a, b, dtype=np.intp) for a, b in runs])
    held = ~missing
    column[wanted] = interpolate(index[held], column[held][:, None], index[wanted], order=4)[:, 0]
    return wanted


def _hold(values: Array) -> None:
    """Interpolate a slow signal linearly everywhere, held at its ends."""
    index = np.arange(values.shape[0])
    for j in range(values.shape[1]):
        held = np.isfinite(values[:, j])
        if held.any():
            values[:, j] = np.interp(index, index[held], values[held, j])


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
    least, most = extremes(values)
    if not (most - least > AT_LEAST).any() or _spread(glance, least, most):
        return values
    low, high = np.quantile(glance, (0.01, 0.99), axis=0) if held.all() else np.nanpercentile(glance, [1, 99], axis=0)
    reach = BEYOND * (high - low) + AT_LEAST
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
        usual = f"(up to {worst:.4g}, the others are within {low[k]:.4g} and {high[k]:.4g})"
        repairs.append(Damage(f"{signal} of {joints[k]}: {count} broken sample{plural} left out {usual}"))
    return mended


def _spread(glance: Array, least: Array, most: Array) -> bool:
    """Whether no value of any column can be broken, told without a quantile.

    Where more than 2 % of the values lie in the lowest, and in the highest, two fifths of the range, the quantiles are
    a fifth of it apart at least, and the range is within `BEYOND` of that.
    """
    if not (np.isfinite(least).all() and np.isfinite(most).all()):
        return False
    part = 0.4 * (most - least)
    low, high = (np.count_nonzero(side, axis=0) for side in (glance <= least + part, glance >= most - part))
    return bool(min(low.min(), high.min()) > 0.02 * len(glance) + 1)


def _short(outside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the samples outside in runs of at most `LONGEST`."""
    edges = np.diff(np.concatenate([[False], outside, [False]]).astype(np.int8))
    kept = np.zeros(outside.size, dtype=bool)
    for start, stop in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        if stop - start <= LONGEST:
            kept[start:stop] = True
    return kept
