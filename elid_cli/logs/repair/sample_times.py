"""Rows that were sampled at other times than their stamps say, as all joints tell together.

A recorder that writes at an even rate what another process measured last stamps rows evenly and holds values that are
up to a period old, some of them twice. Positions then advance by more or less than the measured velocities say, by
the same time in every joint: that time is estimated, row by row, and the values are moved to the even times.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.repair.align import Aligned
from elid_cli.memory import alike

GLANCE = 6000
"""Rows of the first stretch that tell whether times wander at all."""
AGREEING = 0.8
"""Correlation of the lags that two halves of the joints show, each for itself, above which they are of the rows."""
EXPLAINED = 0.3
"""Part of one half's disagreement of position and velocity that the lags of the other half must take away."""
SLIGHT = 0.02
"""Sample times; smaller wandering is left as it is."""
WIDEST = 0.5
"""Sample times; lags expected before any is known."""
DISTINCT = 0.2
"""Sample times; rows nearer to each other are one measurement."""
FEWEST = 200
"""Rows of a stretch that is looked at."""
ROUNDS = 4
SIDES = (("q", "dq"), ("theta", "dtheta"))
MEASURED = ("q", "theta", "dq", "dtheta", "tau", "tau_link")
"""Signals that were sampled with the positions; commands keep their stamps."""


@dataclass(frozen=True)
class _Steps:
    """What positions do between rows, joints that have both a position and a velocity: (N - 1, k)."""

    moved: Array
    """Change of the position, rad (m)."""
    speed: Array
    """Mean velocity, rad/s (m/s), scaled to what the positions say on the whole."""
    dt: float


def at_even_times(aligned: Aligned) -> Aligned:
    """Return a log whose rows are at their stamps, as far as all joints together show when they were sampled.

    A log without velocities, or of one joint, or of which both sides of a transmission are logged, stays as it is.
    """
    side = _side(aligned.signals)
    if side is None:
        return aligned
    position, velocity = (aligned.signals[name] for name in side)
    start, stop = aligned.segments[0]
    first = slice(start, min(stop, start + GLANCE))
    steps = _steps(position[first], velocity[first], aligned.dt)
    if steps is None or not _wanders(steps):
        return aligned
    signals = {name: np.array(values) for name, values in aligned.signals.items()}
    found = []
    for start, stop in aligned.segments:
        steps = _steps(position[start:stop], velocity[start:stop], aligned.dt)
        if steps is None or stop - start < FEWEST:
            continue
        late = _lags(steps, np.arange(steps.moved.shape[1]))
        late -= np.median(late)  # most rows are where they were: those written twice are the late ones
        found.append(late)
        _move(signals, slice(start, stop), late, aligned.dt, side)
    if not found:
        return aligned
    late = np.concatenate(found)
    told = (
        f"rows were sampled at other times than their stamps say, alike in all joints: "
        f"{1e3 * np.std(late):.2g} ms rms, up to {1e3 * np.abs(late).max():.2g} ms; measured values "
        "interpolated to even times"
    )
    return replace(aligned, signals=signals, repairs=(*aligned.repairs, told))


def _side(signals: Mapping[str, Array]) -> tuple[str, str] | None:
    """Return the one logged side of the joints that has positions and velocities."""
    held = [position for position, _ in SIDES if position in signals]
    if len(held) == 2 and not alike(signals["q"], signals["theta"]):
        return None
    rates = [velocity for _, velocity in SIDES if velocity in signals]
    return (held[0], rates[0]) if held and rates else None


def _steps(position: Array, velocity: Array, dt: float) -> _Steps | None:
    """Return what joints do that have both signals and move; None of fewer than two."""
    use = np.isfinite(position).all(axis=0) & np.isfinite(velocity).all(axis=0)
    moved, speed = np.diff(position[:, use], axis=0), 0.5 * (velocity[1:, use] + velocity[:-1, use])
    power = np.sum(speed**2, axis=0)
    if len(moved) < FEWEST or np.count_nonzero(power > 0) < 2:
        return None
    moved, speed, power = moved[:, power > 0], speed[:, power > 0], power[power > 0]
    scale = np.sum(speed * moved, axis=0) / (power * dt)
    like = (scale > 0.8) & (scale < 1.25)  # a velocity in another unit, or of another thing, says nothing
    if np.count_nonzero(like) < 2:
        return None
    return _Steps(moved[:, like], speed[:, like] * scale[like], dt)


