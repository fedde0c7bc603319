"""Which unknowns a trajectory fit has beside drive parameters and effects: a delay, and friction that fades in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.regression.normal_equations import jackknife
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted_with_columns
from elid_cli.estimation.trajectory.memory import has_memory
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.own_values import with_own_values
from elid_cli.estimation.trajectory.softening import Refit, columns_of, softened
from elid_cli.estimation.trajectory.unknowns import PARAMETERS, Unknowns, started
from elid_cli.model.coordinates import coordinates_of
from elid_cli.model.drives import parts_of_loops
from elid_cli.model.effects.effect import Effect
from elid_cli.model.linearised import Linearised
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

SHOWN = 2.0
"""Standard errors from which a delay is an unknown: in slow motion viscous friction and a delay are one, and a delay
that the log does not show would only take the friction's precision. One that is held though it is there bends armature
and friction without a word: where it was 2.8 errors off, an armature came out twice too large."""

LITTLE = 1e-3
"""Part of the value that a fit began with which is as good as none."""
AGAIN = (2e-2, 0.0)
"""Width, rad/s (m/s), and lead, s, of soft friction that a fit begins anew with."""
NEXT = 0.05
"""Part of what a fit may begin with which is next to none."""
PART = 0.1
"""Part of a joint's own inertia, torque and damping gain that inertia, friction and viscous friction begin with."""
AHEAD = 8.0
"""Standard errors from which a delay of a motion ahead of its commands is an unknown …"""
NEARER = 0.2
"""… and the sum over the joints of the logarithm by which the error then falls, unless only noise is left."""
WITHIN = 0.2
"""Part of a loop's period up to which a delay is one of whole periods."""


def fit_trajectory(
    robot: Robot,
    runs: Sequence[Run],
    start: Array,
    effects: Sequence[Effect] = (),
    amplitudes: Sequence[float] = (),
    *,
    late: bool = True,
    soft: bool = True,
    tell: Callable[[float], None] | None = None,
) -> TrajectoryFit:
    """Fit the drive parameters of a robot to stretches of logs.

    Parameters
    ----------
    robot
        Its bodies' parameters must be known.
    runs
        Stretches driven by commands, of one or more recordings.
    start
        Drive parameters to start from, (n, 4).
    effects
        Effects whose amplitudes are fitted along, in their shapes.
    amplitudes
        Their amplitudes to start from; 0 where not given.
    late
        Whether every recording may have a delay between commands and motion, where the log shows one.
    soft
        Whether friction may fade in over a speed, where the log asks for it.
    tell
        Called with the part of the work that is done, at most: a fit may end early.

    Raises
    ------
    RobotError
        Parameters of bodies are unknown.
    DataError
        The simulated motion runs away from the measured one.
    """
    return fit_with_columns(robot, runs, start, effects, amplitudes, late=late, soft=soft, tell=tell)[0]


def fit_with_columns(
    robot: Robot, runs: Sequence[Run], start: Array, effects: Sequence[Effect] = (), amplitudes: Sequence[float] = (),
    *, late: bool = True, soft: bool = True, tell: Callable[[float], None] | None = None,
) -> tuple[TrajectoryFit, list[Array]]:  # fmt: skip
    """Return the fit of `fit_trajectory`, and how its stretches' positions change with the unknowns, (N, n, U) each."""
    unknowns = Unknowns(
        robot, tuple(effects), 1 + max(run.source for run in runs), len(effects), spans=_covered(robot, runs[0])
    )
    z = started(unknowns, start, amplitudes)
    fit, columns = late_or_prompt(unknowns, [Tracked.of(run) for run in runs], z, late=late, tell=tell)
    if _lost(fit, start):
        z[: unknowns.drives] = _plausible(fit, start).ravel()
        try:
            again = late_or_prompt(unknowns, [Tracked.of(run) for run in runs], z, late=late)
        except DataError:
            again = fit, columns
        fit, columns = again if _nearer(again[0], fit) else (fit, columns)
    fit, columns = _of_whole_periods(fit, columns) if late else (fit, columns)
    fit, columns = with_own_values(fit, columns, partial(_fitted_again, late=late))
    if not soft:
        return fit, columns

    def refit(other: Unknowns, near: TrajectoryFit, begun: Array) -> TrajectoryFit:
        return _fitted_again(other, near, begun, late=late)[0]

    softer = softened(fit, refit, columns)
    if _lost(softer, start):
        softer = _found_again(softer, fit, _plausible(fit, start), refit)
    return softer, columns if softer is fit else columns_of(softer)


def _covered(robot: Robot, run: Run) -> tuple[float, ...]:
    """Return what every motor's angle covers in the stretch by which effects are judged, rad (m)."""
    return tuple(np.ptp(run.near[:, coordinates_of(robot).motors], axis=0).tolist())


def _fitted_again(
    unknowns: Unknowns, near: TrajectoryFit, z: Array, *, late: bool
) -> tuple[TrajectoryFit, list[Array]]:
    return late_or_prompt(unknowns, [replace(item) for item in near.tracked], z, late=late)


