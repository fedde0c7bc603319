"""Which of two versions of a log of commands the simulated motion comes nearer to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.errors import DataError, LogError, RobotError
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

CLEARLY = 10.0
"""Logarithm of the likelihood, of errors without a memory, by which one of the two is clearly nearer …"""
LEAST = 0.01
"""… and of the error's size, summed over joints, by which it must be at least …"""
REMEMBERED = 0.1
"""… or where the errors have a memory."""
LONGEST = 4.0
"""Seconds that each of the two fits may take, about."""
SHORTEST = 100
"""Samples of a stretch that is looked at."""


def nearer_by_motion(robot: Robot, one: Signals, other: Signals) -> float:
    """Return by how much the motion is nearer with the commands of another version of a log; negative: of the one.

    That is the sum over the joints of the logarithm by which the error's size falls; 0 where the motion does not
    clearly say, or cannot be simulated. Declared effects of another shape are left out, and of a long log its middle
    is looked at.
    """
    from elid_cli.estimation.trajectory.decided import fit_trajectory
    from elid_cli.estimation.trajectory.identification import commanded_runs, declared_along, started_from
    from elid_cli.estimation.trajectory.memory import has_memory
    from elid_cli.estimation.trajectory.unasked import is_known, seconds, without_shapes
    from elid_cli.model.effects.of_drives import as_acting
    from elid_cli.model.effects.posed import posed

    robot = without_shapes(robot)
    if not is_known(robot):
        return 0.0
    part = min(1.0, LONGEST / seconds(robot, one))
    standing, sizes, alone, count = posed(robot), [], False, 0
    for log in (one, other):
        assert log.recording is not None
        try:
            acting = as_acting(robot, log)
            runs = commanded_runs(_middle(log.recording, part), standing)
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


def _middle(recording: Recording, part: float) -> Recording:
    """Return the middle part of every stretch of a recording."""
    if part >= 1.0:
        return recording
    kept = []
    for segment in recording.segments:
        length = min(max(round(part * len(segment)), SHORTEST), len(segment))
        start = segment.start + (len(segment) - length) // 2
        kept.append(replace(segment, start=start, stop=start + length))
    return replace(recording, segments=tuple(kept))
