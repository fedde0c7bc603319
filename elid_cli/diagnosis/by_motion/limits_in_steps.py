"""Limits of torque in logs of simulators: found in smooth motion they make up for its steps, and come out too low."""

from __future__ import annotations

from collections.abc import Sequence

from elid_cli.diagnosis.by_motion.torque_limits import TorqueLimit, sharpened
from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.held_loops import clearly_nearer
from elid_cli.estimation.trajectory.simulator_steps import FINEST, USUAL, in_steps
from elid_cli.model.runs import Run


def runs_in_steps(runs: Sequence[Run], fit: TrajectoryFit, limits: Sequence[TorqueLimit]) -> list[Run]:
    """Return stretches in a simulator's steps where a fit with limits is clearly nearer to the motion so.

    Parameters
    ----------
    runs
        The stretches as they are described.
    fit, limits
        The fit of them in smooth motion with the limits that were found.
    """
    best, step, dt = fit, 0.0, runs[0].dt
    if not limits or any(run.drives.stepped is not None for run in runs):
        return list(runs)
    for each in USUAL:
        other = in_steps(fit, "explicit", dt / each) if dt / each >= FINEST else None
        if other is None:
            continue
        other, _ = sharpened(other, limits)
        if nearer_by(other, best) > 0:
            best, step = other, dt / each
    if not step or not clearly_nearer(best, fit):
        return list(runs)
    return [run.stepping("explicit", step) for run in runs]
