"""Stretches with the drives off: no joint has any torque, and the brakes stop the robot, or hold it.

What brakes do is no motor's torque. A third of a second of an emergency stop in a log bends every parameter: there,
the masses decelerate and nothing is logged that makes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.grid import Grid
from elid_cli.memory import let_go, passed

FAINT = 0.02
"""Share of a joint's rms torque within which it counts as none …"""
NOISES = 5.0
"""… or this many standard deviations of its noise, if that is more …"""
LOUDEST = 0.2
"""… but at most this share."""
LOOKED_AT = 50_000
"""Samples that tell noise and the usual steps."""
FEWEST, SHORTEST = 8, 0.03
"""Samples, and s, of the shortest stretch."""
SUDDEN = 3.0
"""Times the usual step within `EDGE` by which a torque falls away, or comes back."""
USUAL = 95
"""Percentile of steps that is a usual one."""
EDGE = 0.01
"""s in which a drive's current decays; as much beside a stretch is left out, too."""
PACE = 0.05
"""s over which a joint at rest moves a small part of what it moves elsewhere …"""
STILL = 0.03
"""… at most this much of it."""
BESIDE_NOISE = 8.0
"""The same in standard deviations of the positions' noise."""
FEW = 200
"""Samples that tell which side of a joint is known."""
LONGEST = 1.0
"""s that brakes take at most: what moves for longer without torque swings."""
COASTS = 0.1
"""Share of the motion with torque that stops may take: where more of it is without, that is how the motion was made."""
NAMED = 3
"""Stretches that are named."""


def drives_off(
    signals: Mapping[str, Array], grid: Grid, known: NDArray[np.bool_], t: Array, repairs: list[str]
) -> NDArray[np.bool_]:
    """Return `known`, (N,), without the samples at which the drives are off and brakes stop or hold the robot.

    `signals` are on the grid, (N, n) each; `t` are its times, s, (N,), as they are shown.
    """
    torque = signals.get("tau")
    if torque is None:
        return known
    found = [_widened(stretch, grid) for stretch in _stops(signals, torque, grid)]
    if not found:
        return known
    known = known.copy()
    spans = []
    for start, stop in found:
        known[start:stop] = False
        spans.append(f"{(stop - start) * grid.dt:.3g} s from t = {t[start]:.5g} s")
    more = f" and {len(spans) - NAMED} more times" if len(spans) > NAMED else ""
    repairs.append(
        f"no joint has any torque for {', '.join(spans[:NAMED])}{more}, where the robot comes to rest or stands: taken "
        "as a stop by brakes with the drives off, left out"
    )
    return known


def _stops(signals: Mapping[str, Array], torque: Array, grid: Grid) -> list[tuple[int, int]]:
    """Return the stretches (start, stop) with the drives off."""
    length = max(FEWEST, round(SHORTEST / grid.dt))
    rms = _rms(torque)
    glance = torque[::length]  # every stretch holds one of these samples
    if not np.isfinite(rms).any() or not _runs(_without(torque, LOUDEST * rms, glance), grid, length):
        return []
    faint, least = _sizes(torque, rms, grid)
    places = _positions(signals)
    runs = [run for run in _runs(_without(torque, faint), grid, length) if _sudden(torque, run, least, grid)]
    if not runs or not places:
        return []
    far = _pace(places, grid)
    within = round(LONGEST / grid.dt)
    held, stopped, braked = list[tuple[int, int]](), list[tuple[int, int]](), 0
    for run in runs:
        moves = _moving(places, run, far, grid)
        if moves == 0 and any(_stands(places, row, far, grid) for row in _sudden(torque, run, least, grid)):
            held.append(run)
        elif 0 < moves <= within:
            stopped.append(run)
            braked += moves
    if braked > COASTS * _driven(places, torque, faint, far, grid):
        stopped = []
    return sorted([*held, *stopped])


