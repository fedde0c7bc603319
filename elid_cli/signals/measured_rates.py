"""Measured velocities and accelerations as further observations of a channel's spline.

Drives often log a velocity that is a filtered derivative: smooth, but late. Its noise, taken from sixth differences,
would then promise an accuracy that it does not have. So a rate is weighted by its white noise only where it agrees
with the derivative of the positions as well as the positions' own noise allows; else by its disagreement; and where
it disagrees grossly it is not used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.signals.lowpass import low_pass
from elid_cli.signals.recording import Segment
from elid_cli.signals.spline_fit import fit_spline

GROSS = 0.05
"""Disagreement, as a share of the rate's own spread, above which a measured rate is not used."""
_BAND = 0.2
"""Frequency below which rates are compared, in units of one over the knot spacing."""
_AGREES = 1.3
"""Disagreement over what noise explains, up to which the rate's white noise is believed."""
FINEST = 2e-4
"""Least noise of a rate that is believed, as a part of its spread: by rates without any noise, as simulators log them,
positions would be known but for an error that lasts as long as the log, which no residual shows."""


@dataclass(frozen=True)
class Rate:
    """One derivative of all channels as measured, (channels, N), with the noise ratio of each channel."""

    derivative: int
    values: Array
    ratio: Array
    """Standard deviation of position noise over that of this rate's noise, (channels,); 0: not used."""


def white_noise(values: Array) -> float:
    """Return the standard deviation of white noise from sixth differences (sum of squared binomials 924)."""
    sixth = np.diff(values, 6)
    finite = sixth[np.isfinite(sixth)]
    return float(np.sqrt(np.mean(finite**2) / 924.0)) if finite.size else float("nan")


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("inf")


def _filled(values: Array) -> Array:
    return np.where(np.isfinite(values), values, 0.0)


def rate_of(
    derivative: int,
    measured: Array,
    positions: Array,
    names: Sequence[str],
    segments: Sequence[Segment],
    strides: NDArray[np.intp],
    dt: float,
) -> tuple[Rate, list[str]]:
    """Judge one measured derivative of all channels.

    Parameters
    ----------
    derivative
        1 for velocities, 2 for accelerations.
    measured, positions
        (channels, N); NaN where absent.
    names
        What each channel is called in notes.
    segments, strides, dt
        Segments of the log, knot stride per channel, sample time (s).

    Returns
    -------
    Rate, list
        The rate and one sentence for every channel that is not used.
    """
    ratio = np.zeros(len(measured))
    notes = []
    longest = max(segments, key=len)
    part = slice(longest.start, longest.stop)
    generator = np.random.default_rng(0)
    for k, name in enumerate(names):
        if not np.isfinite(measured[k, part]).any() or not np.isfinite(positions[k, part]).any():
            continue
        stride = int(strides[k])
        fit = fit_spline(positions[k : k + 1, part], stride, dt)
        noise = max(white_noise(positions[k, part]), 1e-3 * float(fit.rms[0]))
        # a spline cannot follow what changes within a knot; a lag or a gain shows below that as well
        band = low_pass(_BAND / (stride * dt), dt, 1)
        difference = _rms(band.apply(_filled(measured[k, part] - fit.spline.evaluate(derivative)[0])))
        spread = float(np.nanstd(measured[k, part]))
        if spread == 0 or noise == 0:
            continue
        white = white_noise(measured[k, part])
        drawn = fit_spline(noise * generator.standard_normal((1, len(longest))), stride, dt)
        propagated = _rms(band.apply(drawn.spline.evaluate(derivative)[0]))
        if difference <= _AGREES * np.hypot(white, propagated) + 1e-4 * spread:
            ratio[k] = noise / max(white, FINEST * spread)
        elif difference <= GROSS * spread:
            ratio[k] = noise / difference
        else:
            share = f"{difference / spread:.0%}"
            notes.append(f"measured {name} differs from the derivative of the position by {share}: not used")
    return Rate(derivative, np.where((ratio > 0)[:, None], measured, np.nan), ratio), notes
