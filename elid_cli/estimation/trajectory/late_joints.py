"""Drives that act later than the others: a delay of a joint of its own beside the one that a recording has."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.beside import Beside, moved_by_runs
from elid_cli.estimation.trajectory.changes import SURE, Change, Changed, changed_joints, descended, nearer_by
from elid_cli.estimation.trajectory.decided import fit_trajectory, shows_delays, without_delays
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.unknowns import LATEST
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.shifts import delayed_joints
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

NUDGE = 1e-4
"""s by which a drive is made later to see what that does."""
HINTED = 2.0
"""Standard errors from which errors of other values count a delay that was not taken."""
LEAST = 2e-4
"""s by which a drive must be later than the others."""


@dataclass(frozen=True)
class LateJoints(Change):
    """By how much some joints' drives act later than the others', s."""

    joints: tuple[int, ...]
    kind = effect_that(nuisance="delay")
    most = LATEST
    little = True

    def run(self, plain: Run, values: Array) -> Run:
        """Return the stretch with these drives later than they are."""
        return plain.later(plain.extra + self._of_all(plain, values))

    def named(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the whole delays of these drives, s."""
        found: Array = fit.joint_delays.mean(axis=0)[list(self.joints)]
        return found

    def spread(self, fit: TrajectoryFit, deviations: Array) -> Array:
        """Return their standard errors: those of what all have in common count."""
        common = float(np.sqrt(np.mean(fit.deviation[fit.unknowns.delays] ** 2)))
        found: Array = np.hypot(deviations, common)
        return found

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return what it does to make each of the drives a little later."""

        def later(place: int) -> Callable[[Run], Run]:
            step = NUDGE * np.eye(len(self.joints))[place]
            return lambda run: run.later(run.extra + self._of_all(run, step))

        return [part / NUDGE for part in moved_by_runs(fit, [later(k) for k in range(len(self.joints))])]

    def _of_all(self, run: Run, values: Array) -> Array:
        late = np.zeros(run.measured.shape[1])
        late[list(self.joints)] = values
        return late


def believed(
    robot: Robot, runs: Sequence[Run], start: Array, declared: tuple[Sequence[Effect], Sequence[float]]
) -> list[Run]:
    """Return stretches with the delays that the robot declares of some drives, or without where these are nearer.

    Parameters
    ----------
    robot, runs
        The robot, and the stretches with what it declares.
    start, declared
        Drive parameters to start from, (n, 4), and effects that the robot declares, with their amplitudes.
    """
    if not any(np.any(run.extra) for run in runs):
        return list(runs)
    alike = [run.later(np.zeros(robot.n)) for run in runs]
    try:
        plain, other = (fit_trajectory(robot, each, start, *declared) for each in (alike, runs))
    except DataError:
        return list(runs)
    return alike if nearer_by(plain, other) > 0 else list(runs)


def beyond_common(fit: TrajectoryFit, later: Array) -> Array:
    """Return by how much every drive is later than most, s, where each is `later` than in a fit, (n,).

    Of two drives most is the one whose whole delay is smaller: one later than the other is the other earlier.
    """
    whole = fit.joint_delays.mean(axis=0) + later
    common = later[np.argmin(np.abs(whole))] if len(later) == 2 else np.median(later)
    found: Array = later - common
    return found


def late_joints(before: TrajectoryFit, alone: Beside | None = None) -> Changed | None:
    """Return the drives that the motion shows to be later, or earlier, than most; None where it shows none.

    With the recording's own delay held, each joint has one; those that are apart from the median of all are found again
    beside it. `alone` is `of_every` of the fit, where that is known.
    """
    if before.unknowns.robot.n < 2:
        return None
    found = _late_joints(before, of_every(before) if alone is None else alone)
    if found is None or not before.delays.any() or shows_delays(found.fit):
        return found
    # what all seemed to have was the late ones'
    prompt = _prompt(before)
    return _late_joints(prompt, of_every(prompt)) or found


def _prompt(fit: TrajectoryFit) -> TrajectoryFit:
    return without_delays(fit.unknowns, [replace(item) for item in fit.tracked], fit.z)[0]


def _late_joints(before: TrajectoryFit, alone: Beside) -> Changed | None:
    apart = np.abs(beyond_common(before, alone.steps))
    sure = (apart > LEAST) & (apart > SURE * alone.deviations)
    joints = np.flatnonzero(sure & may_be_late(before, alone.steps, alone.deviations)).tolist()
    while True:
        found = changed_joints(before, joints, LateJoints, LEAST)
        if found is None:
            return None
        errors = np.zeros(len(apart))
        errors[list(found.by.joints)] = found.deviations
        may = may_be_late(found.fit, np.zeros(len(apart)), errors)
        joints = [k for k in found.by.joints if may[k]]
        if len(joints) == len(found.by.joints):
            return found


def may_be_late(fit: TrajectoryFit, later: Array, deviations: Array) -> NDArray[np.bool_]:
    """Whether drives that are `later` than in a fit, (n,), are not ahead of their commands by more than all are.

    What a model lacks looks like a drive ahead of its commands; nothing makes one.
    """
    earliest = np.minimum(fit.delays.mean(), 0.0)
    found: NDArray[np.bool_] = fit.joint_delays.mean(axis=0) + later >= earliest - LEAST - HINTED * deviations
    return found


def declared_late(fit: TrajectoryFit, robot: Robot) -> Changed | None:
    """Return drives of which the robot declares a delay of their own, with the one that the motion has; None without.

    `fit` is that of the motion with the delays that are declared. Those of all drives are the recording's own.
    """
    late = delayed_joints(robot)
    if len(late) == robot.n:
        extra = np.broadcast_to(fit.tracked[0].run.extra, robot.n)
        late = tuple(k for k in late if extra[k] != 0)
        late = late if len(late) < robot.n else tuple(np.argsort(np.abs(extra))[1:].tolist())
    if not late or robot.n < 2:
        return None
    runs = [item.run for item in fit.tracked]
    started = Changed(LateJoints(late), np.zeros(len(late)), np.zeros(len(late)), robot, fit)
    found = descended(started, runs, None, known=True)
    if found is None or not found.fit.delays.any() or shows_delays(found.fit):
        return found
    # beside declared delays that are not the drives' all may seem late or early
    return descended(replace(found, fit=_prompt(found.fit)), runs, None, known=True) or found


def with_doubts(fit: TrajectoryFit, alone: Beside | None = None) -> TrajectoryFit:
    """Return a fit with errors that know of delays of single drives that were not taken.

    In slow motion a drive that is late by less than the log is sure of bends viscous friction and armature by many of
    their errors. How late each may be is what the motion would have, as far as that is more than its own error; no
    drive is ahead of its commands. `alone` is `of_every` of the fit, where that is known.
    """
    if fit.unknowns.robot.n < 2:
        return fit
    alone = of_every(fit) if alone is None else alone
    hinted = np.where(np.abs(alone.steps) > HINTED * alone.deviations, alone.steps, 0.0)
    hinted = np.maximum(hinted, -np.maximum(fit.joint_delays.mean(axis=0), 0.0))
    more = np.maximum(hinted**2 - alone.deviations**2, 0.0)
    covariance = fit.covariance + (alone.slopes.T * more) @ alone.slopes
    return replace(fit, covariance=covariance, doubted=np.where(more > 0, hinted, 0.0))


def of_every(fit: TrajectoryFit) -> Beside:
    """Return a delay of every joint's own beside a fit, the recording's own held."""
    own = fit.unknowns
    every = LateJoints(tuple(range(own.robot.n)))
    return Beside.of(fit, every.moved(fit, own.robot, np.zeros(own.robot.n)), held=own.delays)
