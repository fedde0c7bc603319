"""Steps of the numbers that change a robot or its drives, each with a fit of all else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

QUICK = 6
"""Most motions of a fit whose slopes are computed for one step of the numbers."""
GOES_ON = 0.02
"""Sum over the joints of the logarithm of the error's size by which a step that is within the errors must lower it for
more to follow, and by which one may raise it: an error that is not yet noise makes errors of the numbers too large."""
HALVINGS = 5
"""Lengths of a step that are tried, each half of the one before."""


def nearer_by(one: TrajectoryFit, other: TrajectoryFit) -> float:
    """Return the sum over the joints of the logarithm by which the error's size falls from another fit to one."""
    return float(np.log(other.equations.size / one.equations.size).sum())


def stepped_to(
    fit: TrajectoryFit, way: tuple[Array, Array, Array], most: float | Array,
    made: Callable[[Array], tuple[Robot, Sequence[Run]]], *, halved: bool,
) -> tuple[Array, TrajectoryFit] | None:  # fmt: skip
    """Return the numbers after a step, (count,), and the fit there; None where it is too far, or the motion runs away.

    Parameters
    ----------
    fit
        The fit where the step begins.
    way
        The numbers there, by how much they step, (count,) each, and by how much the fit's unknowns do, (U,).
    most
        Largest size of a number: one that is as large already, or becomes it without `halved`, wants to be farther.
    made
        The robot and the stretches with numbers (count,).
    halved
        Whether a step that ends farther from the motion than it began, or beyond `most`, is halved. By first order the
        bottom of a narrow valley is far away from its outside: a whole step jumps over it.
    """
    values, steps, along = way
    tried: list[tuple[Array, TrajectoryFit]] = []
    for part in 0.5 ** np.arange(HALVINGS if halved else 1):
        new = np.clip(values + part * steps, -most, most)
        if (np.abs(new) >= most).any():
            if (np.minimum(np.abs(values), np.abs(new)) >= most).any():
                return None
            if halved:
                continue
        again = refitted_as(fit, *made(new), fit.z + part * along)
        if again is None and not halved:
            return None
        tried += [] if again is None else [(new, again)]
        if again is not None and nearer_by(again, fit) > -GOES_ON:
            break
    return max(tried, key=lambda one: nearer_by(one[1], fit), default=None)


def refitted_as(fit: TrajectoryFit, robot: Robot, runs: Sequence[Run], z: Array) -> TrajectoryFit | None:
    """Return the fit of another robot or drives, started from z (U,); None where the simulated motion runs away."""
    own = fit.unknowns
    unknowns = replace(own, robot=robot, effects=fit.effects)
    tracked = [replace(Tracked.of(run), usual=item.usual) for run, item in zip(runs, fit.tracked, strict=True)]
    try:
        return fitted(unknowns, tracked, z, prompt=not fit.delays.any(), cycles=QUICK)
    except DataError:
        return None