def _wanders(steps: _Steps) -> bool:
    """Whether two halves of the joints show the same lags, and those of one explain the other's positions."""
    order = np.argsort(-np.sum(steps.speed**2, axis=0))
    halves = order[0::2], order[1::2]
    lags = [_lags(steps, half) for half in halves]
    moving = np.concatenate([[False], np.min([_strength(steps, half) for half in halves], axis=0) > 0.3])
    if np.count_nonzero(moving) < FEWEST // 2 or np.std(lags[0][moving]) < SLIGHT * steps.dt:
        return False
    agree = float(np.corrcoef(lags[0][moving], lags[1][moving])[0, 1])
    return agree > AGREEING and all(_explained(steps, half, lags[1 - k]) > EXPLAINED for k, half in enumerate(halves))


def _strength(steps: _Steps, joints: NDArray[np.intp]) -> Array:
    """Return the speed of some joints over their usual one."""
    size = np.sqrt(np.sum(steps.speed[:, joints] ** 2, axis=1))
    return np.asarray(size / max(float(np.sqrt(np.mean(size**2))), 1e-300))


def _explained(steps: _Steps, joints: NDArray[np.intp], late: Array) -> float:
    """Return the part of some joints' disagreement of position and velocity that lags take away."""
    moved, speed = steps.moved[:, joints], steps.speed[:, joints]
    plain = moved - speed * steps.dt
    left = moved - speed * (steps.dt - np.diff(late))[:, None]
    size = np.maximum(np.mean(plain**2, axis=0), 1e-300)
    return 1.0 - float(np.mean(np.mean(left**2, axis=0) / size))


def _lags(steps: _Steps, joints: NDArray[np.intp]) -> Array:
    """Return how long before its stamp every row was sampled, s, (N,), about a mean of 0 that no log can show.

    Least squares of ``moved = speed (dt - change of the lag)`` over the joints, each weighted by what it leaves, with
    lags that are held near 0 by their own size.
    """
    from scipy.linalg import solveh_banded

    moved, speed = steps.moved[:, joints], steps.speed[:, joints]
    short = moved - speed * steps.dt
    least = 1e-3 * np.sqrt(np.mean(moved**2, axis=0))  # simulated velocities may be exact
    usual, size = WIDEST * steps.dt, np.maximum(0.3 * np.sqrt(np.mean(short**2, axis=0)), least)
    late = np.zeros(len(moved) + 1)
    for _ in range(ROUNDS):
        weight = speed / size**2
        curve, pull = np.sum(weight * speed, axis=1), np.sum(weight * short, axis=1)
        bands = np.zeros((2, len(late)))
        bands[1] = usual**-2
        bands[1, :-1] += curve
        bands[1, 1:] += curve
        bands[0, 1:] = -curve
        late = solveh_banded(bands, np.append(0.0, -pull) + np.append(pull, 0.0))
        left = short + speed * np.diff(late)[:, None]
        size = 1.48 * np.median(np.abs(left), axis=0) + least
        usual = max(float(np.std(late)), SLIGHT * steps.dt)
    return late


def _move(signals: Mapping[str, Array], part: slice, late: Array, dt: float, side: tuple[str, str]) -> None:
    """Bring the measured signals of a stretch from the times at which they were sampled to those of their stamps."""
    from scipy.interpolate import CubicHermiteSpline

    even = dt * np.arange(len(late))
    held = _distinct(even - late, dt)
    when = (even - late)[held]
    inside = (even >= when[0]) & (even <= when[-1])
    velocity = signals[side[1]][part][held]
    for name in MEASURED:
        if name not in signals:
            continue
        values = signals[name][part]
        rows = values[held]
        for k in range(values.shape[1]):
            if not np.isfinite(rows[:, k]).all():
                continue
            if name in ("q", "theta") and np.isfinite(velocity[:, k]).all():
                values[inside, k] = CubicHermiteSpline(when, rows[:, k], velocity[:, k])(even[inside])
            else:
                values[inside, k] = np.interp(even[inside], when, rows[:, k])


def _distinct(when: Array, dt: float) -> NDArray[np.intp]:
    """Return the rows that follow one another in time, those of one measurement once."""
    kept = [0]
    last = float(when[0])
    for k, at in enumerate(when.tolist()):
        if at > last + DISTINCT * dt:
            kept.append(k)
            last = at
    return np.array(kept)
