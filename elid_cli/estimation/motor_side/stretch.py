"""Which part of a log the motor side is estimated from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import LinkSensors
from elid_cli.estimation.motor_side.motor_log import Samples, samples_of
from elid_cli.signals.recording import Recording

LONGEST = 12.0
"""Length beyond which the liveliest part of a stretch is taken, s: time grows with it, and 10 s suffice."""
SHORTEST, FEWEST = 2.0, 500
"""Least length, s, and fewest samples."""
SLOWEST = 100.0
"""Least sample rate, Hz."""
WIDTH, OF_SPEED = 0.02, 0.03
"""Speed within which friction changes its sign, rad/s (m/s), and its largest part of the rms speed."""


def stretch_of(recording: Recording, moving: NDArray[np.intp], sensors: Sequence[LinkSensors]) -> Samples | str:
    """Return the stretch of a recording that is used, or why there is none.

    Parameters
    ----------
    recording
        The log.
    moving
        Numbers of the joints that move, (m,).
    sensors
        Sensors on their links, of all samples.
    """
    if recording.rate < SLOWEST:
        return f"sampled at {recording.rate:.3g} Hz, too slowly for a resonance"
    theta = np.where(np.isnan(recording.theta), recording.q, recording.theta)[:, moving]
    tau = recording.tau[:, moving]
    known: NDArray[np.bool_] = np.isfinite(np.concatenate([theta, tau, *(own.values for own in sensors)], axis=1)).all(
        axis=1
    )
    start, stop = _longest(known, recording)
    if (stop - start) * recording.dt < SHORTEST or stop - start < FEWEST:
        return f"no {SHORTEST:g} s in which motors' positions and torques of all moving joints are there"
    part = _liveliest(tau, start, stop, round(LONGEST / recording.dt))
    speed = np.gradient(theta[part], recording.dt, axis=0)
    width = np.minimum(WIDTH, OF_SPEED * np.sqrt(np.mean(speed**2, axis=0)))
    seen = [own.part(part) for own in sensors]
    return samples_of(recording.t[part], theta[part], tau[part], np.maximum(width, 1e-9), seen)


def _longest(known: NDArray[np.bool_], recording: Recording) -> tuple[int, int]:
    """Return the longest run of known samples within one segment."""
    best = (0, 0)
    for segment in recording.segments:
        inside = np.r_[False, known[segment.start : segment.stop], False].astype(int)
        edges = np.flatnonzero(np.diff(inside))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if b - a > best[1] - best[0]:
                best = (segment.start + a, segment.start + b)
    return best


def _liveliest(tau: Array, start: int, stop: int, count: int) -> slice:
    """Return `count` samples in which the torques change most, or all where there are no more."""
    if stop - start <= count:
        return slice(start, stop)
    change = np.diff(tau[start:stop], axis=0)
    lively = np.cumsum(np.sum(change**2 / np.maximum(np.mean(change**2, axis=0), 1e-300), axis=1))
    first = start + int(np.argmax(lively[count - 1 :] - np.r_[0.0, lively[: len(lively) - count]]))
    return slice(first, first + count)
