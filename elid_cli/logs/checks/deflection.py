"""Whether two logged positions of one joint show an elastic transmission, or one position twice.

Simulators and many drivers log the position of a rigid joint on both sides. Then theta - q is nothing but noise and
quanta of the sensors, whereas a spring of stiffness K makes it follow the torque: theta - q = tau / K. One position
read a moment late differs by its velocity times the delay, which is no deflection and is taken out first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array

BLOCKS, LENGTH = 24, 8000
"""Stretches of a log that are looked at, and samples of each at most."""
LEAST = 24
"""Samples in a stretch below which it says nothing."""
CERTAIN = 5.0
"""Standard errors, from the differences between stretches, by which the difference must follow the torque."""
PLAIN = 1.5
"""Rms of the difference over that of its noise from which it is more than noise."""
OF_QUANTUM = 0.05
"""A part that follows torque and is smaller than this share of a quantum's noise may be chance."""
HALF = 4
"""Samples to either side over which the velocity is taken."""
GAP = 8
"""Usual steps between four samples from which something is missing among them."""
GLITCH, FEW = 30.0, 0.01
"""A difference of more than this many of its median amounts is a glitch where this share of samples at most has it."""
TORQUE = 3
"""Row of a stretch that holds the torque."""
ROUNDING = 1e-14
"""Share of the position that arithmetic leaves of a constant difference."""


@dataclass(frozen=True)
class Sensed:
    """One signal of one joint with its own stamps."""

    t: Array
    """s, increasing."""
    values: Array
    """rad, m or N·m, of the same shape."""

    @staticmethod
    def of(t: Array, values: Array) -> Sensed:
        """Return the samples that are numbers, in the order of time, none twice."""
        known = np.isfinite(t) & np.isfinite(values)
        t, values = (t, values) if known.all() else (t[known], values[known])
        if (np.diff(t) > 0).all():
            return Sensed(t, values)
        stamps, first = np.unique(t, return_index=True)
        return Sensed(stamps, values[first])


def same_position(q: Sensed, theta: Sensed, tau: Sensed | None) -> bool:
    """Return whether two positions of a joint differ by nothing but a constant, sensor noise and quanta.

    True needs both: the difference, without what a common delay makes of it, is no larger than its own white noise
    (from third differences) or than the quanta of both sensors; and it does not follow the torque, where one is logged.
    """
    pieces = _pieces(q, theta, tau)
    if not pieces:
        return False
    whole = np.hstack(pieces)
    if np.ptp(whole[1]) <= ROUNDING * max(float(np.abs(whole[0]).max()), 1.0):
        return True
    quantum = _quantum(q.values) + _quantum(theta.values)
    if _is_one(pieces, quantum):
        return True
    late = float(whole[1] @ _without(whole[2])) / max(float(_without(whole[2]) @ whole[2]), 1e-300)
    pieces = _pieces(q, Sensed(theta.t + late, theta.values), tau) or pieces  # its square is like an acceleration
    return _is_one(pieces, quantum)


def deflects_by(q: Sensed, theta: Sensed, tau: Sensed) -> float:
    """Return the rms deflection, rad (m), of two positions that differ by more than noise and as the torque does; 0."""
    if same_position(q, theta, None):
        return 0.0
    pieces = _pieces(q, theta, tau)
    if not pieces or not _follows(pieces, _quantum(q.values) + _quantum(theta.values)):
        return 0.0
    apart = np.hstack(pieces)[1]
    return float(np.std(apart))


