"""Limits of torque in the robot file that the drives do not have: the motion shows more than they allow.

A URDF must say an effort, and often a placeholder says it. The computed torque is cut there, and so is the simulated
one: nothing else can bring such a motion near.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli.diagnosis.by_motion.torque_limits import LEAST, limited, with_limits
from elid_cli.diagnosis.result import FoundEffect
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.changes import CLEARLY, nearer_by
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.first_fits import FirstFit, first_fit
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

OFTEN = 0.002
"""Part of the samples in which commands must ask for more than a limit."""


@dataclass(frozen=True)
class Raised:
    """A robot without limits that its drives do not have."""

    robot: Robot
    """Without them."""
    signals: Signals
    """With torques that are not cut at those limits."""
    runs: tuple[Run, ...]
    before: TrajectoryFit | None
    """The fit within the limits of the robot file; None where that runs away."""
    effects: tuple[FoundEffect, ...]


def raised_limits(
    robot: Robot, signals: Signals, runs: Sequence[Run], declared: tuple[Sequence[Effect], Sequence[float]],
    first: FirstFit | None = None,
) -> Raised | None:  # fmt: skip
    """Return the robot without limits that the motion refutes; None where it refutes none.

    Parameters
    ----------
    robot, signals, runs
        The robot, the log, and its stretches that commands drive.
    declared
        Effects that the robot declares, and their amplitudes.
    first
        The first fit of the motion, where it is known.
    """
    peaks = _asked_beyond(robot, runs)
    if not peaks:
        return None
    try:
        before = first_fit(robot, runs, started_from(robot, signals), declared, first).fit
    except DataError:
        before = None  # cut so low, the motion runs away
    while peaks:
        other = with_limits(robot, dict.fromkeys(peaks))
        free = [run.within(other.torque_limits) for run in runs]
        right = _uncut(signals, list(peaks))
        try:
            fit = fit_trajectory(other, free, started_from(other, right), *declared)
        except DataError:
            return None
        if before is None:
            return Raised(other, right, tuple(free), None, _effects(robot, peaks, dict.fromkeys(peaks, 1.0)))
        gains = _gains(before, fit, list(peaks))
        kept = {joint: peak for joint, peak in peaks.items() if gains[joint] >= LEAST}
        if not kept:  # there may be limits all the same, others than the file's, that are found without those
            fit, limits = limited(fit, ())
            gains, found = _gains(before, fit, list(peaks)), {item.joint for item in limits}
            kept = {joint: peak for joint, peak in peaks.items() if joint in found and gains[joint] >= LEAST}
        if kept == peaks:
            if nearer_by(fit, before) <= CLEARLY:
                return None
            return Raised(other, right, tuple(free), before, _effects(robot, peaks, gains))
        peaks = kept
    return None


def _asked_beyond(robot: Robot, runs: Sequence[Run]) -> dict[int, float]:
    """Return the largest torque that commands ask for, N·m (N), of joints where it is often above the limit."""
    limit, asked = robot.torque_limits, []
    for run in runs:
        if run.told is not None:
            x = run.near[:, : robot.n]
            asked.append(np.abs(run.told - run.drives.kp * x - run.drives.kd * np.gradient(x, run.dt, axis=0)))
    if not asked or not np.isfinite(limit).any():
        return {}
    every = np.concatenate(asked)
    joints = np.flatnonzero(np.mean(every > limit, axis=0) > OFTEN).tolist()
    return {joint: float(every[:, joint].max()) for joint in joints}


def _uncut(signals: Signals, joints: Sequence[int]) -> Signals:
    """Return the signals with the torques of some joints as the commands ask for them."""
    recording = signals.recording
    if recording is None or signals.command_torque is None:
        return signals
    tau = signals.tau.copy()
    kp, kd = (recording.commands[name][:, joints] for name in ("kp", "kd"))
    motion = signals.motion
    tau[:, joints] = signals.command_torque[:, joints] - kp * motion.theta[:, joints] - kd * motion.dtheta[:, joints]
    return replace(signals, tau=tau)


def _gains(before: TrajectoryFit, after: TrajectoryFit, joints: Sequence[int]) -> dict[int, float]:
    bare, left = (fit.equations.lighter.sum(axis=0) for fit in (before, after))
    return {joint: float(1.0 - left[joint] / max(bare[joint], 1e-300)) for joint in joints}


def _effects(robot: Robot, peaks: Mapping[int, float], gains: Mapping[int, float]) -> tuple[FoundEffect, ...]:
    kind = effect_that(of_drive="limit")
    (limit,) = kind.shapes
    return tuple(
        FoundEffect(
            kind.name, robot.joint_names[joint], {limit.name: peak}, {}, gains[joint],
            f"the drive delivers more than the {robot.torque_limits[joint]:g} of the robot file: as much as this log "
            "asks for, or more",
        )
        for joint, peak in peaks.items()
    )  # fmt: skip
