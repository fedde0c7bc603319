"""Frequency response of a motor's acceleration to its torque: of the fitted model, of rigid joints, and measured.

Measured is the quotient of spectra with all moving joints' torques as inputs (Bendat and Piersol, Random Data, chapter
7), as links pass one motor's torque on to the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.motor_log import Samples
from elid_cli.estimation.motor_side.vibration import Vibration

LOWEST = 1.0
"""Lowest frequency, Hz: below, gravity and friction hide the inertia."""
BEYOND = 1.15
"""Highest frequency over the resonance or over the end of the band, where the resonance is not far beyond it."""
FAR = 3.0
FREQUENCIES = 300
PIECES = 12
"""Half-overlapping pieces of a log over which spectra are averaged, and at least two for every input."""
UNSURE = 0.4
"""Largest standard error of a measured response that is kept, share of it."""


@dataclass(frozen=True)
class Response:
    """Sizes of one motor's acceleration per torque of its own, 1/(kg·m²) (1/kg)."""

    frequency: Array
    """Hz, (F,)."""
    elastic: Array
    """The fitted model's, the geometric mean over poses, (F,)."""
    rigid: Array
    """The same with all joints rigid, (F,)."""
    seen: Array
    """Frequencies at which the log shows it, Hz, (M,)."""
    measured: Array
    """What it shows, (M,)."""


def responses_of(fitted: Vibration, samples: Samples, joints: Sequence[int], bands: Array) -> dict[int, Response]:
    """Return the responses of some joints, numbered among those that move.

    `bands` is where each joint's motion ends, Hz, (n,).
    """
    near = [f for k in joints if (f := fitted.resonance(k)) < FAR * bands[k]]
    top = max([2 * LOWEST, *near, *(float(bands[k]) for k in joints)])
    frequency = np.geomspace(LOWEST, BEYOND * top, FREQUENCIES)
    elastic, rigid = (_typical(fitted.acceleration(frequency, rigid=rigid)) for rigid in (False, True))
    seen, responses, errors = measured_response(samples)
    measured = np.abs(responses)
    found = {}
    for k in joints:
        known = (errors[:, k] < UNSURE * measured[:, k]) & (seen >= LOWEST) & (seen <= bands[k])
        found[k] = Response(frequency, elastic[:, k], rigid[:, k], seen[known], measured[known, k])
    return found


def _typical(answer: NDArray[np.complexfloating]) -> Array:
    return np.asarray(np.exp(np.mean(np.log(np.abs(answer)), axis=1)))


def measured_response(samples: Samples) -> tuple[Array, NDArray[np.complexfloating], Array]:
    """Return frequencies, Hz, (F,), every motor's acceleration per torque of its own, (F, n), and its standard error.

    All torques are inputs at once.
    """
    count, n = samples.tau.shape
    size = 2 * count // (max(PIECES, 2 * n + 2) + 1)
    frequency, lines = _lines(np.concatenate([samples.theta, samples.tau], axis=1), samples.rate, size)
    pieces, theta, tau = len(lines), lines[:, :, :n], lines[:, :, n:]
    inputs = np.einsum("kfi,kfj->fij", tau, tau.conj()) / pieces
    cross = np.einsum("kfi,kfj->fij", theta, tau.conj()) / pieces
    inverse = np.linalg.pinv(inputs, hermitian=True)
    gain = cross @ inverse
    own = np.mean(np.abs(theta) ** 2, axis=0)
    left = np.maximum(own - np.einsum("fij,fij->fi", gain, cross.conj()).real, 0.0)
    error = np.sqrt(left * inverse.diagonal(axis1=1, axis2=2).real / max(pieces - n, 1))
    twice = -((2 * np.pi * frequency[:, None]) ** 2)
    return frequency, twice * gain.diagonal(axis1=1, axis2=2), -twice * error


def _lines(values: Array, rate: float, size: int) -> tuple[Array, NDArray[np.complexfloating]]:
    """Return frequencies, Hz, and spectra of half-overlapping pieces of columns, (pieces, F, columns).

    A parabola is taken off every piece, under a Hann window.
    """
    window = np.hanning(size + 1)[:-1]
    slow = np.polynomial.legendre.legvander(np.linspace(-1, 1, size), 2)
    found = []
    for start in range(0, len(values) - size + 1, size // 2):
        piece = values[start : start + size]
        piece = piece - slow @ np.linalg.lstsq(slow, piece, rcond=None)[0]
        found.append(np.fft.rfft(piece * window[:, None], axis=0))
    return np.asarray(np.fft.rfftfreq(size, 1 / rate)), np.stack(found)
