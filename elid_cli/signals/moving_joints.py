"""Which joints move in a log, how far and how fast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.memory import let_go
from elid_cli.robot.robot import Robot
from elid_cli.signals.excerpts import excerpts, in_parts
from elid_cli.signals.motion import Motion, SplineMotion
from elid_cli.signals.recording import Segment

HELD = 2e-3
"""rad; a joint that stays within this but for a jolt does not move …"""
JOLT = 0.1
"""… of at most this (rad), as when the brakes open."""
GLANCE = 5000
"""Samples of a stretch that tell it."""
STILL = 3.0
"""A joint whose range of motion is below this many standard deviations of its noise does not move."""


def extremes(motion: Motion, segments: Sequence[Segment]) -> tuple[Array, Array, Array]:
    """Return smallest, largest and mean position of links and motors, (2, n) each; NaN where there is none."""
    n = motion[0:0].q.shape[1]
    low, high, total, count = np.full((2, n), np.nan), np.full((2, n), np.nan), np.zeros((2, n)), np.zeros((2, n))
    for part in in_parts(segments):
        here = motion.positions(part)
        for side, values in enumerate(here):
            low[side] = np.fmin(low[side], np.fmin.reduce(values, axis=1))
            high[side] = np.fmax(high[side], np.fmax.reduce(values, axis=1))
            known = np.isfinite(values)
            count[side] += np.count_nonzero(known, axis=1)
            total[side] += np.sum(values, axis=1, where=known)
    return low, high, np.where(count > 0, total / np.maximum(count, 1), 0.0)


def stationary(low: Array, high: Array, noise: tuple[Array, Array]) -> NDArray[np.bool_]:
    """Return which joints stay within the noise of their positions (n,), from their smallest and largest, (2, n)."""
    span = np.nan_to_num(high - low)
    scale = np.nan_to_num(np.fmax(np.abs(low), np.abs(high)))
    least = np.fmax(np.fmax(STILL * np.stack(noise), 1e-9 * scale), 1e-12)
    return np.asarray(np.any(span <= least, axis=0))


def constant(raw: Array, segments: Sequence[Segment]) -> NDArray[np.bool_]:
    """Return which channels hold one value only, (n,): splines of a constant vibrate at their ends by rounding."""
    constant = np.ones(raw.shape[1], dtype=bool)
    first = np.full(raw.shape[1], np.nan)
    glance = [replace(s, stop=min(s.stop, s.start + GLANCE)) for s in segments[:1]]  # mostly enough
    for part in (*in_parts(glance), *in_parts(segments)):
        values = raw[part]
        finite = np.isfinite(values)
        unset = np.isnan(first) & finite.any(axis=0)
        first[unset] = values[finite.argmax(axis=0), np.arange(values.shape[1])][unset]
        constant &= np.all((values == first) | ~finite, axis=0)
        if not constant.any():
            break
    constant &= np.isfinite(first)
    return constant


def held(link: Array, motor: Array, robot: Robot, segments: Sequence[Segment]) -> NDArray[np.bool_]:
    """Return which revolute joints are held in place, (n,): they tremble in their friction, which no model here has."""
    rows = np.concatenate([np.arange(s.start, s.stop, max(1, len(s) // GLANCE)) for s in segments])
    held = np.array([joint.revolute for joint in robot.joints])
    for side in (link, motor):
        values = side[rows]
        let_go(side)
        there = np.isfinite(values)
        if there.all():
            low, high = values.min(axis=0), values.max(axis=0)
            held &= high - low < JOLT
            if not held.any():
                break
            inner, outer = np.quantile(values, (0.02, 0.98), axis=0)
        else:
            filled = np.where(there, values, np.where(there.any(axis=0), np.nan, 0.0))
            low, inner, outer, high = np.nanpercentile(filled, [0, 2, 98, 100], axis=0)
        held &= (outer - inner < HELD) & (high - low < JOLT)
    return held


def at_rest(motion: Motion, still: NDArray[np.bool_], mean: Array) -> Motion:
    """Return the motion; a joint that does not move rests exactly at its mean, so that its columns are exact."""
    if not still.any():
        return motion
    rest = np.where(still, mean, np.nan)
    if isinstance(motion, SplineMotion):
        return motion.resting(rest)
    arrays = [a.copy() for a in motion.states]
    for k in np.flatnonzero(still):
        for number, array in enumerate(arrays):
            array[:, k] = 0.0 if number % 3 else rest[number // 3, k]
    return Motion(motion.t, *arrays)


def top_speed(motion: Motion, segments: Sequence[Segment], dt: float) -> Array:
    """Return the speed that each motor exceeds in a twentieth of the time, (n,); of a long log, in stretches of it."""
    parts = in_parts(excerpts(segments, dt))
    if isinstance(motion, SplineMotion):  # no need of the other five signals
        speeds = np.concatenate([motion.speeds(part) for part in parts], axis=1)
    else:
        speeds = np.concatenate([motion[part].dtheta for part in parts]).T
    return np.asarray(np.quantile(np.abs(speeds, out=speeds), 0.95, axis=1))
