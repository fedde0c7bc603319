"""The motion simulated with bodies as least squares find them, beside what a search found with those of the file.

Effects of single joints imitate masses that are wrong, each a little. Where the bodies that the torque shows bring the
motion clearly nearer than all of these, they are what is missing first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError, RobotError
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import ABOVE, TrajectoryFit
from elid_cli.estimation.trajectory.identification import declared_along
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

DOUBTED = 1.2
"""Times the encoders' noise up to which nothing is left."""
CLEARLY = 0.3
"""Logarithm by which the error's size must fall, the mean over the joints that effects leave more than noise at."""


def with_free_bodies(
    robot: Robot, found: Identification, runs: Sequence[Run], signals: Signals, others: Sequence[TrajectoryFit]
) -> TrajectoryFit | None:
    """Return the fit with the bodies of least squares, where it comes clearly nearer; None where it does not.

    Parameters
    ----------
    robot, found
        The robot as it is described, and what least squares say of the log.
    runs, signals
        The log.
    others
        The fit with all that a search found, and fits of what it names beside that.
    """
    left = [_doubted(other.above_noise(signals)) for other in others]
    if not all(above.any() for above in left):
        return None
    bodies = replace(identified_robot(found), effects=robot.effects)
    try:
        fit = fit_trajectory(bodies, runs, started_from(bodies, signals), *declared_along(bodies, runs[0]))
    except (DataError, RobotError):
        return None
    falls = [np.log(other.equations.size / fit.equations.size) for other in others]
    nearer = [fall[above].mean() > CLEARLY and fall.mean() > 0 for fall, above in zip(falls, left, strict=True)]
    return fit if all(nearer) else None


def _doubted(ratios: Array) -> NDArray[np.bool_]:
    """Return the joints, (n,), that more than noise is left at; where there are none, those with a little more."""
    above = ratios >= ABOVE
    return np.asarray(above if above.any() else ratios >= DOUBTED)
