"""Whether a motion repeats: then what is locked in time, a process or a cable, looks like an effect of the state."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.signals.signals import Signals

ALIKE = 0.05
"""Rms difference from the motion a period before, as a part of the motion's own standard deviation, that is none."""
APART = 0.5
"""The same that must have been passed before: neighbouring instants are alike in any motion."""
TIMES = 1.8
"""Periods that the log must hold: two, of which the filter takes some off the ends."""


def repeats_every(signals: Signals) -> float | None:
    """Return the period, s, after which all joints move as before, as long as the log goes on; None where they do not.

    Judged by the motor positions of the log's longest segment, at the instants of the fit.
    """
    part = max(signals.segments, key=len)
    outputs = signals.outputs[(signals.outputs >= part.start) & (signals.outputs < part.stop)]
    position = signals.motion.theta[outputs][:, ~signals.still]
    if len(position) < 8 or not position.shape[1] or not np.isfinite(position).all():
        return None
    apart = _differences(position)
    far = np.flatnonzero(apart > APART)
    if not len(far):
        return None
    longest = int(len(position) / TIMES)
    lags = np.arange(far[0], longest + 1)
    alike = lags[apart[lags] < ALIKE]
    if not len(alike):
        return None
    run = alike[: int(np.argmax(np.diff(alike, append=alike[-1] + 2) > 1)) + 1]  # the first dip, and its bottom
    return float(run[np.argmin(apart[run])] / signals.rate)


def _differences(position: Array) -> Array:
    """Return by lag the rms difference of positions (M, n) from those before, of the worst joint, in its sd, (M,)."""
    count = len(position)
    centred = position - position.mean(axis=0)
    size = np.maximum(centred.std(axis=0), 1e-12)
    x = centred / size
    spectrum = np.fft.rfft(x, 2 * count, axis=0)
    products = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[:count]
    squares = np.cumsum(x**2, axis=0)
    total = squares[-1]
    lag = np.arange(count)
    first = squares[count - 1 - lag]  # of the instants that have one a lag later
    last = total - np.where(lag[:, None] > 0, squares[lag - 1], 0.0)
    mean = np.maximum(first + last - 2.0 * products, 0.0) / (count - lag)[:, None]
    return np.asarray(np.sqrt(mean).max(axis=1))
