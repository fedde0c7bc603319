"""Joint torque sensors: which joints have one that can be used as a measurement of the transmission's torque."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.signals.recording import Recording, Segment

LEAST_KNOWN = 0.9
"""Least part of the samples that a sensor must have read: where it did not, its joint's rows say nothing."""
AGAINST = -0.7
"""Correlation of reading and deflection below which the reading's sign must be wrong."""
COPY = 1e-6
"""Difference from the motor's torque, relative to it, below which a reading is a copy of that and no sensor's."""


def sensors_of(recording: Recording, segments: Sequence[Segment]) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Return the joints whose readings can be used, (n,), and a sentence for every reading that cannot.

    Parameters
    ----------
    recording
        The log.
    segments
        Its stretches that are used; of a long log a few suffice.
    """
    sensed = np.zeros(recording.n, dtype=bool)
    if recording.tau_link is None:
        return sensed, ()
    part = np.concatenate([np.arange(s.start, s.stop) for s in segments])
    said = []
    for k, joint in enumerate(recording.joints):
        reading = recording.tau_link[part, k]
        known = np.isfinite(reading)
        if not known.any():
            continue
        fault = _fault(recording, part[known], k)
        if known.mean() < LEAST_KNOWN:
            fault = f"it is missing in {1 - known.mean():.0%} of the samples"
        sensed[k] = not fault
        if fault:
            said.append(f"tau_link of {joint} is not used: {fault}")
    return sensed, tuple(said)


def _fault(recording: Recording, part: NDArray[np.intp], joint: int) -> str:
    """Return why a joint's readings cannot be those of a torque sensor in its transmission, or an empty string."""
    assert recording.tau_link is not None
    reading = recording.tau_link[part, joint]
    if np.ptp(reading) == 0:
        return "it never changes"
    torque = recording.tau[part, joint]
    seen = np.isfinite(torque)
    if seen.any() and np.sum((reading - torque)[seen] ** 2) < COPY**2 * np.sum(torque[seen] ** 2):
        return "it is a copy of the motor's torque"
    deflection = recording.theta[part, joint] - recording.q[part, joint]
    seen = np.isfinite(deflection)
    if np.count_nonzero(seen) > 1 and np.ptp(deflection[seen]) > 0:
        follows = float(np.corrcoef(reading[seen], deflection[seen])[0, 1])
        if follows < AGAINST:
            return "it runs against theta - q, so its sign is wrong (tau_link: {sign: -1} in the mapping)"
    return ""
