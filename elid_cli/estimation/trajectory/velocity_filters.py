"""Filters of the velocity that drives damp by, which the log does not tell of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.beside import moved_by_runs
from elid_cli.estimation.trajectory.changes import Change, Changed, changed, least_of, nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.unknowns import KINDS
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.of_drives import declared_filters, open_filters
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

NUDGE = 1e-4
"""s by which a time constant is raised to see what that does."""
BEGUN = 3e-3
"""s that filters begin with."""
LEFT, NEAR, FARTHEST = 1.03, 2.0, 50.0
"""Times the encoders' noise, at some joint, from which filters are looked for; at any up to which the motion must be
near, without them or with them; and up to which they are looked for, which takes long. Measured: 30 beside 15 ms."""
LEAST = 2e-4
"""s that a time constant must have."""


@dataclass(frozen=True)
class VelocityFilters(Change):
    """Time constants of the filters of velocity of some joints' drives beyond those that the robot declares, s."""

    joints: tuple[int, ...]
    known: tuple[float, ...] = ()
    """Times that the robot declares, s, (n,)."""
    kind = effect_that(of_drive="filter")
    most = 0.03
    little = True
    curved = True

    def run(self, plain: Run, values: Array) -> Run:
        """Return the stretch under drives with the filters."""
        times = np.array(self.known)
        times[list(self.joints)] += values
        return plain.filtered(np.maximum(times, 0.0))

    def beside(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the unknowns with the inertia, (U,), that came out too small without the filters."""
        z, gains = fit.z.copy(), np.mean([item.run.drives.kd for item in fit.tracked], axis=0)
        places = len(KINDS) * np.array(self.joints) + KINDS.index("inertia")
        z[places] += gains[list(self.joints)] * values
        return z

    def named(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the whole time constants."""
        found: Array = np.maximum(values + np.array(self.known)[list(self.joints)], 0.0)
        return found

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return what it does to raise each time constant a little."""

        def longer(place: int) -> Callable[[Run], Run]:
            step = NUDGE * np.eye(self.count)[place]
            return lambda run: self.run(run, values + step)

        return [part / NUDGE for part in moved_by_runs(fit, [longer(k) for k in range(self.count)])]


def velocity_filters(before: TrajectoryFit) -> Changed | None:
    """Return the filters of velocity that the motion shows beside drives and delays; None where it shows none.

    They are begun with: beside an inertia that is too small by kd times its time, a filter begins with the wrong sign.
    """
    robot = before.unknowns.robot
    left = tuple(np.flatnonzero(np.any([item.run.drives.kd > 0 for item in before.tracked], axis=0)).tolist())
    while left:
        found = changed(before, filters_of(robot, left), np.full(len(left), BEGUN))
        if found is None:
            return None
        sure = found.sure & (found.values > LEAST)
        kept = tuple(joint for joint, may in zip(left, sure, strict=True) if may)
        if kept == left:
            return _fewest(before, found)
        left = kept
    return None


def _fewest(before: TrajectoryFit, found: Changed) -> Changed:
    """Return filters without those with which the motion is no nearer than without them.

    Begun with at every joint, one that is not there may stay where it holds up the others.
    """
    by = found.by
    for joint in sorted(by.joints, key=lambda joint: abs(found.values[by.joints.index(joint)])):
        rest = tuple(other for other in found.by.joints if other != joint)
        if joint not in found.by.joints or not rest:
            continue
        times = np.array([found.values[found.by.joints.index(other)] for other in rest])
        fewer = changed(before, filters_of(before.unknowns.robot, rest), times)
        if fewer is not None and nearer_by(found.fit, fewer.fit) < least_of(fewer.fit):
            found = fewer
    return found


def with_filters_in_doubt(fit: TrajectoryFit, signals: Signals, common: TrajectoryFit | None = None) -> TrajectoryFit:
    """Return a fit with errors that know of filters of velocity with which the motion would be nearer.

    `common` is the fit of drives that all act at once, where some were found to be late: filters look like that.
    Where much more than the encoders' noise is left, and with filters as well, something else is missing, which these
    may imitate.
    """
    above = fit.above_noise(signals)
    if np.any(fit.filters):
        return fit
    if declared_filters(fit.unknowns.robot).any() or not (above > LEFT).any() or (above > FARTHEST).any():
        return fit
    found = velocity_filters(fit if common is None or common.unknowns.count != fit.unknowns.count else common)
    if found is None or not found.is_nearer(fit):
        return fit
    imitate = (above > NEAR).any() and (found.fit.above_noise(signals) > NEAR).any()
    return fit if imitate else filters_in_doubt(fit, found)


def with_open_filters(fit: TrajectoryFit, common: TrajectoryFit | None = None) -> TrajectoryFit:
    """Return a fit with the filters of velocity that its robot declares without a time; as it is where it shows none.

    `common` is as `with_filters_in_doubt` has it.
    """
    joints = open_filters(fit.unknowns.robot)
    if not joints:
        return fit
    near = fit if common is None else common
    found = changed(near, filters_of(near.unknowns.robot, joints), np.full(len(joints), BEGUN))
    if found is None:
        return fit
    each = zip(joints, found.values.tolist(), found.deviations.tolist(), strict=True)
    return replace(found.aware(), open_filters=tuple(each))


def filters_in_doubt(fit: TrajectoryFit, found: Changed) -> TrajectoryFit:
    """Return a fit whose errors count filters that were found beside it."""
    moved, times = found.fit.z - fit.z, np.zeros(fit.unknowns.robot.n)
    times[list(found.by.joints)] = found.values
    return replace(fit, covariance=fit.covariance + np.outer(moved, moved), filters=times)


def filters_of(robot: Robot, joints: tuple[int, ...]) -> VelocityFilters:
    """Return the filters of some joints' drives as numbers, beyond what the robot declares."""
    return VelocityFilters(joints, tuple(declared_filters(robot).tolist()))
