"""Limits of torque that a log reaches in few short peaks, told by simulating with them.

What such peaks leave along the measured motion drowns in what noise of the positions makes of the torque there. Of the
simulated motion they are the largest errors: it is simulated with limits within the peaks, all else as it is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.beside import moved_by_runs
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.model.runs import Run

USUAL, HIGHER = 0.95, 1.15
"""Part of the log that a joint's usual torque is not exceeded in, and how many times as large its peaks must be."""
RARE, MOST = 0.1, 0.6
"""Part of the samples, and of the squared error that must lie in the worst of these."""
FIRST, FINER, NARROWED = 8, 5, 3
"""Limits tried at first and about the best, and times that they are."""


def of_peaks(fit: TrajectoryFit, joint: int) -> tuple[float, float]:
    """Return the limit of a joint's torque, N·m (N), that brings its motion nearest, and what it gains; 0: none."""
    torque = np.abs(np.concatenate([_asked(item)[:, joint] for item in fit.tracked]))
    usual, most = float(np.quantile(torque, USUAL)), float(torque.max())
    before = _squares(fit, joint, None)
    worst = np.sort(before)[-max(int(RARE * len(before)), 1) :]
    if most < HIGHER * usual or worst.sum() < MOST * before.sum():
        return 0.0, 0.0
    tried, best, left = np.linspace(usual, most, FIRST + 1)[:-1], usual, np.inf
    for _ in range(1 + NARROWED):
        try:
            sums = _squares(fit, joint, tried).sum(axis=0)
        except DataError:
            return 0.0, 0.0
        place = int(np.argmin(sums))
        best, left = float(tried[place]), float(sums[place])
        tried = np.linspace(tried[max(place - 1, 0)], tried[min(place + 1, len(tried) - 1)], FINER)
    return best, 1.0 - left / max(float(before.sum()), 1e-300)


def _asked(item: Tracked) -> Array:
    """Return the torque that commands ask for along a stretch's simulated motion, N·m (N), (N, n)."""
    drives, n = item.run.drives, item.run.measured.shape[1]
    told = np.zeros((len(item.x), n)) if item.run.told is None else item.run.told
    found: Array = told - drives.kp * item.x[:, :n] - drives.kd * item.v[:, :n]
    return found


def _squares(fit: TrajectoryFit, joint: int, limits: Array | None) -> Array:
    """Return the squared errors of a joint's simulated positions, (N,), or with limits of its torque, (N, L)."""

    def within(limit: float) -> Callable[[Run], Run]:
        def cut(run: Run) -> Run:
            own = run.drives.limit.copy()
            own[joint] = limit
            return run.within(own)

        return cut

    n, found = fit.unknowns.robot.n, []
    moved = None if limits is None else moved_by_runs(fit, [within(limit) for limit in limits.tolist()])
    for k, item in enumerate(fit.tracked):
        error = np.nan_to_num(item.x[:, :n] + item.finer - item.run.measured)[item.counts, joint]
        found.append(error**2 if moved is None else (error[:, None] + moved[k][item.counts, joint]) ** 2)
    return np.concatenate(found)
