"""A robot that stands, or reads its joints, at other angles than described: turned as the motion asks for it.

What weight in another direction does to a joint looks like a spring near one pose, at every joint that carries weight.
Two angles of a base that is not level, or one of an encoder's zero, are simpler than a spring at each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.beside import SETTLED, Beside
from elid_cli.diagnosis.result import FoundEffect
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.fit import COARSE, TrajectoryFit, fitted
from elid_cli.estimation.trajectory.normal_equations import Tracked, columns_of_pushes
from elid_cli.estimation.trajectory.unknowns import PARAMETERS, Unknowns
from elid_cli.model.body_torques import gravity_torques, inertial_torques
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.tilt import STEEPEST, tilted
from elid_cli.model.linearised import Linearised
from elid_cli.robot.robot import Robot
from elid_cli.robot.zeros import with_zeros

STEPS = 12
"""Most steps of the angles."""
SURE = 5.0
"""Standard errors by which an angle must be clear of 0."""
HOPEFUL = 0.1
"""Sum over the joints of the logarithm by which the error's size must fall with the first step."""
STILL = 1e-9
"""rad (m) per rad by which positions change with an angle that no joint feels."""
NUDGE = 1e-3
"""rad by which the robot is turned to see what it does."""


Errors = tuple[Array, Array]
"""Squared errors of every joint, in its own size, without and with some angles, (n,) each."""


class Angles(ABC):
    """Angles by which a robot is turned against its description."""

    kind: type[Effect]
    """The effect that they are."""
    count: int

    @abstractmethod
    def turned(self, level: Robot, angles: Array) -> Robot:
        """Return the robot with angles, rad, (count,)."""

    @abstractmethod
    def pushes(self, level: Robot, angles: Array, item: Tracked) -> Array:
        """Return what the torques that the bodies need along a stretch's motion change with angles, (count, N, n)."""

    @abstractmethod
    def effects(self, level: Robot, angles: Array, deviations: Array, errors: Errors) -> tuple[FoundEffect, ...]:
        """Return them as effects; what no joint feels has no deviation.

        Errors without and with them say what they take away.
        """


class BaseAngles(Angles):
    """Roll and pitch of the base."""

    kind = effect_that(turns_gravity=True)
    count = 2

    def turned(self, level: Robot, angles: Array) -> Robot:
        """Return the robot in gravity turned by the angles."""
        return tilted(level, angles)

    def pushes(self, level: Robot, angles: Array, item: Tracked) -> Array:
        """Return the change of weight: nothing else turns with the base."""
        x = item.x[:, : level.n]
        held = [[gravity_torques(self.turned(level, angles + sign * NUDGE * unit), x) for sign in (1, -1)]
                for unit in np.eye(self.count)]  # fmt: skip
        return np.array([(one - other) / (2.0 * NUDGE) for one, other in held])

    def effects(self, level: Robot, angles: Array, deviations: Array, errors: Errors) -> tuple[FoundEffect, ...]:
        """Return the one effect of the whole robot."""
        felt = np.isfinite(deviations)
        named, spread = (
            {p.name: v for p, v, seen in zip(self.kind.amplitudes, values.tolist(), felt, strict=True) if seen}
            for values in (angles, deviations)
        )
        return (FoundEffect(self.kind.name, None, named, spread, _gain(*errors), self.kind.summary),)


@dataclass(frozen=True)
class Zeros(Angles):
    """Zeros of joints' encoders."""

    joints: tuple[int, ...]
    kind = effect_that(moves_zero=True)

    @property
    def count(self) -> int:  # type: ignore[override]
        """Number of joints."""
        return len(self.joints)

    def turned(self, level: Robot, angles: Array) -> Robot:
        """Return the robot whose geometry fits positions that are read too large by the angles."""
        offsets = np.zeros(level.n)
        offsets[list(self.joints)] = angles
        return with_zeros(level, offsets)

    def pushes(self, level: Robot, angles: Array, item: Tracked) -> Array:
        """Return the change of weight and inertia with minus the joints' positions."""
        robot, n = self.turned(level, angles), level.n
        x, v = item.x[:, :n], item.v[:, :n]
        a = np.gradient(v, item.run.dt, axis=0)
        steps = [NUDGE * np.eye(n)[joint] for joint in self.joints]
        held = [[gravity_torques(robot, x + sign * step) + inertial_torques(robot, x + sign * step, v, a)
                 for sign in (-1, 1)] for step in steps]  # fmt: skip
        return np.array([(one - other) / (2.0 * NUDGE) for one, other in held])

    def effects(self, level: Robot, angles: Array, deviations: Array, errors: Errors) -> tuple[FoundEffect, ...]:
        """Return an effect of every joint, with what all take together from the error there."""
        (offset,), kind = self.kind.amplitudes, self.kind
        return tuple(
            FoundEffect(
                kind.name,
                level.joint_names[joint],
                {offset.name: value},
                {offset.name: s},
                _gain(errors[0][joint], errors[1][joint]),
                kind.summary,
            )
            for joint, value, s in zip(self.joints, angles.tolist(), deviations.tolist(), strict=True)
        )


