"""A robot that stands, or reads its joints, at other angles than described: turned as the motion asks for it.

What weight in another direction does to a joint looks like a spring near one pose, at every joint that carries weight.
Two angles of a base that is not level, or one of an encoder's zero, are simpler than a spring at each.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.result import FoundEffect
from elid_cli.estimation.trajectory.beside import Beside
from elid_cli.estimation.trajectory.changes import SURE, Change, Changed, changed, changed_joints
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.pushes import columns_of_pushes
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.model.body_torques import gravity_torques, inertial_torques
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.tilt import STEEPEST, tilted
from elid_cli.model.linearised import Linearised
from elid_cli.robot.robot import Robot
from elid_cli.robot.zeros import with_zeros

NUDGE = 1e-3
"""rad by which the robot is turned to see what it does."""

UNFELT = 30.0
"""Times the error of the turn that joints feel best from which another one is not felt."""
LEAST_FELT = 1e-3
"""Part of a turn that an angle has at least, for its error."""


class Angles(Change):
    """Angles, rad, by which a robot is turned against its description."""

    most = STEEPEST

    @abstractmethod
    def pushes(self, level: Robot, angles: Array, item: Tracked) -> Array:
        """Return what the torques that the bodies need along a stretch's motion change with angles, (count, N, n)."""

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return how the positions change by what the bodies need."""
        own = fit.unknowns
        equations, parameters = Linearised(own.robot, without=PARAMETERS), own.robot.reference()
        found = []
        for item in fit.tracked:
            pushes = NUDGE * self.pushes(level, values, item)
            moved = columns_of_pushes(equations, replace(item, local=None), own, fit.z, parameters, pushes)
            found.append(moved / NUDGE)
        return found


class BaseAngles(Angles):
    """Roll and pitch of the base."""

    kind = effect_that(turns_gravity=True)
    count = 2

    def robot(self, level: Robot, values: Array) -> Robot:
        """Return the robot in gravity turned by the angles."""
        return tilted(level, values)

    def pushes(self, level: Robot, angles: Array, item: Tracked) -> Array:
        """Return the change of weight: nothing else turns with the base."""
        x = item.x[:, : level.n]
        held = [[gravity_torques(self.robot(level, angles + sign * NUDGE * unit), x) for sign in (1, -1)]
                for unit in np.eye(self.count)]  # fmt: skip
        return np.array([(one - other) / (2.0 * NUDGE) for one, other in held])


@dataclass(frozen=True)
class OneTurn(BaseAngles):
    """Roll and pitch of a base in a fixed ratio: the turn about one axis that the joints feel, as all are parallel."""

    direction: tuple[float, float]
    count = 1
    summary = "base not level, or gravity described wrongly; the joints' axes are parallel: they feel this turn alone"

    def robot(self, level: Robot, values: Array) -> Robot:
        """Return the robot in gravity turned by the angle."""
        return tilted(level, float(values[0]) * np.array(self.direction))

    def named(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return roll and pitch."""
        return float(values[0]) * np.array(self.direction)

    def spread(self, fit: TrajectoryFit, deviations: Array) -> Array:
        """Return their standard errors, as far as they are felt."""
        return float(deviations[0]) * np.maximum(np.abs(self.direction), LEAST_FELT)


@dataclass(frozen=True)
class Zeros(Angles):
    """Zeros of joints' encoders."""

    joints: tuple[int, ...]
    kind = effect_that(moves_zero=True)

    def robot(self, level: Robot, values: Array) -> Robot:
        """Return the robot whose geometry fits positions that are read too large by the angles."""
        offsets = np.zeros(level.n)
        offsets[list(self.joints)] = values
        return with_zeros(level, offsets)

    def pushes(self, level: Robot, angles: Array, item: Tracked) -> Array:
        """Return the change of weight and inertia with minus the joints' positions."""
        robot, n = self.robot(level, angles), level.n
        x, v = item.x[:, :n], item.v[:, :n]
        a = np.gradient(v, item.run.dt, axis=0)
        steps = [NUDGE * np.eye(n)[joint] for joint in self.joints]
        held = [[gravity_torques(robot, x + sign * step) + inertial_torques(robot, x + sign * step, v, a)
                 for sign in (-1, 1)] for step in steps]  # fmt: skip
        return np.array([(one - other) / (2.0 * NUDGE) for one, other in held])


def tilt_of(before: TrajectoryFit) -> Changed | None:
    """Return the tilt that the motion asks for beside drives and delays; None where it asks for none.

    Where all joints are parallel, one angle is hardly felt: the turn that is felt stands for both.
    """
    robot, both = before.unknowns.robot, BaseAngles()
    if not any(robot.gravity):
        return None
    moved = both.moved(before, robot, np.zeros(both.count))
    whole = np.concatenate([part.reshape(-1, both.count) for part in moved])
    felt, axes = np.linalg.eigh(whole.T @ whole)
    variances = np.linalg.eigvalsh(Beside.of(before, moved).spread)
    alike = felt[0] * UNFELT**2 < felt[1] or variances[1] > UNFELT**2 * variances[0]
    if alike and np.diag(whole.T @ whole).all():  # an angle that no joint feels at all moves nothing
        direction = axes[:, -1]
        return changed(before, OneTurn((float(direction[0]), float(direction[1]))))
    return changed(before, both)


def zeros_of(before: TrajectoryFit) -> Changed | None:
    """Return the zeros of encoders that the motion asks for beside drives and delays; None where it asks for none.

    The zeros of all joints are looked at together, and those that are clear of 0 found without the others.
    """
    robot = before.unknowns.robot
    every = Zeros(tuple(range(robot.n)))
    alone = Beside.of(before, every.moved(before, robot, np.zeros(every.count)))
    asked = np.abs(alone.steps) > SURE * alone.deviations
    return changed_joints(before, [joint for joint, may in zip(every.joints, asked, strict=True) if may], Zeros)


def effects_of(change: Changed, before: TrajectoryFit) -> tuple[FoundEffect, ...]:
    """Return a change as effects, with what they take from the error of a fit without.

    Those of single joints take together what each is said to take at its joint. What no joint feels has no error.
    """
    kind, (bare, left), robot = change.by.kind, change.squares(before), change.level
    names = [parameter.name for parameter in kind.amplitudes]
    named, spreads = change.by.named(change.fit, change.values), change.by.spread(change.fit, change.deviations)
    values, errors = named.tolist(), spreads.tolist()
    if change.by.joints:
        (name,) = names
        return tuple(
            FoundEffect(kind.name, robot.joint_names[k], {name: value}, {name: error}, float(1.0 - left[k] / bare[k]),
                        kind.summary)
            for k, value, error in zip(change.by.joints, values, errors, strict=False)
        )  # fmt: skip
    spread = {name: s for name, s in zip(names, errors, strict=True) if np.isfinite(s)}
    felt = {name: value for name, value in zip(names, values, strict=True) if name in spread}
    at = None if change.by.at is None else robot.joint_names[change.by.at]
    return (FoundEffect(kind.name, at, felt, spread, change.gain(before), change.by.summary or kind.summary),)
