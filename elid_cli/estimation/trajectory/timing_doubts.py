"""What a log hardly shows of when its drives act: standard errors count what it would change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.runs import Run


def step_of(run: Run) -> float:
    """Return the length of the steps of a stretch, s."""
    return run.dt / (len(run.drives.told) // (len(run.t) - 1))


def counting(fit: TrajectoryFit, shifts: Sequence[Array]) -> TrajectoryFit:
    """Return a fit whose errors count shifts of the drive parameters, (n * 4,) each."""
    covariance, drives = fit.covariance.copy(), fit.unknowns.drives
    for shift in shifts:
        covariance[:drives, :drives] += np.outer(shift, shift)
    return replace(fit, covariance=covariance, shifts=(*fit.shifts, *shifts))


def as_doubtful(fit: TrajectoryFit, other: TrajectoryFit) -> TrajectoryFit:
    """Return a fit whose errors count what those of another one do, of the same drives in the same log."""
    return replace(counting(fit, other.shifts), ahead=other.ahead, loops=other.loops,
                   either=other.either, unseen=other.unseen)  # fmt: skip
