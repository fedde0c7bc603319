"""Loops of drives too fast for the motion to show: how long the period of one may be that is as near as none.

A drive whose loop holds its torque for a period is, to first order, one that acts all the time with less viscous
friction and inertia: kp and kd times half the period. What is beyond that the motion shows of long periods alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit

SHORTEST = 1.9e-3
"""Shortest period of these, s: motion hardly shows shorter ones. Measured: simulated legs with encoders of 16 bit and
loops of 1 ms less than two integrators do, of 2 ms twice as much as counts as clear, of 5 ms fifty times."""
LITTLE = 0.01
"""Sum over the joints of the logarithm of the error's size by which loops that run several times per sample must be
nearer: two integrators of the same plant differ by up to a third of it."""
DEVIATIONS = 2.0
"""Standard errors of a delay that count."""


def by_motion(fit: TrajectoryFit, tried: Mapping[int, TrajectoryFit], dt: float) -> float:
    """Return the longest period, s, of loops that hold their torque and are as near the motion as ones that always act.

    Parameters
    ----------
    fit
        The fit of drives that act all the time.
    tried
        Fits of loops that run once and twice in a sample, by how often; the logarithm by which they are farther goes
        with the square of the period, and the fourth power.
    dt
        Sample time, s.
    """
    by = {often: nearer_by(one, fit) for often, one in tried.items() if often in (1, 2)}
    if not by:
        return min(SHORTEST, dt)
    part = np.linspace(0.0, 1.0, 501) ** 2
    if len(by) == 1:
        ((often, whole),) = by.items()
        farther = whole * (part * often**2) ** 2
    else:
        bend = (by[1] - 4.0 * by[2]) / 0.75
        farther = (by[1] - bend) * part + bend * part**2
    beyond = np.flatnonzero(farther < -LITTLE)
    return dt * float(np.sqrt(part[beyond[0]])) if len(beyond) else dt


def by_delay(fit: TrajectoryFit, dt: float) -> float:
    """Return the longest period, s, of loops under smooth commands: half a period is no longer than the delay.

    That of a sample where the fit has no delay.
    """
    if not fit.delays.any():
        return dt
    late = fit.delays + DEVIATIONS * fit.deviation[fit.unknowns.delays]
    return min(dt, 2.0 * max(float(late.max()), 0.0))
