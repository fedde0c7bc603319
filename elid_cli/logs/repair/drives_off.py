"""Stretches with the drives off: no joint has any torque, and the brakes stop the robot, or hold it.

What brakes do is no motor's torque. A third of a second of an emergency stop in a log bends every parameter: there,
the masses decelerate and nothing is logged that makes them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.grid import Grid
from elid_cli.logs.repair.standing import LOOKED_AT, Standing, longest, segment_of
from elid_cli.memory import let_go, passed
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import noise_between_jumps

FAINT = 0.02
"""Share of a joint's rms torque within which it counts as none …"""
NOISES = 5.0
"""… or this many standard deviations of its noise, if that is more …"""
LOUDEST = 0.2
"""… but at most this share."""
FEWEST, SHORTEST = 8, 0.03
"""Samples, and s, of the shortest stretch."""
SUDDEN = 3.0
"""Times the usual step within `EDGE` by which a torque falls away, or comes back."""
USUAL = 95
"""Percentile of steps that is a usual one."""
EDGE = 0.01
"""s in which a drive's current decays; as much beside a stretch is left out, too."""
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
    """Return the stretches (start, stop) with the drives off.

    A robot at rest counts as held by brakes where it stands beside, too, while the drives have torque. Torque that
    begins with the motion, from a rest that needs none, is no sign of brakes.
    """
    length = max(FEWEST, round(SHORTEST / grid.dt))
    rms = _rms(torque)
    glance = torque[::length]  # every stretch holds one of these samples
    if not np.isfinite(rms).any() or not _runs(_without(torque, LOUDEST * rms, glance), grid, length):
        return []
    faint, least = _sizes(torque, rms, grid)
    sudden = {run: _sudden(torque, run, least, grid) for run in _runs(_without(torque, faint), grid, length)}
    sudden = {run: beside for run, beside in sudden.items() if beside}
    standing = Standing.of(signals, grid)
    if not sudden or not standing.places:
        return []
    braked = {run: standing.until_rest(*run) for run in sudden}
    held = [run for run, moves in braked.items() if moves == 0 and any(map(standing.about, sudden[run]))]
    stopped = {run: moves for run, moves in braked.items() if moves and moves <= round(LONGEST / grid.dt)}
    if sum(stopped.values()) > COASTS * _driven(standing, torque, faint):
        stopped = {}
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
    start, stop = longest(grid)
    part = np.nan_to_num(torque[start:stop])
    lag = _edge(grid)
    if len(part) < 4 * lag:
        return np.full_like(rms, np.nan), rms
    noise = noise_between_jumps(part, (Segment(0, len(part)),), grid.dt)
    faint = np.clip(NOISES * noise, FAINT * rms, LOUDEST * rms)
    usual = np.percentile(np.abs(part[lag:] - part[:-lag]), USUAL, axis=0)
    let_go(torque)
    return faint, faint + SUDDEN * usual


def _without(torque: Array, faint: Array, glance: Array | None = None) -> NDArray[np.bool_]:
    """Return where no joint has any torque, (N,); nowhere where that is so of no sample of a `glance`."""
    counted = np.isfinite(faint)
    if not counted.any() or (glance is not None and not _none(glance, faint, counted).any()):
        return np.zeros(len(torque), dtype=bool)
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


def _sudden(torque: Array, run: tuple[int, int], least: Array, grid: Grid) -> list[int]:
    """Return the samples beside a run from which some joint's torque falls away at once, or to which it comes back.

    What begins and ends with its segment lasts for all of it.
    """
    first, last = segment_of(run[0], grid)
    lag = _edge(grid)
    outside = [row for row in (run[0] - lag, run[1] + lag - 1) if first <= row < last]
    return [row for row in outside if bool(np.any(np.abs(torque[row]) > least))]


def _driven(standing: Standing, torque: Array, faint: Array) -> int:
    """Return for how many samples the robot moves and some joint has torque."""
    lasts = 0
    for start, stop in standing.grid.bounds():
        if stop - start > FEWEST:
            moves = standing.moves(start, stop)
            lasts += int(np.count_nonzero(moves & ~_without(torque[start : start + len(moves)], faint)))
    return lasts


def _widened(run: tuple[int, int], grid: Grid) -> tuple[int, int]:
    """Return a stretch with what lies beside it, within its segment."""
    first, last = segment_of(run[0], grid)
    lag = _edge(grid)
    return max(first, run[0] - lag), min(last, run[1] + lag)
