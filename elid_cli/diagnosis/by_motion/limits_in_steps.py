"""Limits of torque beside loops that hold their torque, or a simulator's steps.

Found in smooth motion they make up for these, and come out too low; and where limits are missing these do not show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from elid_cli.diagnosis.by_motion.torque_limits import TorqueLimit, sharpened
from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.held_loops import clearly_nearer, of_loops
from elid_cli.estimation.trajectory.loop_periods import OFTEN
from elid_cli.estimation.trajectory.simulator_steps import FINEST, USUAL, in_steps
from elid_cli.model.runs import Run

SHORTEST = 9e-4
"""s; shortest period of loops that are tried: limits show it far better than smooth torques do."""


def runs_in_steps(runs: Sequence[Run], fit: TrajectoryFit, limits: Sequence[TorqueLimit]) -> list[Run]:
    """Return stretches under loops that hold, or in steps, where a fit with limits is clearly nearer to the motion so.

    Parameters
    ----------
    runs
        The stretches as they are described.
    fit, limits
        The fit of them in smooth motion with the limits that were found.
    """
    if not limits or any(run.drives.stepped is not None or run.drives.held is not None for run in runs):
        return list(runs)
    best, timed = fit, None
    for other, change in _tried(fit, runs[0].dt):
        other, _ = sharpened(other, limits)
        if nearer_by(other, best) > 0:
            best, timed = other, change
    if timed is None or not clearly_nearer(best, fit):
        return list(runs)
    return [timed(run) for run in runs]


def _tried(fit: TrajectoryFit, dt: float) -> Iterator[tuple[TrajectoryFit, Callable[[Run], Run]]]:
    """Yield the fit in steps and under loops of usual lengths, and what makes a stretch so."""
    for each in USUAL:
        step = dt / each
        if step >= FINEST and (found := in_steps(fit, "explicit", step)) is not None:
            yield found, lambda run, step=step: run.stepping("explicit", step)  # type: ignore[misc]
    for often in (1, *OFTEN):
        if dt / often >= SHORTEST and (found := of_loops(fit, often, dt)) is not None:
            held = found.tracked[0].run.drives.held
            yield found, lambda run, held=held: run.holding(held)  # type: ignore[misc]
