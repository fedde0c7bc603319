"""Loops of drives too fast for the motion to show: how long the period of one may be that is as near as none.

A drive whose loop holds its torque for a period is, to first order, one that acts all the time with less viscous
friction and inertia: kp and kd times half the period. What is beyond that the motion shows of long periods alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.signals.recording import Recording

SHORTEST = 1.9e-3
"""Shortest period of these, s: motion hardly shows shorter ones. Measured: simulated legs with encoders of 16 bit and
loops of 1 ms less than two integrators do, of 2 ms twice as much as counts as clear, of 5 ms fifty times."""
LONGEST = 1e-2
"""Longest period of these, s, unless a sample is longer."""
LITTLE = 0.01
"""Sum over the joints of the logarithm of the error's size by which loops that run several times per sample must be
nearer: two integrators of the same plant differ by up to a third of it."""
DEVIATIONS = 2.0
"""Standard errors of a delay that count."""


def by_motion(fit: TrajectoryFit, tried: Mapping[float, TrajectoryFit], dt: float) -> float:
    """Return the longest period, s, of loops that hold their torque and are as near the motion as ones that always act.

    Parameters
    ----------
    fit
        The fit of drives that act all the time.
    tried
        Fits of loops, by how often in a sample they run; the logarithm by which they are farther goes with the square
        of the period, and the fourth power: the two longest count that run at every sample. Longer ones miss commands,
        each its own, and count for themselves.
    dt
        Sample time, s.
    """
    by = {often: nearer_by(one, fit) for often, one in tried.items()}
    alone = max((dt / often for often, near in by.items() if near > -LITTLE), default=0.0)
    every = sorted(often for often in by if often >= 1)
    if not every:
        return max(alone, min(SHORTEST, dt))
    (longest, whole), *others = [(often, by[often]) for often in every[:2]]
    part = np.linspace(0.0, 1.0, 501) ** 2
    if not others:
        farther = whole * part**2
    else:
        ((shorter, less),) = others
        x = (longest / shorter) ** 2
        bend = (whole - less / x) / (1.0 - x)
        farther = (whole - bend) * part + bend * part**2
    beyond = np.flatnonzero(farther < -LITTLE)
    return max(alone, dt / longest * (float(np.sqrt(part[beyond[0]])) if len(beyond) else 1.0))


def by_delay(fit: TrajectoryFit, recording: Recording) -> float:
    """Return the longest period, s, of loops under commands that change all the time: half of it is in the delay.

    Held for their sample such commands act late by half of it already. That of a sample where the fit has no delay.
    """
    dt = recording.dt
    if not fit.delays.any():
        return dt
    late = fit.delays + DEVIATIONS * fit.deviation[fit.unknowns.delays] + (0.0 if recording.changing else 0.5 * dt)
    return min(max(dt, LONGEST), 2.0 * max(float(late.max()), 0.0))