def _pieces(q: Sensed, theta: Sensed, tau: Sensed | None) -> list[Array]:
    """Return stretches of rows q, theta - q, dq and, where there is one, tau, at the stamps of the slower position."""
    slow = q if q.t.size <= theta.t.size else theta
    blocks = int(np.clip(slow.t.size // (3 * LEAST), 1, BLOCKS))
    found = []
    for some in np.array_split(np.arange(slow.t.size), blocks):
        t = slow.t[some[:LENGTH]]
        if t.size < LEAST:
            continue
        link, motor = _at(q, t), _at(theta, t)
        rows = [link, motor - link, _velocity(t, 0.5 * (link + motor))]
        rows += [_at(tau, t)] if tau is not None else []
        piece = np.array(rows)
        found.append(_without_glitches(piece[:, np.isfinite(piece).all(axis=0)]))
    return [piece for piece in found if piece.shape[1] >= LEAST]


def _without_glitches(piece: Array) -> Array:
    """Return a stretch without the few samples at which the difference is no position of a joint."""
    apart = np.abs(piece[1] - np.median(piece[1])) if piece.size else piece[1]
    sound = apart <= GLITCH * np.median(apart) if piece.size else apart == 0
    return piece[:, sound] if np.count_nonzero(~sound) <= FEW * apart.size else piece


def _at(sensed: Sensed, t: Array) -> Array:
    """Return a signal at other times by cubic interpolation of four samples; NaN outside and within gaps."""
    if sensed.t.size < 4:
        return np.full(t.size, np.nan)
    start = int(np.searchsorted(sensed.t, t[0]))
    if np.array_equal(sensed.t[start : start + t.size], t):
        return sensed.values[start : start + t.size]
    first = np.searchsorted(sensed.t, t)
    around = np.clip(first, 2, sensed.t.size - 2)[:, None] + np.arange(-2, 2)
    at, values = sensed.t[around], sensed.values[around]
    result = np.zeros(t.size)
    for i in range(4):
        others = [j for j in range(4) if j != i]
        result += values[:, i] * np.prod([(t - at[:, j]) / (at[:, i] - at[:, j]) for j in others], axis=0)
    usual = float(np.median(np.diff(sensed.t)))
    between = (t >= sensed.t[0]) & (t <= sensed.t[-1]) & (at[:, 3] - at[:, 0] <= GAP * usual)
    return np.where(between, result, np.nan)


def _velocity(t: Array, position: Array) -> Array:
    """Return the mean velocity over the samples around each, rad/s; NaN at the ends."""
    result = np.full(t.size, np.nan)
    result[HALF:-HALF] = (position[2 * HALF :] - position[: -2 * HALF]) / (t[2 * HALF :] - t[: -2 * HALF])
    return result


def _without(values: Array, *columns: Array) -> Array:
    """Return values without their mean and without what is a multiple of columns of the same shape."""
    design = np.column_stack([np.ones(values.size), *columns])
    design = design / np.maximum(np.abs(design).max(axis=0), 1e-300)
    return np.asarray(values - design @ np.linalg.lstsq(design, values, rcond=1e-9)[0])


def _quantum(values: Array) -> float:
    """Return the smallest step of a channel of which most steps are whole multiples; 0: none."""
    steps = np.abs(np.diff(values[: BLOCKS * LENGTH]))
    steps = steps[steps > 1e-12 * max(float(np.abs(values).max()), 1e-300)]
    if steps.size < LEAST:
        return 0.0
    smallest = float(steps.min())
    fractions = np.abs(steps / smallest - np.round(steps / smallest))
    return smallest if np.count_nonzero(fractions < 0.02) > 0.9 * steps.size else 0.0


def _is_one(pieces: list[Array], quantum: float) -> bool:
    """Whether the difference is no more than noise, and does not follow the torque where the stretches hold one."""
    return _is_noise(pieces, quantum) and not (len(pieces[0]) > TORQUE and _follows(pieces, quantum))


def _is_noise(pieces: list[Array], quantum: float) -> bool:
    """Whether the difference is as large as white noise of its third differences (variance 20) or as the quanta."""
    whole = np.hstack([piece[1] for piece in pieces])
    if np.ptp(whole) <= 2.02 * quantum:
        return True
    thirds = np.hstack([np.diff(piece[1], 3) for piece in pieces])
    white, rms = math.sqrt(float(np.mean(thirds**2)) / 20), float(whole.std())
    return rms <= max(PLAIN * white, quantum)


def _follows(pieces: list[Array], quantum: float) -> bool:
    """Whether the difference, without what a delay makes of it, follows the torque throughout the log.

    Its slope over torque has the standard error that the stretches' sums of products differ by.
    """
    whole = np.hstack(pieces)
    ends = np.cumsum([piece.shape[1] for piece in pieces])[:-1]
    torque, apart = (_without(whole[row], whole[2]) for row in (TORQUE, 1))
    squares = np.array([float(part @ part) for part in np.split(torque, ends)])
    products = np.array([float(part.sum()) for part in np.split(torque * apart, ends)])
    if not squares.sum() > 0:
        return False
    slope = products.sum() / squares.sum()
    deviation = float(np.linalg.norm(products - slope * squares)) / squares.sum()
    enough = abs(slope) * float(torque.std()) > OF_QUANTUM * quantum / math.sqrt(12)
    return bool(enough and abs(slope) > CERTAIN * deviation)
