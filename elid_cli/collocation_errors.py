"""What the standard errors of a collocation do not know by themselves: its knots, and the valleys that noise makes.

Empirical rules, each with the logs that it was read off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNBENT, STRAIGHT = 84.0, 60.0
"""Signal-to-noise ratios of the positions, dB, from which on `widening` and `astray` have nothing to add."""


def told_by_coarse(apart: Array, freer: Array, share: float) -> Array:
    """Return which part of fine ones' answer minus coarse ones' (p,) the latter's standard errors have to reach to.

    Parameters
    ----------
    apart
        Fine ones' answer minus coarse ones', (p,).
    freer
        Fine ones' variance minus coarse ones', (p,): by so much the two differ anyway.
    share
        Part of the equations' variance that is noise of the torques. Where none is, the coarse trajectory is what is
        wrong. Where all is, it may be that (planar arm, 80 dB, torque noise of 0.1 %: two standard errors) or the fine
        one, which follows the noise: the truth lies somewhere between, on average half the square of the way.
    """
    beyond = np.maximum(apart**2 - np.maximum(freer, 0.0), 0.0) / np.maximum(apart**2, 1e-300)
    told: Array = np.maximum(1.0 - share, np.sqrt(0.5 * beyond))
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
