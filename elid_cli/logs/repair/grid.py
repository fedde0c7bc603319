"""Stamps against an even grid; local polynomial interpolation onto it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.timeline import BLOCK, SNAP, Timeline

POINTS = 1 << 15
"""Points interpolated at once, to bound memory."""


def interpolate(t: Array, values: Array, at: Array, *, order: int = 6) -> Array:
    """Return values at other times by Lagrange polynomials through the `order` nearest samples.

    Parameters
    ----------
    t
        Times of the samples, s, strictly ascending, shape (N,).
    values
        Samples, shape (N, k), finite.
    at
        Times wanted, shape (M,), within `t` (or at most a sample outside).
    order
        Samples per polynomial: 6 for even spacing, 4 where the spacing is uneven (less noise gain).

    Returns
    -------
    Shape (M, k).
    """
    order = min(order, t.size)
    result = np.empty((at.size, values.shape[1]))
    for start in range(0, at.size, POINTS):
        points = at[start : start + POINTS]
        first = np.clip(np.searchsorted(t, points) - order // 2, 0, t.size - order)
        nodes = t[first[:, None] + np.arange(order)]
        block = np.zeros((points.size, values.shape[1]))
        for j in range(order):
            weight = np.ones(points.size)
            for m in range(order):
                if m != j:
                    weight *= (points - nodes[:, m]) / (nodes[:, j] - nodes[:, m])
            block += weight[:, None] * values[first + j]
        result[start : start + POINTS] = block
    return result


OFFSET = 2e-3
"""Sample times by which two streams may be apart and still count as sampled together."""
LONGEST_GAP = 1e6
"""s; a longer gap is a clock that was set, and is shown as 1 s."""
JUDGED = 20_000
"""Samples by which jitter of the stamps is told from jitter of the sampling."""
SMOOTHER = 0.8
"""Roughness ratio below which evenly spaced samples explain the log better than the stamps do."""


@dataclass(frozen=True)
class Grid:
    """Even segments of time: start in s and number of samples each, `dt` s apart."""

    dt: float
    starts: tuple[float, ...]
    counts: tuple[int, ...]

    @property
    def samples(self) -> int:
        """Samples of all segments."""
        return sum(self.counts)

    def bounds(self) -> list[tuple[int, int]]:
        """Return (start, stop) of each stretch among all samples."""
        stops = np.cumsum(self.counts).tolist()
        return list(zip([0, *stops[:-1]], stops, strict=True))

    def shortened(self) -> Grid:
        """Return the grid with absurd gaps (a clock set while recording) made short, so that time keeps its digits."""
        starts = [0.0]
        for k in range(1, len(self.starts)):
            length = (self.counts[k - 1] - 1) * self.dt
            gap = self.starts[k] - self.starts[k - 1] - length
            starts.append(starts[-1] + length + (gap if gap < LONGEST_GAP else 1.0))
        return Grid(self.dt, tuple(starts), self.counts)

    def times(self) -> Array:
        """Return the time of every sample, s, shape (N,)."""
        t = np.empty(self.samples)
        for (first, stop), start in zip(self.bounds(), self.starts, strict=True):
            _fill_evenly(t[first:stop], start, self.dt)
        return t


def regularised(line: Timeline, values: Array, label: str) -> Timeline:
    """Return the timeline with stamps moved onto an even grid where they only jitter about one.

    `values` (the stream's rows, positions if possible) tell jitter of the stamps from jitter of the sampling:
    a joint moves smoothly, so the reading under which it does is the right one.
    """
    t = line.t.copy()
    worst = 0.0
    evened = False
    for start, stop in line.segments:
        if stop - start < 3:
            continue
        piece = line.t[start:stop]
        if _evened(piece, line.dt, t[start:stop]):
            continue
        slots, phase, jitter = _slots(piece, line.dt)
        even = phase + slots * line.dt
        ascending = bool((np.diff(slots) > 0).all())
        if ascending and np.abs(piece - even).max() <= SNAP * line.dt:
            t[start:stop] = even
            continue
        worst = max(worst, jitter)
        rows = values[start:stop] if line.rows is None else values[line.rows[start:stop]]
        if not ascending:
            slots = np.arange(stop - start, dtype=float)
            even = phase + slots * line.dt
            if abs(float(piece[-1] - even[-1])) > 2.5 * line.dt:  # not one sample per slot either
                continue
        if _stamps_jitter(piece, even, slots, rows, line.dt):
            t[start:stop] = even
            evened = True
    said = line.repairs
    if worst:
        how = "taken as evenly spaced, which makes the motion smoother" if evened else "interpolated to even times"
        said = (*said, f"{label}: stamps jitter by {worst * 1e3:.3g} ms rms about {1 / line.dt:.5g} Hz: {how}")
    return replace(line, t=t, repairs=said)


def _evened(t: Array, dt: float, out: Array) -> bool:
    """Write stamps that lie on an even grid, one to every slot, moved onto it; return whether they do.

    It is what `_slots` leads to in that case, with little memory touched.
    """
    low, high, total = np.inf, -np.inf, 0.0
    for start in range(0, t.size, BLOCK):
        part = t[start : start + BLOCK]
        apart = part - (t[0] + dt * np.arange(start, start + part.size))
        low, high, total = min(low, float(apart.min())), max(high, float(apart.max())), total + float(apart.sum())
    mean = total / t.size
    if not max(high - mean, mean - low, high, -low) <= SNAP * dt:
        return False
    _fill_evenly(out, t[0] + mean, dt)
    return True


def _fill_evenly(out: Array, start: float, dt: float) -> None:
    for first in range(0, out.size, BLOCK):
        part = out[first : first + BLOCK]
        np.multiply(dt, np.arange(first, first + part.size), out=part)
        part += start


def _slots(t: Array, dt: float) -> tuple[Array, float, float]:
    """Return the grid slot of every stamp, the grid's phase (s) and the rms distance from it (s)."""
    slots = np.rint((t - t[0]) / dt)
    for _ in range(2):
        phase = float(np.mean(t - slots * dt))
        slots = np.rint((t - phase) / dt)
    phase += float(slots[0]) * dt
    slots = slots - slots[0]
    return slots, phase, float(np.std(t - phase - slots * dt))


def _stamps_jitter(t: Array, even: Array, slots: Array, values: Array, dt: float) -> bool:
    """Whether the motion is smoother on the even times than on the stamps."""
    t, even, slots, values = t[:JUDGED], even[:JUDGED], slots[:JUDGED], values[:JUDGED]
    if t.size < 50 or not (np.diff(slots) == 1).all() or not np.isfinite(values).all():
        return False
    points = even[2:-2]
    points = points[(points >= t[0]) & (points <= t[-1])]
    spaced = np.concatenate([[True], np.diff(t) > 0.25 * dt])
    moved = interpolate(t[spaced], values[spaced], points, order=4)
    as_stamped = np.diff(moved, 3, axis=0).std(axis=0)
    as_even = np.diff(values, 3, axis=0).std(axis=0)
    known = as_stamped > 0
    if not known.any():
        return False
    return bool(np.median(as_even[known] / as_stamped[known]) < SMOOTHER)


def grid_of(line: Timeline) -> Grid:
    """Return the even grid that a regularised timeline spans."""
    starts, counts = [], []
    for start, stop in line.segments:
        span = (line.t[stop - 1] - line.t[start]) / line.dt
        starts.append(float(line.t[start]))
        counts.append(int(np.floor(span + SNAP)) + 1)
    return Grid(line.dt, tuple(starts), tuple(counts))


def identical(line: Timeline, grid: Grid) -> bool:
    """Whether the stream's rows, as they are, are the grid's samples."""
    return (
        line.rows is None
        and len(grid.counts) == 1
        and grid.counts[0] == line.t.size
        and _fills(line.t, grid.starts[0], grid.dt)
    )


def onto(grid: Grid, line: Timeline, values: Array, *, held: bool = False) -> tuple[Array, bool]:
    """Return a stream's values on a grid, NaN where it has none, shape (N, k), and whether it was interpolated.

    A `held` stream keeps each value until the next one.
    """
    result = np.full((grid.samples, values.shape[1]), np.nan)
    interpolated = False
    segments = line.segments
    begins = np.array([line.t[begin] for begin, _ in segments])
    ends = np.array([line.t[stop - 1] for _, stop in segments])
    for (first, last), start, count in zip(grid.bounds(), grid.starts, grid.counts, strict=True):
        target = result[first:last]
        end = start + (count - 1) * grid.dt
        near = slice(  # segments are in order of time, and there may be thousands of them
            int(np.searchsorted(ends, start - 4 * line.dt)),
            int(np.searchsorted(begins, end + 4 * line.dt, side="right")),
        )
        for begin, stop in segments[near]:
            low = begin + int(np.searchsorted(line.t[begin:stop], start - 4 * line.dt))
            high = begin + int(np.searchsorted(line.t[begin:stop], end + 4 * line.dt, side="right"))
            if high <= low:
                continue
            t = line.t[low:high]
            rows = slice(low, high) if line.rows is None else line.rows[low:high]
            slots = _on_grid(t, start, grid.dt) if line.dt < 1.5 * grid.dt else None
            if slots is not None:
                inside = (slots >= 0) & (slots < count)
                target[slots[inside]] = values[rows][inside]
            elif high - low >= 2:
                interpolated = True
                (_hold if held else _interpolate)(target, start, grid.dt, t, values[rows], line.dt)
    return result, interpolated


def _fills(t: Array, start: float, dt: float) -> bool:
    """Whether stamps are the first slots of a grid, one after the other (`_on_grid`)."""
    worst, total = 0.0, 0.0
    for first in range(0, t.size, BLOCK):
        apart = (t[first : first + BLOCK] - start) / dt - np.arange(first, min(first + BLOCK, t.size))
        worst, total = max(worst, float(np.abs(apart).max())), total + float(apart.sum())
    return worst <= SNAP and abs(total / t.size) <= OFFSET


def _on_grid(t: Array, start: float, dt: float) -> NDArray[np.intp] | None:
    """Return the slots of stamps that lie on the grid, or None."""
    exact = (t - start) / dt
    slots = np.rint(exact)
    apart = exact - slots
    if np.abs(apart).max() > SNAP or abs(float(apart.mean())) > OFFSET or not (np.diff(slots) > 0).all():
        return None
    return slots.astype(np.intp)


def _hold(target: Array, start: float, dt: float, t: Array, values: Array, own_dt: float) -> None:
    """Fill the rows of `target` from the first sample to one sample time after the last one with the last value."""
    at = start + dt * np.arange(target.shape[0])
    index = np.searchsorted(t, at + SNAP * dt, side="right") - 1
    inside = (index >= 0) & (at <= t[-1] + own_dt)
    target[inside] = values[index[inside]]


def _interpolate(target: Array, start: float, dt: float, t: Array, values: Array, own_dt: float) -> None:
    """Fill the rows of `target` that lie between the first and the last sample."""
    first = max(0, int(np.ceil((t[0] - start) / dt - 1e-6)))
    last = min(target.shape[0] - 1, int(np.floor((t[-1] - start) / dt + 1e-6)))
    if last < first:
        return
    steps = np.diff(t)
    even = bool((np.abs(steps - own_dt) < 0.2 * own_dt).all())
    if not even:
        spaced = np.concatenate([[True], steps > 0.25 * own_dt])  # near twins would amplify noise
        t, values = t[spaced], values[spaced]
    at = start + dt * np.arange(first, last + 1)
    target[first : last + 1] = interpolate(t, values, at, order=6 if even else 4)
