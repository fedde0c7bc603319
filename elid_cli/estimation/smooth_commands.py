"""What drives were told between the samples of a log: the last command, or more commands than the log holds.

A log that is slower than its commands holds one of ten, say. Taken as held for a sample these act late by half of it:
the motion seems ahead of its commands, and inertia and friction make up for stairs that no drive was given.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from elid_cli.errors import DataError, LogError
from elid_cli.estimation.commanded_rates import rated, with_rates
from elid_cli.estimation.interpolated_commands import as_interpolated, recording_on_lines
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.estimation.trajectory.nearer import Known, first_of, is_quick, nearer_by_motion
from elid_cli.logs.mapping.resolve import RATE
from elid_cli.model.effects import effect_that
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import command_torque
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals, check_signals, prepare
from elid_cli.signals.stepping_commands import commands_step

STAIRS, QUICKLY = 0.4, 0.1
"""Part of the torques' error that the stairs of held commands are beyond a delay, from which the motion is asked; the
latter where that is quick."""
AHEAD = 0.25
"""Part of a sample by which the torque must seem ahead of held commands where no motion can be simulated: half of one
where they change all the time."""
EARLIEST = 0.1
"""The same by which the motion may seem ahead of commands, held or smooth: drives that are told often act late by half
of their own time."""
ALIKE = 0.02
"""Logarithm of the error's size, per joint, by which smooth commands may be nearer where held ones need no delay and
smooth ones half a sample."""
WORSE = 1.2
"""Times by which torques may be predicted worse, which noise of the positions is in."""
SMOOTH = "smooth"
"""What `settings["commands"]` of a fit says whose commands change smoothly from sample to sample."""
INTERPOLATED = "interpolated"
"""The same whose commanded positions the drives interpolate."""
ON_LINES = (
    "the drives are taken to interpolate the commanded positions: to go to each on a line, over one period of "
    "commands, with which the motion is clearly nearer. A simulator of this robot must do so as well; a robot file "
    "does not hold it, and replay finds it again (--commands held: each command acts at once)"
)
NOTE = (
    "commands are taken to change smoothly from sample to sample, as where drives are told more often than is logged "
    "(--commands held: as held for their sample)"
)


def as_told(robot: Robot, signals: Signals) -> Signals:
    """Return a log of commands with these as the drives were told them, where its recording leaves that open.

    Commanded velocities that are not logged are looked for first, see `commanded_rates.with_rates`.

    Where least squares with held commands leave a doubt, the motion is simulated under both, and what is clearly nearer
    counts: where stairs of a sample would show, drives would be ahead of their commands, or viscous friction is
    negative, which half a sample makes of it where no delay is clear. Where neither is, and where no motion can be
    simulated, commands are smooth if drives would be ahead of held ones and are not of smooth ones. Other logs are
    returned as they are.
    """
    check_signals(signals, robot)
    signals = with_rates(robot, signals)
    recording = signals.recording
    if recording is None or not recording.commanded.all() or recording.smooth is not None or recording.interpolated:
        return signals
    signals = replace(signals, recording=replace(recording, inferred=True))
    held, smooth = replace(signals, recording=replace(recording, smooth=False, inferred=True)), as_read(signals)
    known: Known = {}
    try:
        lines, doubts = as_interpolated(robot, held, known)
        if lines is not None:
            return replace(lines, first=first_of(known, lines))
        found = _is_smooth(robot, held, smooth, known)
    except DataError:  # nothing can be fitted, which whoever asks will say
        return held
    assert held.recording is not None
    first = first_of(known, smooth if found else held)
    if found:
        return replace(smooth, first=first)
    warnings = (*held.recording.warnings, *doubts)
    return replace(held, recording=replace(held.recording, doubted=found is None, warnings=warnings), first=first)


def recorded_as_told(
    robot: Robot, recording: Recording, how: Literal["held", "smooth"] | None = None, like: Recording | None = None
) -> Recording:
    """Return a recording with commands as the drives were told them, see `as_told`.

    Parameters
    ----------
    robot, recording
        The log and the robot that made it.
    how
        What the user says of commands between samples.
    like
        The same log of which all was decided; None: it is decided here.
    """
    if how is not None:
        recording = replace(recording, smooth=how == "smooth")
    if not recording.commanded.all() or (recording.smooth is not None and "dq_des" in recording.commands):
        return recording
    if like is not None:
        same = replace(recording, smooth=like.smooth)
        same = recording_on_lines(same) if like.interpolated else same
        decided = like.sources.get("dq_des") == RATE and "dq_des" not in same.commands
        return rated(robot, same) if decided else same
    try:
        return as_told(robot, prepare(recording, robot)).recording or recording
    except (DataError, LogError):  # no joint moves, or too short
        return recording


def as_read(signals: Signals, *, smooth: bool = True) -> Signals:
    """Return a log of commands alone whose commands change smoothly from sample to sample, or are held."""
    assert signals.recording is not None
    recording = replace(signals.recording, smooth=smooth)
    tau, told = command_torque(recording)
    return replace(signals, tau=tau, command_torque=told, recording=recording)


def noted(found: Identification, recording: Recording | None) -> Identification:
    """Return a fit, which says so where its log has such commands, or drives that are told rates which it lacks."""
    if recording is None:
        return found
    settings = dict(found.settings)
    new = recording.changing and "commands" not in settings
    if recording.interpolated:
        settings["commands"] = INTERPOLATED
    if recording.smooth:
        settings["commands"] = SMOOTH
    if recording.sources.get("dq_des") == RATE:
        settings["dq_des"] = RATE
    note = ON_LINES if recording.interpolated else NOTE
    return replace(found, notes=(*found.notes, note) if new else found.notes, settings=settings)


def _is_smooth(robot: Robot, held: Signals, smooth: Signals, known: Known) -> bool | None:
    """Return whether commands are smooth; None where the log does not say. Fits that are made join those known."""
    assert held.recording is not None
    if commands_step(held.recording):
        return False
    before = _least_squares(robot, held)
    late = _delay(before)
    ahead = late < -AHEAD * held.dt
    named = zip(before.robot.parameter_names(), before.standard.tolist(), strict=True)
    driving = late < 0.5 * held.dt and any(name.kind == "fv" and value < 0 for name, value in named)
    doubted = (
        late < -EARLIEST * held.dt or driving or _stairs(held, before) > (QUICKLY if is_quick(robot, held) else STAIRS)
    )
    if not doubted:
        return None
    nearer = nearer_by_motion(robot, held, smooth, known=known)
    if nearer is not None and nearer.bound and nearer.by >= 0:
        looped = nearer_by_motion(robot, held, smooth, loops=True, known=known)
        if looped is not None and looped.by <= 0:
            return False
    if nearer is not None:
        if nearer.at_noise and nearer.by < ALIKE * robot.n and _half_late(nearer.delays, held.dt):
            return None
        if nearer.by or not nearer.at_noise:
            return nearer.by > 0 if nearer.by else None
        # noise alone is left of both: a drive that is ahead of its commands is none
        return (nearer.delays[0] < -EARLIEST * held.dt and nearer.delays[1] > -EARLIEST * held.dt) or None
    after = _least_squares(robot, smooth)
    return (ahead and _delay(after) > -EARLIEST * held.dt and _error(after) <= WORSE * _error(before)) or None


def _half_late(delays: tuple[float, float], dt: float) -> bool:
    """Whether motion at held commands' own time is half a sample late against smooth ones: held ones, blurred."""
    return abs(delays[0]) < EARLIEST * dt and abs(delays[1] - 0.5 * dt) < EARLIEST * dt


