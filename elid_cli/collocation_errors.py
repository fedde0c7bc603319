"""What the standard errors of a collocation do not know by themselves: its knots, and the valleys that noise makes.

Empirical rules, each with the logs that it was read off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNBENT, STRAIGHT = 84.0, 60.0
"""Signal-to-noise ratios of the positions, dB, from which on `widening` and `astray` have nothing to add."""


def lost(fine: Array, coarse: Array) -> float:
    """Return which part of the links' residuals coarse knots make: what finer ones take from any of them, squared.

    Root mean squares of the residuals of rows that no sensor's torque enters, (rows,): there is no noise to follow.
    Without such a row, as of a robot with rigid joints, half of them.
    """
    part = 1.0 - (fine / np.maximum(coarse, 1e-300)) ** 2
    return float(np.max(part, initial=0.0)) if len(part) else 0.5


def told_by_coarse(apart: Array, noise: Array, share: float, left: float) -> Array:
    """Return which part of fine ones' answer minus coarse ones' (p,) the latter's standard errors have to reach to.

    Parameters
    ----------
    apart
        Fine ones' answer minus coarse ones', (p,).
    noise
        Variance by which noise alone takes the two apart, (p,).
    share
        Part of the equations' variance that is noise of the torques. Where none is, the coarse trajectory is what is
        wrong, where all is, it may be the fine one, which follows the noise.
    left
        What `lost` tells of the coarse trajectory. Of 100 logs of a planar arm at 90 dB and 1 % of torque noise next to
        nothing, and coarse ones' standard errors hold by themselves; at 80 dB and 0.1 % three quarters, and they miss
        the way to fine ones' answer.
    """
    beyond = np.maximum(apart**2 - noise, 0.0) / np.maximum(apart**2, 1e-300)
    told: Array = np.maximum(1.0 - share, np.sqrt(left * beyond))
    return told


def widening(ratio: float) -> float:
    """Return the factor on standard errors of fine knots alone, at a signal-to-noise ratio of the positions, dB.

    An empirical rule, for who does not compare with coarse knots: on eight logs of the paper's robot (plain friction,
    motions 1-4) errors were 2.8 standard errors at 60 dB, 1.9 at 70 dB and 1.25 at 80 dB, rms.
    """
    return float(max(1.0, 10.0 ** ((UNBENT - ratio) / 50.0)))


def astray(ratio: float) -> float:
    """Return the factor on standard errors at a signal-to-noise ratio of the positions, dB, knots accounted for.

    An empirical rule for positions so noisy that the cost has several valleys along an inertia, each narrower than
    they lie apart: on motions 1-8 of the paper's robot, with nothing but position noise, errors were one standard error
    at 60 dB, rms, and twice that at 40 dB. Noise of the torque fills the valleys: above 57 dB the rule fades with it.
    """
    return float(max(1.0, 10.0 ** ((STRAIGHT - ratio) / 66.0)))
