"""Steps that the sampled motion cannot make: readings that drop out and come back, positions that jump and stay.

A joint does not leave its path for a few samples and return to it. Two steps of opposite sign, each many times what
the steps around it differ by, after which the motion goes on as before them, enclose readings that are none: a drive
that answers 0, a frame that was lost and filled. They lie within the range of the motion, so no limit on values finds
them, yet a dozen in ten thousand samples look like a resonance or move a mass by many standard errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.scattered import bridged, scattered
from elid_cli.memory import let_go

Rows = NDArray[np.intp]

RATIO = 12.0
"""Times the spread of the steps around it by which a step is impossible: noise and impacts stay below."""
LATE = 0.15
"""Share of the usual step within which a step of none or a few of them is a row that came late or twice: a fault of
time, not of place …"""
MOST_LATE = 5
"""… and of how many of them at most."""
AROUND = 5
"""Steps on either side that tell what a step may be."""
LONGEST = 0.1
"""s; readings that stay away longer are another fault (`stuck.frozen`)."""
FEWEST = 3
"""Samples that may drop out together at any rate."""
RETURNED = 0.2
"""Share of a step by which the motion after it may miss the motion before it."""
STAYED = 20.0
"""Times the largest usual step (99.9 %) from which one that does not come back is no motion."""
TURNS = (2 * np.pi, 360.0)
"""Steps that are an angle's own wrap."""
BLOCK = 1 << 16
"""Rows looked at at a time."""
WINDOWS = 64
"""Places, evenly taken, that tell usual steps."""
SUSPECT = 8.0
"""Times the 70 % quantile of second differences from which a place is looked at closely."""
DENSE = 0.02
"""Share of zeros between other values from which the steps around them tell nothing."""
FINEST = 1e-9
"""Share of the largest value below which differences are rounding."""


@dataclass(frozen=True)
class Impossible:
    """What the motion of one column cannot have done."""

    rows: Rows
    """Samples that dropped out."""
    largest: float = 0.0
    """How far they are from the motion, at most."""
    jumps: tuple[tuple[int, float], ...] = ()
    """(first sample after it, size) of steps that do not come back."""


def impossible(values: Array, dt: float, *, jumpy: bool = False) -> dict[int, Impossible]:
    """Return what is impossible, by column; columns without anything are left out.

    Parameters
    ----------
    values
        One contiguous stretch in order of time, shape (N, k); NaN where a sample is missing.
    dt
        Sample time, s.
    jumpy
        Whether the signal may truly jump, as torque does: then only a few readings of exactly 0 count as dropped out.
    """
    if values.shape[0] < 4 * AROUND:
        return {}
    usual: list[_Usual] = []
    places: list[list[Rows]] = [[] for _ in range(values.shape[1])]
    if not _calm(values):
        usual = _Usual.of_columns(_glance(values))
        limits = np.array([SUSPECT * one.bend + one.finest for one in usual])
        for start in range(0, values.shape[0] - 2, BLOCK):
            suspects = np.abs(np.diff(values[start : start + BLOCK + 2], 2, axis=0)) > limits
            for k in np.flatnonzero(suspects.any(axis=0)).tolist():
                places[k].append(np.flatnonzero(suspects[:, k]) + start)
            let_go(values)
    longest = FEWEST if jumpy else max(FEWEST, int(LONGEST / dt))
    found: dict[int, Impossible] = {}
    for k, parts in enumerate(places):
        zeros = None if jumpy else _zeros(values[:, k], longest)
        if zeros is not None:
            found[k] = zeros
        elif parts:
            found[k] = _all_of(values[:, k], np.concatenate(parts), usual[k], longest, jumpy)
    let_go(values)
    return {k: what for k, what in found.items() if what.rows.size or what.jumps}


def _calm(values: Array) -> bool:
    """Whether a short stretch has no suspicious second difference, told without any quantile.

    Where more than half of all are within `SUSPECT` of the largest, so is their 70 % quantile.
    """
    if values.shape[0] > BLOCK // WINDOWS:
        return False
    bends = np.abs(np.diff(values, 2, axis=0))
    near = np.count_nonzero(SUSPECT * bends >= bends.max(axis=0), axis=0)  # none where a sample is missing
    return bool(near.min() > len(bends) / 2)


