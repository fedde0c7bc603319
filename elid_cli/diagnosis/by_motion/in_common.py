"""What an effect takes off the error of several recordings with the one value that all of them have in common.

Within each recording alone an effect may take much with another value, or another sign, in each: that is none.
"""

from __future__ import annotations

import numpy as np

from elid_cli.estimation.regression.normal_equations import step_of
from elid_cli.estimation.trajectory.block_sums import DAMPING
from elid_cli.estimation.trajectory.fit import TrajectoryFit


def common_gain(fit: TrajectoryFit, place: int) -> float:
    """Return the part of the squared error of one effect's joint that it takes away in the whole fit, by first order.

    All other unknowns but shapes have their best values without it.
    """
    own, matrix = fit.unknowns, fit.equations.straight.sum(axis=0)
    held = np.zeros(own.count, dtype=bool)
    held[own.amplitudes_of(place)] = True
    gone = np.where(held, fit.z, 0.0)
    held[own.amplitudes.stop : own.delays.start] = True
    held[own.delays] |= fit.delays == 0
    apart = gone - step_of(matrix, -matrix @ gone, DAMPING, held)
    rise = float(apart @ matrix @ apart) / float(fit.equations.counts.sum())
    return rise / (1.0 + rise)
