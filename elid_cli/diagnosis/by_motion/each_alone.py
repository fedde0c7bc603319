"""Recordings that are simulated clearly nearer each alone than together: what changed between them, such as a load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli.diagnosis.by_motion.carried import load_of
from elid_cli.diagnosis.by_motion.found import Found
from elid_cli.errors import DataError, RobotError
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.differing import Differing, differing_drives
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import declared_along
from elid_cli.model.runs import Run
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

DOUBTED = 1.5
"""Times the encoders' noise, at some joint, from which recordings are looked at alone."""
CLEARLY = 0.3
"""Logarithm, the mean over joints, by which the size of the error must fall with each recording's own values."""


@dataclass(frozen=True)
class Alone:
    """One recording, fitted alone."""

    mean_abs: float
    """Mean absolute error of the simulated positions over joints, rad (m), with what it asks for."""
    mass: float | None = None
    """Mass of the load that its motion asks for, kg; None: it asks for none."""
    fit: TrajectoryFit | None = field(default=None, repr=False, compare=False)
    """What it was fitted with, where it asks for no load."""


def each_alone(robot: Robot, runs: Sequence[Run], signals: Signals, found: Found) -> tuple[Alone, ...]:
    """Return what each recording alone asks for, where their motions are clearly nearer so; else nothing.

    Parameters
    ----------
    robot, runs, signals
        The robot as it is described, and the log of several recordings.
    found
        What a search found of all together.
    """
    together, count = found.done.after, found.done.after.unknowns.recordings
    if count < 2 or found.done.partial or not (together.above_noise(signals) >= DOUBTED).any():
        return ()
    told, sizes, weights = [], [], []
    for number in range(count):
        own = [replace(run, source=0) for run in runs if run.source == number]
        try:
            fit = fit_trajectory(robot, own, together.values, *declared_along(robot, own[0]))
        except (DataError, RobotError, IndexError):
            return ()
        load = load_of(fit)
        if load is not None and load.is_nearer(fit):
            fit, mass = load.fit, load.by.named(fit, load.values)[LINK_PARAMETERS.index("m")]
            told.append(Alone(_mean_abs(fit), float(mass) or None))
        else:
            told.append(Alone(_mean_abs(fit), fit=fit))
        sizes.append(np.log(fit.equations.size))
        weights.append(sum(len(run.t) for run in own))
    alone = np.average(sizes, axis=0, weights=weights)
    return tuple(told) if float(np.mean(np.log(together.equations.size) - alone)) > CLEARLY else ()


def beyond(known: Sequence[Differing], alone: Sequence[Alone], found: Found) -> tuple[Differing, ...]:
    """Return drive parameters that recordings alone do not agree on beyond those known; none where effects are named.

    These the fits of recordings alone do not hold.
    """
    fits = [one.fit for one in alone if one.fit is not None]
    if len(fits) < max(len(alone), 2) or found.items:
        return ()
    listed = {(item.joint, item.name) for item in known}
    return tuple(item for item in differing_drives(fits) if (item.joint, item.name) not in listed)


def _mean_abs(fit: TrajectoryFit) -> float:
    return float(np.mean(fit.mean_abs))
