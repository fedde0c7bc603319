"""Which of two versions of a log of commands the simulated motion comes nearer to."""

from __future__ import annotations

import numpy as np

from elid_cli.errors import DataError, LogError, RobotError
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

CLEARLY = 10.0
"""Logarithm of the likelihood, of errors without a memory, by which one of the two is clearly nearer …"""
LEAST = 0.01
"""… and of the error's size, summed over joints, by which it must be at least …"""
REMEMBERED = 0.1
"""… or where the errors have a memory."""


def nearer_by_motion(robot: Robot, one: Signals, other: Signals) -> float:
    """Return by how much the motion is nearer with the commands of another version of a log; negative: of the one.

    That is the sum over the joints of the logarithm by which the error's size falls; 0 where the motion does not
    clearly say, or cannot be simulated.
    """
    from elid_cli.estimation.trajectory.decided import fit_trajectory
    from elid_cli.estimation.trajectory.identification import commanded_runs, declared_along, started_from
    from elid_cli.estimation.trajectory.memory import has_memory
    from elid_cli.estimation.trajectory.unasked import LONGEST, is_known, seconds
    from elid_cli.model.effects.of_drives import as_acting
    from elid_cli.model.effects.posed import posed

    if not is_known(robot) or 2.0 * seconds(robot, one) > LONGEST:
        return 0.0
    standing, sizes, alone, count = posed(robot), [], False, 0
    for log in (one, other):
        assert log.recording is not None
        try:
            acting = as_acting(robot, log)
            runs = commanded_runs(log.recording, standing)
            fit = fit_trajectory(
                standing, runs, started_from(standing, acting), *declared_along(standing, runs[0]), soft=False
            )
        except (DataError, LogError, RobotError):
            sizes.append(np.inf)
            continue
        sizes.append(float(np.log(fit.equations.size).sum()))
        alone = alone or not has_memory(fit.equations)
        count = sum(int(item.counts.sum()) for item in fit.tracked)
    if not np.isfinite(sizes).any():
        return 0.0
    nearer = sizes[0] - sizes[1]
    least = max(LEAST, CLEARLY / max(count, 1)) if alone else REMEMBERED
    return nearer if abs(nearer) > least else 0.0
