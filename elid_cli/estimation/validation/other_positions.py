"""What a joint's other position would make of the parameters, where a transmission that yields counts as rigid.

The fit takes the link's positions; what the motor moves goes otherwise by the deflection. What that does to a value
is about as large as what it would do to take the motor's positions instead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import ElidError
from elid_cli.estimation.default_fit import DefaultFit, fit_log
from elid_cli.estimation.result import EstimateOptions
from elid_cli.logs.checks.deflection import Sensed, deflects_by
from elid_cli.signals.signals import prepare

MOVED = 2.0
"""Standard errors by which the other positions move a base parameter that may be biased."""


def moved_by_other_positions(fit: DefaultFit) -> NDArray[np.bool_]:
    """Return the base parameters, (b,), that the other positions of rigid joints move whose transmissions yield."""
    none = np.zeros(fit.base.count, dtype=bool)
    yielding = _yielding(fit)
    recording = fit.signals.recording
    if recording is None or not yielding.any():
        return none
    q, theta = recording.q.copy(), recording.theta.copy()
    q[:, yielding], theta[:, yielding] = recording.theta[:, yielding], recording.q[:, yielding]
    swapped = replace(recording, q=q, theta=theta, segments=fit.signals.segments)
    try:
        other = fit_log(fit.model, fit.base, prepare(swapped, fit.model.robot), EstimateOptions())
    except ElidError:
        return none
    shift = np.abs(other.transform @ other.solution.values - fit.transform @ fit.solution.values)
    return np.asarray(shift > MOVED * fit.deviations(fit.covariance))


def _yielding(fit: DefaultFit) -> NDArray[np.bool_]:
    """Return the joints that count as rigid and whose two positions differ as their torque does, (n,)."""
    robot, recording = fit.model.robot, fit.signals.recording
    found = np.zeros(robot.n, dtype=bool)
    if recording is None:
        return found
    segment = max(fit.signals.segments, key=len)
    part = slice(segment.start, segment.start + len(segment))
    t = recording.dt * np.arange(len(segment), dtype=float)
    for k in np.flatnonzero(~robot.elastic).tolist():
        sides = recording.q[part, k], recording.theta[part, k]
        if np.isfinite(sides).any(axis=1).all() and not np.array_equal(*sides, equal_nan=True):
            found[k] = deflects_by(*(Sensed.of(t, side) for side in (*sides, recording.tau[part, k]))) > 0
    return found
