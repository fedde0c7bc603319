"""What the standard errors of a collocation do not know by themselves: its knots, and the valleys that noise makes.

Empirical rules, each with the logs that it was read off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNBENT, STRAIGHT = 84.0, 60.0
"""Signal-to-noise ratios of the positions, dB, from which on `widening` and `astray` have nothing to add."""


FEW_VALLEYS, MANY_VALLEYS = 70.0, 64.0
"""Signal-to-noise ratios, dB, between which `between_valleys` rises from 0 to …"""
VALLEYS = 0.45
"""… this part of the default estimate's standard errors."""
FOLLOWING, LAGGING = 80.0, 70.0
"""Signal-to-noise ratios, dB, between which `between_knots` rises from 0 to 1."""


def between_knots(ratio: float) -> float:
    """Return how far fine knots' standard errors have to reach towards coarse ones' answer, beyond what noise explains.

    At a signal-to-noise ratio of the positions, dB. Of 12 logs each of a planar arm (motions 1-4 and 5-8, 0.03 % of
    torque noise) errors were 1.4 to 2 standard errors rms at 66 and 70 dB in the worst parameter without it, 0.9 to 1.5
    with it; at 80 dB and above they are 1 without it, and of stiff arms coarse knots' answer is good for nothing.
    """
    return float(np.clip((FOLLOWING - ratio) / (FOLLOWING - LAGGING), 0.0, 1.0))


def between_valleys(ratio: float) -> float:
    """Return the part of the default's standard errors along rotor inertias that the collocation's have to contain.

    At a signal-to-noise ratio of the positions, dB. An inertia makes the motor ring against its link at a frequency,
    and the cost has a valley for every whole number of periods in the log, each narrow and as far apart as a part of
    the default's standard error: with positions so noisy, the lowest is the wrong one of one log in five.
    """
    return VALLEYS * float(np.clip((FEW_VALLEYS - ratio) / (FEW_VALLEYS - MANY_VALLEYS), 0.0, 1.0))


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