def _least_squares(robot: Robot, signals: Signals) -> Identification:
    from elid_cli.estimation.identify import identify

    # effects, whose shapes take long to fit, change little of what is asked here
    return identify(replace(robot, effects=()), signals, EstimateOptions(fit="torque", guards=False))


def _stairs(held: Signals, found: Identification) -> float:
    """Return the stairs of held commands beyond a delay, as a part of the torques' error, of the joint with most."""
    assert held.recording is not None
    sizes = np.sqrt(np.nanmean((held.tau - held.recording.tau) ** 2, axis=0))
    parts = [size / found.error[name].rms for name, size in zip(held.joints, sizes, strict=True)
             if name in found.error and found.error[name].rms > 0]  # fmt: skip
    return float(max(parts, default=0.0))


def _delay(found: Identification) -> float:
    """Return the median of the delays that were found of drives, s; 0 where none was."""
    name = effect_that(nuisance="delay").name
    delays = [item.parameters["delay"] for item in found.nuisances if item.effect == name]
    return float(np.median(delays)) if delays else 0.0


def _error(found: Identification) -> float:
    """Return the error of the predicted torques as a part of them, the mean over joints."""
    sizes = [max(item.relative, 1e-9) for item in found.error.values()]
    return float(np.exp(np.mean(np.log(sizes)))) if sizes else 0.0
