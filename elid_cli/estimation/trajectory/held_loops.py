"""Drives whose loops run at the log's rate, their torque held from sample to sample: what the motion says of that.

To first order half a sample's delay of positions and velocities is viscous friction and inertia: kp dt/2 less of the
one, kd dt/2 less of the other. What is left of it beyond that shows in fast motion where nothing else is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.result import Nuisance
from elid_cli.estimation.trajectory.changes import CLEARLY, SURE, nearer_by
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted
from elid_cli.estimation.trajectory.memory import has_memory
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.model.effects import effect_that, of_drives
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import declared_loops
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

NEAR = 2.0
"""Times the encoders' noise, at any joint, up to which loops are asked for: where more is left, something else is
missing."""
AT_NOISE = 1.03
"""The same up to which nothing else is left."""
WHOLE = 0.25
"""Part of a sample by which a delay may be off a whole number of samples: a loop that runs at the log's instants is
told its commands at these."""
SHOWN, SMALL = 3.0, 0.03
"""Standard errors, and part of a value, beyond which a change is worth asking for."""


def less_by_holding(recording: Recording) -> Array:
    """Return by how much inertia and viscous friction come out too small beside loops that hold, (n, 2)."""
    gains = np.stack([np.nanmean(recording.commands[name], axis=0) for name in ("kd", "kp")], axis=1)
    found: Array = 0.5 * recording.dt * gains
    return found


def matters(fit: TrajectoryFit, recording: Recording) -> NDArray[np.bool_]:
    """Return of which inertia and viscous friction that would be worth a word, (n, 2)."""
    errors = fit.unknowns.joint_values(fit.deviation)[:, [0, 2]]
    least = np.maximum(SHOWN * errors, SMALL * fit.values[:, [0, 2]])
    found: NDArray[np.bool_] = fit.shown[:, [0, 2]] & (less_by_holding(recording) > least)
    return found


def with_held_loops(fit: TrajectoryFit, signals: Signals) -> TrajectoryFit:
    """Return the fit under drives that hold their torque for a sample where the motion is clearly nearer so.

    A fit of loops that act all the time, which is clearly nearer and leaves the encoders' noise, says so
    (`TrajectoryFit.at_once`). One of a robot that declares its loops, and one that leaves more than noise, is returned.
    """
    recording = signals.recording
    above = fit.above_noise(signals)
    declared = declared_loops(fit.unknowns.robot).any() or any(item.run.drives.held is not None for item in fit.tracked)
    if recording is None or recording.smooth or declared or (above > NEAR).any() or not matters(fit, recording).any():
        return fit  # drives that are told more often than is logged act more often, too
    away = np.abs(fit.delays / recording.dt - np.round(fit.delays / recording.dt))
    again = None if (away > WHOLE).any() else _refitted(fit)
    if again is None:
        return fit
    by, least = nearer_by(again, fit), 0.5 * SURE**2 / sum(int(item.counts.sum()) for item in fit.tracked)
    if by > (CLEARLY if has_memory(again.equations) else least):
        return again
    return replace(fit, at_once=bool(by < -least and (above <= AT_NOISE).all()))


def looped(
    robot: Robot, signals: Signals, runs: Sequence[Run], start: Array,
    declared: tuple[Sequence[Effect], Sequence[float]],
) -> list[Run]:  # fmt: skip
    """Return stretches under drives that hold their torque for a sample, where a fit is clearly nearer so.

    Parameters
    ----------
    robot, signals, runs
        The robot, the log, and its stretches that commands drive.
    start, declared
        Drive parameters to start from, (n, 4), and effects that the robot declares, with their amplitudes.
    """
    try:
        fit = with_held_loops(fit_trajectory(robot, runs, start, *declared), signals)
    except DataError:
        return list(runs)
    return [run if item.run.drives.held is None else run.holding(item.run.drives.held > 0)
            for run, item in zip(runs, fit.tracked, strict=True)]  # fmt: skip


def _refitted(fit: TrajectoryFit) -> TrajectoryFit | None:
    """Return the fit under drives that hold their torque for a sample; None where the simulated motion runs away."""
    own = fit.unknowns
    which: NDArray[np.bool_] = np.any([item.run.drives.kp > 0 for item in fit.tracked], axis=0)
    tracked = [replace(Tracked.of(item.run.holding(which)), usual=item.usual) for item in fit.tracked]
    try:
        found = fitted(own, tracked, fit.z, prompt=False)
    except DataError:
        return None
    return replace(found, apart=fit.apart, doubted=fit.doubted)


def as_held(robot: Robot, fit: TrajectoryFit, signals: Signals) -> Signals:
    """Return the signals with torques of drives that a fit found to hold them; declared ones were before."""
    held = fit.tracked[0].run.drives.held
    return signals if held is None or declared_loops(robot).any() else of_drives.with_held_loops(signals, held > 0)


def loops_of(robot: Robot, fit: TrajectoryFit) -> tuple[Nuisance, ...]:
    """Return the drives of a fit that hold their torque, as channels' faults are told."""
    holds = [(item.run.drives.held, item.run.dt) for item in fit.tracked if item.run.drives.held is not None]
    if not holds:
        return ()
    kind = effect_that(of_drive="hold")
    which, dt = holds[0]
    return tuple(Nuisance(kind.name, robot.joint_names[k], {kind.amplitudes[0].name: dt}, {})
                 for k in np.flatnonzero(which).tolist())  # fmt: skip
