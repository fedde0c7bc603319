"""One clock's stamps made usable: ordered, without repeats, cut at gaps and jumps, and compared with an even grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.damage import Damage

Rows = NDArray[np.intp]

SNAP = 0.05
"""Stamps this near (in sample times) to an even grid are on it: quantised or float32 time."""
FILL_TIME = 0.02
"""s; missing samples are bridged over at most this long …"""
FILL_SAMPLES = 5
"""… and over at most this many."""
JUMP_PIECE = 20
"""Samples that a stretch between two backward steps needs to count as a clock that jumped."""
COARSE = 0.3
"""Share of repeated stamps above which the clock is coarse rather than some stamps repeated."""
BLOCK = 1 << 15
"""Stamps looked at at a time."""
TOGETHER, LINE = 20, 10
"""Stamps whose mean distance from a line is looked at, and how many such groups a line needs."""
FARTHEST, SHIFTED = 1.5, 0.25
"""Steps by which a stamp, and the mean of so many, may be off the line."""


@dataclass(frozen=True)
class Timeline:
    """Stamps in ascending order and the rows of the stream that they belong to."""

    t: Array
    """s, strictly ascending."""
    rows: Rows | None
    """Row of each stamp in the stream; None: all rows as they are."""
    dt: float
    """Sample time, s."""
    breaks: Rows
    """Positions in `t` where a new contiguous stretch starts (0 first)."""
    repairs: tuple[str, ...] = ()
    shifts: tuple[tuple[float, float], ...] = ()
    """(raw time, shift) of each clock jump."""
    unplaced: int = 0
    """Samples left out because their stamp is that of another, different one."""

    @property
    def segments(self) -> list[tuple[int, int]]:
        """(start, stop) of every contiguous stretch."""
        stops = np.append(self.breaks[1:], self.t.size)
        return [(int(start), int(stop)) for start, stop in zip(self.breaks, stops, strict=True)]

    def subset(self, keep: NDArray[np.bool_]) -> Timeline:
        """Return the timeline of the stream's rows where `keep` (over the stream's rows) holds."""
        rows = np.flatnonzero(keep) if self.rows is None else self.rows[keep[self.rows]]
        kept = keep if self.rows is None else keep[self.rows]
        t = self.t[kept]
        return replace(self, t=t, rows=rows, breaks=_breaks(t, self.dt)).split(self.t[self.breaks])

    def split(self, at: Array) -> Timeline:
        """Return the timeline with a new stretch at each of some times, s."""
        further = np.searchsorted(self.t, at - 0.5 * self.dt)
        return replace(self, breaks=np.union1d(self.breaks, further[further < self.t.size]).astype(np.intp))


def fill_limit(dt: float) -> int:
    """Return how many missing samples in a row are bridged at a sample time of `dt` s."""
    return max(1, min(FILL_SAMPLES, int(FILL_TIME / dt)))


def build(stamps: Array, values: Array, label: str, shifts: tuple[tuple[float, float], ...] = ()) -> Timeline | None:
    """Return the timeline of a stream, or None where its time never advances.

    Parameters
    ----------
    stamps
        Raw stamps in s, shape (N,), in the order of the file; NaN where a sample has none.
    values
        The stream's values, shape (N, k): repeated stamps with equal values are copies.
    label
        How to call the stream in the repairs.
    shifts
        Clock jumps of another stream of the log, which this one shares where it has as many.
    """
    repairs: list[str] = []
    rows: Rows | None = None
    t = stamps
    finite = np.isfinite(t)
    if not finite.all():
        repairs.append(Damage(f"{label}: {np.count_nonzero(~finite)} samples without a time left out"))
        rows = np.flatnonzero(finite)
        t = t[rows]
    if t.size < 2:
        return None
    own: tuple[tuple[float, float], ...] = ()
    least, most = step_range(t)
    if least < 0:
        t, rows, own = _ordered(t, rows, label, repairs, shifts)
        least, most = step_range(t)
    if not most > 0:
        return None
    unplaced = 0
    if least <= 0:
        t, rows, unplaced = _without_repeats(t, rows, values, label, repairs)
    if t.size < 2:
        return None
    dt = sample_time(t)
    return Timeline(t, rows, dt, _breaks(t, dt), tuple(repairs), own, unplaced)


def sample_time(t: Array) -> float:
    """Return the sample time of ascending stamps, gaps and lost samples left out; round where the stamps allow it."""
    least, most = step_range(t)
    if 0 < most < 1.4 * least:  # nothing is lost
        return _round(float(t[-1] - t[0]) / (t.size - 1), t.size)
    complete = _by_line(t)
    if complete is not None:
        return _round(complete, t.size)
    steps = np.diff(t)
    typical = float(np.median(steps[steps > 0]))
    counts = np.rint(steps / typical)
    near = counts <= 10
    slots = float(counts[near].sum())
    dt = float(steps[near].sum()) / max(slots, 1.0)
    mean = float(steps[near].mean())
    if slots < 0.8 * np.count_nonzero(near):  # stamps come in bursts: more samples than slots
        dt = mean
    return _round(dt, t.size)


def _by_line(t: Array) -> float | None:
    """Return the slope of stamps over their numbers where they only jitter about a line; None where samples are lost.

    A lost sample moves all that follow by a whole step, which the mean of some shows and jitter does not.
    """
    if t.size < LINE * TOGETHER:
        return None
    place = np.arange(t.size, dtype=float)
    place -= place.mean()
    dt = float(place @ (t - t[0])) / float(place @ place)
    left = t - t.mean() - dt * place
    whole = left[: t.size // TOGETHER * TOGETHER].reshape(-1, TOGETHER).mean(axis=1)
    still = float(np.abs(left).max()) < FARTHEST * dt and float(np.abs(whole).max()) < SHIFTED * dt
    return dt if still else None


def step_range(t: Array) -> tuple[float, float]:
    """Return the smallest and the largest step between stamps, of which there are two or more.

    A long log's stamps are looked at a block at a time: memory touched for the first time costs more than the look.
    """
    least, most = np.inf, -np.inf
    for start in range(0, t.size - 1, BLOCK):
        steps = np.diff(t[start : start + BLOCK + 1])
        least, most = min(least, float(steps.min())), max(most, float(steps.max()))
    return least, most


def _round(dt: float, samples: int) -> float:
    """Return a rate of few digits, or a period of whole µs, where the log cannot tell it from the measured one."""
    slack = 0.1 * dt / max(samples, 1) + 1e-12 * dt
    rate = 1.0 / dt
    for digits in range(1, 10):
        for candidate in (1.0 / float(f"{rate:.{digits}g}"), float(f"{dt:.{digits}g}")):
            if abs(candidate - dt) <= slack:
                return candidate
    return dt


def _breaks(t: Array, dt: float) -> Rows:
    limit = (fill_limit(dt) + 1.5) * dt
    wide = [
        np.flatnonzero(np.diff(t[start : start + BLOCK + 1]) > limit) + start + 1 for start in range(0, t.size, BLOCK)
    ]
    return np.concatenate([[0], *wide]).astype(np.intp)


def _ordered(
    t: Array, rows: Rows | None, label: str, repairs: list[str], known: tuple[tuple[float, float], ...]
) -> tuple[Array, Rows | None, tuple[tuple[float, float], ...]]:
    """Sort samples that are out of order; where the clock jumped back, keep the order and shift what follows."""
    steps = np.diff(t)
    back = np.flatnonzero(steps < 0) + 1
    forward = steps[steps > 0]
    typical = float(np.median(forward)) if forward.size else 0.0
    order = np.argsort(t, kind="stable")
    pieces = np.diff(np.concatenate([[0], back, [t.size]]))
    tight_before = np.count_nonzero(steps[steps >= 0] < 0.5 * typical)
    tight_after = np.count_nonzero(np.diff(t[order]) < 0.5 * typical)
    if np.median(pieces) >= JUMP_PIECE and tight_after > tight_before + 2 * back.size:
        shifted = t.copy()
        shifts = []
        for k, start in enumerate(back):
            raw = float(t[start])
            shift = float(shifted[start - 1]) + 1.0 - raw  # 1 s apart: what passed is not known
            if len(known) == back.size:
                shift = known[k][1]
            shifted[start:] = t[start:] + shift
            shifts.append((raw, shift))
            by, at = t[start - 1] - raw, t[start - 1] - t[0]
            repairs.append(Damage(f"{label}: the clock jumps back by {by:.6g} s at t = {at:.6g} s: split there"))
        return shifted, rows, tuple(shifts)
    repairs.append(Damage(f"{label}: {back.size} steps backwards in time: samples sorted"))
    return t[order], (order if rows is None else rows[order]), ()


def _without_repeats(
    t: Array, rows: Rows | None, values: Array, label: str, repairs: list[str]
) -> tuple[Array, Rows, int]:
    """Leave out copies of a stamp; spread the samples where the clock is coarser than they are."""
    if rows is None:
        rows = np.arange(t.size)
    repeated = np.flatnonzero(np.diff(t) <= 0) + 1
    now, before = values[rows[repeated]], values[rows[repeated - 1]]
    copies = ((now == before) | (np.isnan(now) & np.isnan(before))).all(axis=1)
    if repeated.size > COARSE * t.size and np.count_nonzero(~copies) > 0.5 * repeated.size:
        even = _spread(t)
        if (np.diff(even) > 0).all():
            repairs.append(f"{label}: {repeated.size} repeated stamps: the clock is coarse, samples spread evenly")
            return even, rows, 0
    keep = np.ones(t.size, dtype=bool)
    keep[repeated] = False
    different = np.count_nonzero(~copies)
    what = f", {different} of them with other values" if different else ""
    repairs.append(Damage(f"{label}: {repeated.size} samples with a repeated stamp left out{what}"))
    return t[keep], rows[keep], int(different)


def _spread(t: Array) -> Array:
    """Space the samples evenly within every stretch of a coarse clock."""
    ticks = np.flatnonzero(np.diff(t, prepend=t[0] - 1) > 0)
    pace = np.diff(t[ticks])
    gaps = ticks[1:][pace > 3 * np.median(pace)] if pace.size else ticks[:0]
    bounds = np.concatenate([[0], gaps, [t.size]])
    even = t.copy()
    for start, stop in pairwise(bounds):
        count = np.arange(stop - start)
        if count.size > 2:
            slope, level = np.polyfit(count, t[start:stop], 1)
            even[start:stop] = level + slope * count
    return even
