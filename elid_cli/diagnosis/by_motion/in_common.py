"""Whether an effect acts in several recordings with what all of them have in common.

Within each recording alone an effect may take much with another value, or another sign, in each: that is none.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.normal_equations import step_of
from elid_cli.estimation.trajectory.block_sums import DAMPING
from elid_cli.estimation.trajectory.differing import errors_alone
from elid_cli.estimation.trajectory.fit import TrajectoryFit

CLEAR = 3.0
"""Standard errors by which an amplitude must be clear of 0 in a recording for its sign to be known."""


def has_one_sign(fit: TrajectoryFit, place: int) -> bool:
    """Whether no two recordings surely have an effect whose torques, with all its amplitudes, go against each other."""
    part = fit.unknowns.amplitudes_of(place)
    alone, errors = fit.alone[:, part], errors_alone(fit)[:, part]
    clear = alone[(np.abs(alone) > CLEAR * errors).any(axis=1)]
    products = clear @ fit.equations.straight.sum(axis=0)[part, part] @ clear.T
    return bool((products >= 0).all())


def common_gain(fit: TrajectoryFit, place: int) -> float:
    """Return the part of the squared error of one effect's joint that it takes away in all recordings together.

    With the amplitudes of the fit, or, where that is more, with the mean of what each recording alone says: a fit that
    counts large errors less may be that of some of them.
    """
    return max(_part_of(fit, place, z) for z in (fit.z, fit.alone.mean(axis=0)))


def _part_of(fit: TrajectoryFit, place: int, z: Array) -> float:
    """Return it with the amplitudes of z (U,), by first order.

    All other unknowns but shapes have their best values without the effect.
    """
    own, matrix = fit.unknowns, fit.equations.straight.sum(axis=0)
    held = np.zeros(own.count, dtype=bool)
    held[own.amplitudes_of(place)] = True
    gone = np.where(held, z, 0.0)
    held[own.amplitudes.stop : own.delays.start] = True
    held[own.delays] |= fit.delays == 0
    apart = gone - step_of(matrix, -matrix @ gone, DAMPING, held)
    rise = float(apart @ matrix @ apart) / float(fit.equations.counts.sum())
    return rise / (1.0 + rise)
