"""Commanded positions that drives interpolate: from the last one to the next on a line, over one period of commands.

Many servos do. They reach a command a period late, and what a log holds as a stair was a ramp: beside stairs half a
period late, as which a fit takes it, inertia and friction, filters of velocity and soft friction make up for the rest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.nearer import Known, nearer_by_motion
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import at_limit, command_torque, held_mean
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals
from elid_cli.signals.stepping_commands import commands_step

LATE = 0.25
"""Part of a period of commands by which a motion must seem late against stairs for ramps to be asked: a half is due."""
EARLIEST = 0.1
"""Part of a sample by which a motion may seem ahead of ramps: drives that act before they are told are none."""
BY_FAR = 0.7
"""Logarithm, per joint, by which the error's size must fall where more than noise is left with ramps: what else a model
lacks may look so. Measured: 1.6 to 5 for ramps, beside filters of velocity and Stribeck friction as well; 0.7 at most
for loops, filters, backlash and springs under stairs, and drives are ahead of ramps then; for targets that a drive
filters over a third of their period, 0.7 at most as well."""
LITTLE = 0.1
"""The same by which it falls where drives may filter what they are told, which nothing here simulates."""
FILTERED = (
    "the motion seems late by {:.2g} ms of the {:.2g} ms from one command to the next, and is nearer, though not near, "
    "with commands that the drives interpolate: drives that filter the commanded positions look so, which elid does "
    "not hold. Friction and inertia make up for it, and may be biased by many of their standard errors"
)


def as_interpolated(robot: Robot, held: Signals, known: Known) -> tuple[Signals | None, tuple[str, ...]]:
    """Return a log whose drives interpolate the commanded positions, where the motion is clearly nearer so; else None.

    With it, what to warn of where it is nearer, but neither clearly nor near.

    Parameters
    ----------
    robot, held
        The robot, and the log with commands that are held for their sample.
    known
        Fits that were made of versions of the log; those that are made join them.
    """
    recording = held.recording
    if recording is None or not commands_step(recording) or period_of(recording) < 2:
        return None, ()
    late = nearer_by_motion(robot, held, held, known=known)
    period = period_of(recording) * recording.dt
    if late is None or late.delays[0] < LATE * period:
        return None, ()
    lines = on_lines(held)
    nearer = nearer_by_motion(robot, held, lines, known=known)
    if nearer is None:
        return None, ()
    ahead = nearer.delays[1] < -EARLIEST * recording.dt
    if not ahead and nearer.by > (0.0 if nearer.at_noise else BY_FAR * robot.n):
        return lines, ()
    doubted = nearer.by > LITTLE * robot.n and not late.at_noise
    return None, (FILTERED.format(1e3 * late.delays[0], 1e3 * period),) if doubted else ()


def on_lines(signals: Signals) -> Signals:
    """Return a log of commands whose drives interpolate the commanded positions."""
    assert signals.recording is not None
    recording = recording_on_lines(signals.recording)
    tau, told = command_torque(recording)
    return replace(signals, tau=tau, command_torque=told, recording=recording)


def recording_on_lines(recording: Recording) -> Recording:
    """Return a recording of commands with the positions that interpolating drives are told, and torques by them."""
    stairs, lines = recording.commands["q_des"], interpolated(recording)
    bounds = [(segment.start, segment.stop) for segment in recording.segments]
    # computed torques hold a held command's mean over the sample
    more = recording.commands["kp"] * (held_mean(lines, bounds) - held_mean(stairs, bounds))
    tau = np.where(recording.commanded & ~at_limit(recording.tau), recording.tau + more, recording.tau)
    return replace(recording, tau=tau, commands={**recording.commands, "q_des": lines}, interpolated=True,
                   smooth=None, inferred=False, doubted=False)  # fmt: skip


def period_of(recording: Recording) -> int:
    """Return the usual time from one change of the commanded positions to the next, in samples; 0 without changes."""
    told, between = recording.commands["q_des"], list[Array]()
    for segment in recording.segments:
        changes = np.flatnonzero(np.any(np.diff(told[segment.start : segment.stop], axis=0) != 0, axis=1))
        between.append(np.diff(changes))
    every = np.concatenate([np.zeros(0, dtype=int), *between])
    return int(np.median(every)) if len(every) else 0


def interpolated(recording: Recording) -> Array:
    """Return commanded positions at the samples, rad (m), (N, n), of drives that go to each on a line in a period."""
    period, found = period_of(recording), recording.commands["q_des"].copy()
    for segment in recording.segments:
        own = found[segment.start : segment.stop].copy()
        # the mean over the last period of what was held
        before = np.concatenate([np.zeros((period, own.shape[1])), own - own[0]])
        total = np.concatenate([np.zeros((1, own.shape[1])), np.cumsum(before, axis=0)])
        found[segment.start : segment.stop] = own[0] + (total[period : period + len(own)] - total[: len(own)]) / period
    return found