def _of_whole_periods(fit: TrajectoryFit, columns: list[Array]) -> tuple[TrajectoryFit, list[Array]]:
    """Return the fit, or one whose loops take commands at other periods than it ended at, where that is nearer.

    What is left of a delay after whole periods passes before the held torque acts: a descent does not leave its period.
    """
    parts = [parts_of_loops(item.run.drives.held).max() for item in fit.tracked if item.run.drives.held is not None]
    if not parts:
        return fit, columns
    period = fit.tracked[0].run.dt / max(parts)
    place = fit.delays / period
    best = fit, columns
    for whole in (np.floor(place), np.ceil(place)):
        if (np.abs(place - whole) < WITHIN).all():
            continue
        z = fit.z.copy()
        z[fit.unknowns.delays] = whole * period
        try:
            other = fitted_with_columns(fit.unknowns, [replace(item) for item in fit.tracked], z)
        except DataError:
            continue
        best = other if _nearer(other[0], best[0]) else best
    return best


def _lost(fit: TrajectoryFit, start: Array) -> bool:
    """Whether a fit ended with hardly any armature, or no viscous friction, at a joint, and leaves more than noise.

    Or began and ended with next to none, as least squares of few samples per second may say. `start` is where it began,
    (n, 4).
    """
    none = fit.shown[:, [0, 2]] & (np.abs(fit.values[:, [0, 2]]) <= LITTLE * start[:, [0, 2]])
    if none.any() and has_memory(fit.equations):
        return True
    least = NEXT * _plausible(fit, start)[:, :3]
    return bool((fit.shown[:, :3] & (np.maximum(start, fit.values)[:, :3] < least)).any())


def _plausible(fit: TrajectoryFit, start: Array) -> Array:
    """Return drive parameters to begin with, (n, 4), none of which is 0: parts of what moves the joints.

    Least squares of a log of few samples per second may say anything.
    """
    item, values = fit.tracked[0], start.copy()
    local, drives = item.equations(Linearised(fit.unknowns.robot, without=PARAMETERS)), item.run.drives
    motors = coordinates_of(fit.unknowns.robot).motors
    mass = np.diagonal(local.mass[:, 0], axis1=1, axis2=2).mean(axis=0)[motors]
    pulled = (
        drives.told.reshape(len(item.x) - 1, -1, *drives.told.shape[1:]).mean(axis=1) - drives.kp * item.run.near[:-1]
    )
    sizes = np.stack([mass, np.sqrt(np.nanmean(pulled**2, axis=0)), np.maximum(drives.kd, 0.0)], axis=1)
    values[:, :3] = np.maximum(values[:, :3], PART * sizes)
    return values


def _found_again(lost: TrajectoryFit, hard: TrajectoryFit, start: Array, refit: Refit) -> TrajectoryFit:
    """Return the fit that begins anew with soft friction, or `lost` where that is not clearly nearer.

    Friction that holds turns the motion about from one instant to the next: a descent may end where inertia and
    friction make up for each other, although it began near the truth.
    """
    own = hard.unknowns
    shapes = {joint: AGAIN for joint in range(own.robot.n) if joint not in own.soft}
    found = softened(hard, refit, shapes=shapes, start=start)
    return found if _nearer(found, lost) else lost


def _nearer(one: TrajectoryFit, other: TrajectoryFit) -> bool:
    return float(np.log(other.equations.size / one.equations.size).sum()) > NEARER


def late_or_prompt(
    unknowns: Unknowns, tracked: list[Tracked], z: Array, *, late: bool, tell: Callable[[float], None] | None = None
) -> tuple[TrajectoryFit, list[Array]]:
    """Return the fit with delays, where they may be and the log shows one, or without."""
    slow = z
    if late:
        copies = [replace(item) for item in tracked]
        try:
            free, columns = fitted_with_columns(unknowns, tracked, z, tell=tell)
        except DataError:  # with delays the motion ran away: without them it may not
            tracked = copies
        else:
            if shows_delays(free):
                ahead = (free.delays < 0).any() and has_memory(free.equations)
                if not ahead:
                    return free, columns
                prompt = without_delays(unknowns, copies, free.z)
                clear = np.log(prompt[0].equations.size / free.equations.size).sum() > NEARER
                return (free, columns) if clear else prompt
            slow, tell = free.z, None
    return without_delays(unknowns, tracked, slow, tell)


def without_delays(
    unknowns: Unknowns, tracked: list[Tracked], near: Array, tell: Callable[[float], None] | None = None
) -> tuple[TrajectoryFit, list[Array]]:
    """Return the fit without delays, started from unknowns (U,)."""
    z = near.copy()
    z[unknowns.delays] = 0.0
    return fitted_with_columns(unknowns, tracked, z, prompt=True, tell=tell)


def shows_delays(fit: TrajectoryFit) -> bool:
    """Whether the delay of a recording is clear of 0.

    A motion ahead of its commands is a fault of the stamps, if it is any: what a model lacks looks so more often.
    """
    own = fit.unknowns.delays
    # what makes no memory may make a delay that is none: blocks of time know
    blocks = np.sqrt(np.diag(jackknife(fit.left_out)))
    apart = fit.delays / np.maximum(np.maximum(fit.deviation, blocks)[own], 1e-300)
    return bool(((apart > SHOWN) | (apart < -AHEAD)).any())