@dataclass(frozen=True)
class Turned:
    """The robot turned by some angles, and the fit with it."""

    by: Angles
    angles: Array
    """rad, (count,)."""
    deviations: Array
    """Standard errors, rad, (count,); infinite of an angle that no joint of the robot feels."""
    level: Robot
    """The robot as it is described."""
    fit: TrajectoryFit

    @property
    def robot(self) -> Robot:
        """The robot as it is turned."""
        return self.fit.unknowns.robot

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Which angles are clear of 0, (count,)."""
        found: NDArray[np.bool_] = np.abs(self.angles) > SURE * self.deviations
        return found

    def gain(self, before: TrajectoryFit) -> float:
        """Return what it takes from the squared error of a fit of the robot as described, every joint in its size."""
        return _gain(*self._errors(before))

    def effects(self, before: TrajectoryFit) -> tuple[FoundEffect, ...]:
        """Return it as effects, with what they take from the error of a fit of the robot as described."""
        return self.by.effects(self.level, self.angles, self.deviations, self._errors(before))

    def _errors(self, before: TrajectoryFit) -> Errors:
        bare, left = (fit.equations.lighter.sum(axis=0) / before.equations.size**2 for fit in (before, self.fit))
        return bare, left


def _gain(bare: Array | float, left: Array | float) -> float:
    return float(1.0 - np.sum(left) / np.sum(bare))


def tilt_of(before: TrajectoryFit) -> Turned | None:
    """Return the tilt that the motion asks for beside drives and delays; None where it asks for none."""
    return _turned(before, BaseAngles()) if any(before.unknowns.robot.gravity) else None


def zeros_of(before: TrajectoryFit) -> Turned | None:
    """Return the zeros of encoders that the motion asks for beside drives and delays; None where it asks for none.

    The zeros of all joints are found together, and those that are clear of 0 again without the others.
    """
    robot = before.unknowns.robot
    joints = tuple(k for k, joint in enumerate(robot.joints) if joint.revolute)
    found = None
    while joints:
        found = _turned(before, Zeros(joints))
        if found is None:
            return None
        kept = tuple(joint for joint, sure in zip(joints, found.sure, strict=True) if sure)
        if kept == joints:
            return found
        joints = kept
    return None


def _turned(before: TrajectoryFit, by: Angles) -> Turned | None:
    level, fit = before.unknowns.robot, before
    angles = np.zeros(by.count)
    for number in range(STEPS):
        moved = moved_by(fit, level, by, angles)
        found = Beside.of(fit, moved)
        if number == 0 and -0.5 * np.log(found.left).sum() < HOPEFUL:
            return None
        shown = np.any([np.abs(part).max(axis=(0, 1)) > STILL for part in moved], axis=0)
        deviations = np.where(shown, np.hypot(found.deviations, COARSE), np.inf)
        if number == STEPS - 1 or (np.abs(found.steps) <= SETTLED * deviations).all():
            break
        angles = np.clip(angles + found.steps, -STEEPEST, STEEPEST)
        turned = _refitted(fit, by.turned(level, angles), fit.z + found.along)
        if turned is None:
            return None
        fit = turned
    found_ones = Turned(by, angles, deviations, level, fit)
    return found_ones if found_ones.sure.any() and np.abs(angles).max() < STEEPEST else None


def _refitted(fit: TrajectoryFit, robot: Robot, z: Array) -> TrajectoryFit | None:
    """Return the fit of a robot at other angles, started from z (U,); None where the simulated motion runs away."""
    own = fit.unknowns
    unknowns = Unknowns(robot, fit.effects, own.recordings, own.held)
    tracked = [replace(Tracked.of(item.run), usual=item.usual) for item in fit.tracked]
    try:
        return fitted(unknowns, tracked, z, prompt=not fit.delays.any())
    except DataError:
        return None


def moved_by(fit: TrajectoryFit, level: Robot, by: Angles, angles: Array) -> Sequence[Array]:
    """Return how the positions of a fit's stretches change with angles, rad (m) per rad, (N, n, count) each."""
    own = fit.unknowns
    equations, parameters = Linearised(own.robot, without=PARAMETERS), own.robot.reference()
    found = []
    for item in fit.tracked:
        pushes = NUDGE * by.pushes(level, angles, item)
        moved = columns_of_pushes(equations, replace(item, local=None), own, fit.z, parameters, pushes)
        found.append(moved / NUDGE)
    return found