def _rms(torque: Array) -> Array:
    """Return the rms of every joint's torque, (n,); NaN where a joint has none."""
    rows = np.nan_to_num(torque[:: max(1, len(torque) // LOOKED_AT)])
    let_go(torque)
    rms = np.sqrt(np.mean(rows**2, axis=0))
    rms[~(rms > 0)] = np.nan
    return np.asarray(rms)


def _sizes(torque: Array, rms: Array, grid: Grid) -> tuple[Array, Array]:
    """Return the torque of every joint that counts as none, and that from which it falls away at once, (n,) each.

    NaN where a joint has no torque.
    """
    start, stop = max(grid.bounds(), key=lambda bounds: bounds[1] - bounds[0])
    part = np.nan_to_num(torque[start : min(stop, start + LOOKED_AT)])
    lag = _edge(grid)
    if len(part) < 4 * lag:
        return np.full_like(rms, np.nan), rms
    # third differences of white noise are sqrt(20) times as large, those of a motion are next to nothing
    noise = np.median(np.abs(np.diff(part, 3, axis=0)), axis=0) / (0.6745 * np.sqrt(20.0))
    faint = np.clip(NOISES * noise, FAINT * rms, LOUDEST * rms)
    usual = np.percentile(np.abs(part[lag:] - part[:-lag]), USUAL, axis=0)
    let_go(torque)
    return faint, faint + SUDDEN * usual


def _without(torque: Array, faint: Array, glance: Array | None = None) -> NDArray[np.bool_]:
    """Return where no joint has any torque, (N,); nowhere where that is so of no sample of a `glance`."""
    counted = np.isfinite(faint)
    if not counted.any() or (glance is not None and not _none(glance, faint, counted).any()):
        return np.zeros(0, dtype=bool)
    return np.concatenate([_none(block, faint, counted) for block in passed(torque)])


def _none(torque: Array, faint: Array, counted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray((np.abs(torque[:, counted]) <= faint[counted]).all(axis=1))


def _runs(marked: NDArray[np.bool_], grid: Grid, length: int) -> list[tuple[int, int]]:
    """Return the runs of marked samples of at least some length within the segments; few others do not part them."""
    runs: list[tuple[int, int]] = []
    if np.count_nonzero(marked) < length:
        return runs
    for first, last in grid.bounds():
        edges = np.flatnonzero(np.diff(np.concatenate([[False], marked[first:last], [False]])))
        joined: list[tuple[int, int]] = []
        for start, stop in zip((edges[::2] + first).tolist(), (edges[1::2] + first).tolist(), strict=True):
            if joined and start - joined[-1][1] <= 2:  # noise beyond its bound
                joined[-1] = (joined[-1][0], stop)
            else:
                joined.append((start, stop))
        runs += [run for run in joined if run[1] - run[0] >= length]
    return runs


def _edge(grid: Grid) -> int:
    return max(2, round(EDGE / grid.dt))


def _bounds_of(run: tuple[int, int], grid: Grid) -> tuple[int, int]:
    """Return the segment that a run lies in."""
    return next(bounds for bounds in grid.bounds() if bounds[0] <= run[0] < bounds[1])


def _sudden(torque: Array, run: tuple[int, int], least: Array, grid: Grid) -> list[int]:
    """Return the samples beside a run from which some joint's torque falls away at once, or to which it comes back.

    What begins and ends with its segment lasts for all of it.
    """
    first, last = _bounds_of(run, grid)
    lag = _edge(grid)
    outside = [row for row in (run[0] - lag, run[1] + lag - 1) if first <= row < last]
    return [row for row in outside if bool(np.any(np.abs(torque[row]) > least))]


def _positions(signals: Mapping[str, Array]) -> list[Array]:
    """Return the columns of positions, one side of every joint: that of which more is known."""
    sides = [signals[side] for side in ("theta", "q") if side in signals]
    if not sides:
        return []
    known = [np.isfinite(side[:: max(1, len(side) // FEW)]).sum(axis=0) for side in sides]
    best = np.argmax(known, axis=0)
    return [sides[side][:, joint] for joint, side in enumerate(best) if known[side][joint]]


def _pace(places: Sequence[Array], grid: Grid) -> Array:
    """Return how far every joint may move in `PACE` and still stand: of what it does where it is fast, and of noise."""
    start, stop = max(grid.bounds(), key=lambda bounds: bounds[1] - bounds[0])
    stop = min(stop, start + LOOKED_AT)
    lag = _lag(start, stop, grid)
    far = []
    for place in places:
        part = place[start:stop]
        usual = np.nanpercentile(np.abs(part[lag:] - part[:-lag]), 90)
        noise = np.nanmedian(np.abs(np.diff(part, 3))) / (0.6745 * np.sqrt(20.0))
        far.append(max(STILL * usual, BESIDE_NOISE * noise))
    let_go(*places)
    return np.array(far)


def _lag(start: int, stop: int, grid: Grid) -> int:
    return min(max(FEWEST // 2, round(PACE / grid.dt)), stop - start - 1)


def _moves(places: Sequence[Array], start: int, stop: int, far: Array, grid: Grid) -> NDArray[np.bool_]:
    """Return from which samples of a part on some joint moves."""
    lag = _lag(start, stop, grid)
    moves = np.zeros(stop - start - lag, dtype=bool)
    for place, still in zip(places, far, strict=True):
        moves |= ~(np.abs(place[start + lag : stop] - place[start : stop - lag]) <= still)  # a hole tells nothing
    let_go(*places)
    return moves


def _driven(places: Sequence[Array], torque: Array, faint: Array, far: Array, grid: Grid) -> int:
    """Return for how many samples the robot moves and some joint has torque."""
    lasts = 0
    for start, stop in grid.bounds():
        if stop - start > FEWEST:
            moves = _moves(places, start, stop, far, grid)
            lasts += int(np.count_nonzero(moves & ~_without(torque[start : start + len(moves)], faint)))
    return lasts


def _moving(places: Sequence[Array], run: tuple[int, int], far: Array, grid: Grid) -> int:
    """Return for how many samples of a run the robot moves; all of them where it does not come to rest."""
    moves = _moves(places, *run, far, grid)
    at = np.flatnonzero(moves)
    if not at.size:
        return 0
    rests = at[-1] + 1 < moves.size or run[1] == _bounds_of(run, grid)[1]
    return int(at[-1]) + _lag(*run, grid) if rests else grid.samples


def _stands(places: Sequence[Array], row: int, far: Array, grid: Grid) -> bool:
    """Whether the robot stands about a sample at which the drives have torque: there, they hold it, and brakes beside.

    Torque that begins with the motion, from a rest that needs none, is no sign of brakes.
    """
    first, last = _bounds_of((row, row), grid)
    lag = round(PACE / grid.dt)
    part = max(first, row - lag), min(last, row + lag + 1)
    return part[1] - part[0] > FEWEST // 2 + 1 and not _moves(places, *part, far, grid).any()


def _widened(run: tuple[int, int], grid: Grid) -> tuple[int, int]:
    """Return a stretch with what lies beside it, within its segment."""
    first, last = _bounds_of(run, grid)
    lag = _edge(grid)
    return max(first, run[0] - lag), min(last, run[1] + lag)
