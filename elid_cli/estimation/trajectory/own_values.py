"""Friction and torque offsets that changed between recordings: each has its own, beside what all have in common.

One value for all would leave a misfit at every other unknown, and look like an effect that the model lacks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.differing import drives_apart
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted
from elid_cli.estimation.trajectory.memory import has_memory
from elid_cli.estimation.trajectory.unknowns import Unknowns

SPOILT, CLEARLY = 0.02, 0.2
"""Sum over the joints of the logarithm by which the error's size may rise where values are one again, and must fall
where they are apart and more than noise is left."""
QUICK = 6
"""Most motions of a fit whose slopes are computed."""
Refitted = Callable[[Unknowns, TrajectoryFit, Array], tuple[TrajectoryFit, list[Array]]]
"""Fits other unknowns to the stretches of a fit, started from z (U,)."""


def with_own_values_again(fit: TrajectoryFit) -> TrajectoryFit:
    """Return a fit with values of every recording's own where recordings do not agree on one now."""

    def refit(unknowns: Unknowns, near: TrajectoryFit, z: Array) -> tuple[TrajectoryFit, list[Array]]:
        tracked = [replace(item) for item in near.tracked]
        return fitted(unknowns, tracked, z, prompt=not near.delays.any(), cycles=QUICK), []

    found, _ = with_own_values(fit, [], refit)
    return fit if found is fit else replace(found, held=fit.held)


def with_own_values(fit: TrajectoryFit, columns: list[Array], refit: Refitted) -> tuple[TrajectoryFit, list[Array]]:
    """Return the fit in which each recording has its own friction and offsets where these do not agree on one.

    Parameters
    ----------
    fit, columns
        The fit, in which some may have them, and how the positions of its stretches change with its unknowns,
        (N, n, U) each.
    refit
        Fits other unknowns.
    """
    own = fit.unknowns
    asked = drives_apart(fit)
    if asked == own.own:
        return fit, columns
    unknowns, alone = replace(own, own=asked), fit.alone[:, : own.drives]
    z = np.append(fit.z[: own.delays.stop], np.zeros(unknowns.count - own.delays.stop))
    z[unknowns.departures] = unknowns.departing((alone - alone.mean(axis=0)).reshape(len(alone), own.robot.n, -1))
    z[list(unknowns.owned)] = alone.mean(axis=0)[list(unknowns.owned)]
    try:
        found, moved = refit(unknowns, fit, unknowns.possible(z))
    except DataError:  # the motion ran away
        return fit, columns
    nearer = float(np.log(fit.equations.size / found.equations.size).sum())
    if not set(asked) - set(own.own):  # fewer unknowns may leave a little more
        return (found, moved) if nearer > -SPOILT else (fit, columns)
    # where something is missing, values of any kind differ between recordings, and having them apart explains little
    clear = nearer > CLEARLY or (nearer > 0.0 and not has_memory(found.equations))
    return (found, moved) if clear else (fit, columns)