@dataclass(frozen=True)
class _Usual:
    bend: float
    """70 % quantile of second differences."""
    step: float
    """99.9 % quantile of steps."""
    finest: float
    """Twice the finest step."""

    @staticmethod
    def of_columns(seen: Array) -> list[_Usual]:
        """Return what is usual in some windows of every column, shape (k, windows, samples)."""
        bends, steps = (np.abs(np.diff(seen, n, axis=2)).reshape(len(seen), -1) for n in (2, 1))
        largest = np.abs(seen).max(axis=(1, 2))  # NaN where a sample is missing
        if not (steps.min(axis=1, initial=np.inf) > FINEST * largest).all() or not bends.size:
            return [_Usual._of(*column) for column in zip(seen, bends, steps, strict=True)]
        fine, coarse = np.quantile(steps, (0.02, 0.999), axis=1)  # as good as every log: all columns at once
        bend = np.quantile(bends, 0.7, axis=1)
        return [_Usual(*sizes) for sizes in zip(bend.tolist(), coarse.tolist(), (2 * fine).tolist(), strict=True)]

    @staticmethod
    def _of(seen: Array, bends: Array, steps: Array) -> _Usual:
        """Return the same for one column that pauses or lacks samples."""
        bends, steps = bends[np.isfinite(bends)], steps[np.isfinite(steps)]
        if not bends.size:
            return _Usual(np.inf, np.inf, 0.0)
        moved = steps[steps > FINEST * float(np.nanmax(np.abs(seen)))]
        fine = np.quantile(moved, 0.02) if moved.size else 0.0
        return _Usual(float(np.quantile(bends, 0.7)), float(np.quantile(steps, 0.999)), 2 * float(fine))


