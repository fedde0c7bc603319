"""Which of two versions of a log of commands the simulated motion comes nearer to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.errors import DataError, LogError, RobotError
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

if TYPE_CHECKING:  # logs with torque, which are read alike, need no simulation
    from elid_cli.estimation.trajectory.first_fits import FirstFit
    from elid_cli.estimation.trajectory.fit import TrajectoryFit

CLEARLY = 10.0
"""Logarithm of the likelihood, of errors without a memory, by which one of the two is clearly nearer …"""
LEAST = 0.01
"""… and of the error's size, summed over joints, by which it must be at least …"""
REMEMBERED = 0.2
"""… or per joint, where the errors have a memory: what the model lacks is nearer with one of the two as well."""
THROUGHOUT = 4.0
"""Standard errors over the course of the log from which that is enough per joint where the nearer one leaves noise."""
LONGEST = 4.0
"""Seconds that each of the two fits may take, about."""
SOFTER = 5.0
"""Times as long as it takes where friction may fade in: it may where that is short enough."""
SHORTEST = 100
"""Samples of a stretch that is looked at."""


@dataclass(frozen=True)
class Nearer:
    """What simulated motions say of two versions of a log's commands."""

    by: float
    """Sum over the joints of the logarithm by which the error's size falls with the other version; negative where the
    one is nearer, 0 where neither is clearly."""
    at_noise: bool
    """Whether the nearer of them leaves about the encoders' noise at every joint."""
    delays: tuple[float, float]
    """By how much the motion is late against the commands of each, the mean over recordings, s."""
    bound: bool = False
    """Whether the other leaves a joint no viscous friction, as loops that hold their torque would."""


Known = dict[tuple[int, float, bool], tuple["TrajectoryFit", object]]
"""Fits of a robot to versions of a log: by `id` of the version, the part of it and whether friction may fade in. With
each, the first fit (`first_fits.FirstFit`) of the whole log that it is of; None of a part."""


def nearer_by_motion(
    robot: Robot, one: Signals, other: Signals, *, loops: bool = False, known: Known | None = None
) -> Nearer | None:
    """Return which version of a log the motion is nearer to; None where it cannot be simulated.

    Declared effects of another shape are left out, and of a long log its middle is looked at. With `loops` the one's
    drives hold their torque where the motion is nearer so. What is `known` of the robot, whose versions live as long,
    is not fitted again, and what is fitted is added to it.
    """
    from elid_cli.estimation.trajectory.changes import nearer_throughout
    from elid_cli.estimation.trajectory.fit import ABOVE
    from elid_cli.estimation.trajectory.held_loops import nearest_loops, negative
    from elid_cli.estimation.trajectory.memory import has_memory
    from elid_cli.estimation.trajectory.simulator_steps import with_steps
    from elid_cli.estimation.trajectory.unasked import is_known, seconds, without_shapes
    from elid_cli.model.effects.posed import posed

    robot = without_shapes(robot)
    if not is_known(robot):
        return None
    part, soft = min(1.0, LONGEST / seconds(robot, one)), is_quick(robot, one)
    known = {} if known is None else known
    try:
        for log in (one, other):
            if (id(log), part, soft) not in known:
                # a simulator's steps, too, seem half a sample ahead of held commands
                fit, first = _fit(robot, posed(robot), log, part, soft=soft)
                known[id(log), part, soft] = with_steps(fit, log), first
    except (DataError, LogError, RobotError):
        return None
    fits = [known[id(log), part, soft][0] for log in (one, other)]
    if loops:
        fits[0] = nearest_loops(fits[0])
    by = float(np.log(fits[0].equations.size / fits[1].equations.size).sum())
    count = max(sum(int(item.counts.sum()) for item in fits[0].tracked), 1)
    alone = not all(has_memory(fit.equations) for fit in fits)
    (near, far), log = (fits[::-1], other) if by > 0 else (fits, one)
    left = bool((near.above_noise(log) < ABOVE).all())
    throughout = left and nearer_throughout(near, far) > THROUGHOUT
    least = max(LEAST, CLEARLY / count) if alone else LEAST * robot.n if throughout else REMEMBERED * robot.n
    late = float(fits[0].delays.mean()), float(fits[1].delays.mean())
    return Nearer(by if abs(by) > least else 0.0, left, late, bool(negative(fits[1]).any()))


def first_of(known: Known, log: Signals) -> object:
    """Return the first fit of a version of a log among those that are known, None where there is none."""
    return next((first for (of, _, soft), (_, first) in known.items() if of == id(log) and soft), None)


def is_quick(robot: Robot, log: Signals) -> bool:
    """Whether the motion of a log is simulated fast enough for friction that may fade in."""
    from elid_cli.estimation.trajectory.unasked import seconds

    return SOFTER * seconds(robot, log) <= LONGEST


def _fit(
    robot: Robot, standing: Robot, log: Signals, part: float, *, soft: bool
) -> tuple[TrajectoryFit, FirstFit | None]:
    from elid_cli.estimation.trajectory.beginning import started_from
    from elid_cli.estimation.trajectory.decided import fit_trajectory
    from elid_cli.estimation.trajectory.first_fits import first_fit
    from elid_cli.estimation.trajectory.identification import commanded_runs, declared_along
    from elid_cli.model.effects.of_drives import as_acting

    assert log.recording is not None
    acting = as_acting(robot, log)
    runs = commanded_runs(_middle(log.recording, part), standing)
    start, declared = started_from(standing, acting), declared_along(standing, runs[0])
    if not soft:
        return fit_trajectory(standing, runs, start, *declared, soft=False), None
    first = first_fit(standing, runs, start, declared, log.first)  # of the whole log: friction may fade in
    return first.fit, first


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