def _glance(values: Array) -> Array:
    """Return evenly taken windows of every column, shape (k, windows, samples)."""
    length = min(values.shape[0], BLOCK // WINDOWS)
    starts = np.unique(np.linspace(0, values.shape[0] - length, WINDOWS).astype(int))
    seen = np.stack([values[start : start + length] for start in starts])
    let_go(values)
    return np.moveaxis(seen, 2, 0)


def _zeros(column: Array, longest: int) -> Impossible | None:
    """Return the zeros among other values where they are so many that they hide the motion; else None."""
    none = column == 0.0
    if not DENSE * column.size < np.count_nonzero(none) < (1 - DENSE) * column.size:
        return None
    edges = np.diff(none.astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) + 1
    stops = stops[stops > starts[0]] if starts.size else stops[:0]
    starts = starts[: stops.size]
    if not starts.size:
        return None
    before, after = column[starts], column[stops]
    steps = np.abs(np.diff(column))[~none[1:] & ~none[:-1]]
    steps = steps[np.isfinite(steps)]
    usual = float(np.median(steps)) if steps.size else np.inf
    far = np.minimum(np.abs(before), np.abs(after)) > RATIO * (stops - starts) * usual
    far &= (np.abs(after - before) < RETURNED * np.abs(before)) & (stops - starts - 1 <= longest)
    rows = [np.arange(start + 1, stop) for start, stop in zip(starts[far], stops[far], strict=True)]
    if sum(part.size for part in rows) < DENSE * column.size:
        return None
    return Impossible(np.concatenate(rows), float(np.abs(before[far]).max()))


def _all_of(column: Array, bends: Rows, usual: _Usual, longest: int, jumpy: bool) -> Impossible:
    """Return what is impossible where suspicious bends are; runs that lie about first, so that they hide nothing."""
    rows = bends[:0] if jumpy else scattered(column, longest, RATIO * usual.finest, TURNS)
    if not rows.size:
        return _judged(column, bends, usual, longest, jumpy)
    sound = bridged(column, rows)
    rest = _judged(sound, bends, usual, longest, jumpy)
    largest = max(rest.largest, float(np.abs(column - sound).max()))
    return Impossible(np.union1d(rest.rows, rows), largest, rest.jumps)


def _judged(column: Array, bends: Rows, usual: _Usual, longest: int, jumpy: bool) -> Impossible:
    """Look closely at the steps around suspicious bends (step k leads from sample k to k + 1)."""
    steps = np.diff(column)
    at = np.unique(np.concatenate([bends, bends + 1]))
    around = steps[np.clip(at[:, None] + np.delete(np.arange(-AROUND, AROUND + 1), AROUND), 0, steps.size - 1)]
    known = np.isfinite(around).all(axis=1) & np.isfinite(steps[at])
    at, around = at[known], around[known]
    middle = np.median(around, axis=1)
    spread = np.sort(np.abs(around - middle[:, None]), axis=1)[:, -4]  # one dropout beside it brings three odd steps
    away = steps[at] - middle
    single = at[:0] if jumpy else _single(column, at + 1, middle, usual.finest)
    strange = (np.abs(away) > RATIO * (spread + usual.finest)) & ~_late(steps[at], middle)
    for turn in TURNS:
        strange &= np.abs(np.abs(away) - turn) > 0.05 * turn
    at, away, middle = at[strange], away[strange], middle[strange]
    rows: list[Rows] = []
    jumps: list[tuple[int, float]] = []
    largest, k = float(np.abs(column[single] - column[single - 1]).max(initial=0.0)), 0
    while k < at.size:
        back = _back(column, at, away, middle, k, longest)
        if back is None:
            hung = not steps[max(0, int(at[k]) - AROUND) : int(at[k])].any()  # another fault (`stuck.frozen`)
            if not jumpy and not hung and abs(away[k]) > STAYED * usual.step:
                jumps.append((int(at[k]) + 1, float(away[k])))
            k += 1
            continue
        inside = slice(int(at[k]) + 1, int(at[back]) + 1)
        if not jumpy or not column[inside].any():
            rows.append(np.arange(inside.start, inside.stop))
            largest = max(largest, abs(float(away[k])))
        k = back + 1
    left_out = np.unique(np.concatenate([single, *rows])).astype(np.intp)
    return Impossible(left_out, largest, tuple(jumps))


def _late(step: Array, usual: Array) -> NDArray[np.bool_]:
    """Whether steps are whole multiples of the usual one."""
    times = np.clip(np.divide(step, usual, out=np.full(step.shape, -1.0), where=usual != 0), -1, MOST_LATE + 1)
    return np.asarray((np.abs(times - np.rint(times)) < LATE) & (times > -LATE) & (times < MOST_LATE + LATE))


NODES = np.array([-2, -1, 1, 2])
CUBIC = np.array([-1.0, 4.0, 4.0, -1.0]) / 6
"""The cubic through the samples `NODES` away, at the sample between them."""
BESIDE = np.array([-6, -5, -4, -3, 3, 4, 5, 6])
"""Places beside a sample whose own distance from such a cubic does not know of it."""


def _single(column: Array, at: Rows, pace: Array, finest: float) -> Rows:
    """Return which of some samples, with the usual step there, the cubic through their neighbours leaves far outside.

    For one sample this is more sensitive than steps where the motion is fast. A kink (an impact) is told by the samples
    beside it, which fit no better once the sample is replaced.
    """
    inner = (at >= 8) & (at < column.size - 8)
    at, pace = at[inner], pace[inner]
    if not at.size:
        return at

    def off(places: Rows) -> Array:
        return np.asarray(column[places] - column[places[..., None] + NODES] @ CUBIC)

    apart = off(at)
    usual = np.sort(np.abs(off(at[:, None] + BESIDE)), axis=1)[:, 3] + finest
    chosen = np.abs(apart) > RATIO * usual
    for own in (pace, 0.5 * (column[at + 1] - column[at - 1])):
        chosen &= ~_late(column[at] - column[at - 1], own)
    before, after = off(at - 1) + CUBIC[2] * apart, off(at + 1) + CUBIC[1] * apart
    chosen &= np.maximum(np.abs(before), np.abs(after)) < np.abs(apart) / RATIO + finest
    return np.asarray(at[chosen])


def _back(column: Array, at: Rows, away: Array, middle: Array, k: int, longest: int) -> int | None:
    """Return which later step leads back onto the motion that step `k` has left; None where none does in time."""
    for other in range(k + 1, at.size):
        length = int(at[other] - at[k])
        if length > longest:
            return None
        expected = column[at[k]] + (length + 1) * 0.5 * (middle[k] + middle[other])
        missed = abs(float(column[at[other] + 1] - expected))
        if away[k] * away[other] < 0 and missed < RETURNED * abs(away[k]):
            return other
    return None
