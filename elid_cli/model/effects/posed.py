"""A robot as it stands and is read: tilts of its base and zeros of its encoders turn the robot itself.

Neither is a column beside a model that knows nothing of it. A tilt lets the log see parameters that a level robot never
shows (first moments about a vertical first axis), and their product with the angle is no column of a level robot's
model; a zero that is off bends the torques of all bodies behind the joint, whose parameters are unknown themselves. So
the model is turned, and the effect's column tells what is still missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.tilt import STEEPEST, tilted
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.robot.zeros import with_zeros

Fit = TypeVar("Fit")

LEVEL = 1e-6
"""rad (m); angle below which nothing more is turned."""
_SETTLING = 12
"""Most fits until the model is turned as far as the columns say."""


@dataclass(frozen=True)
class Pose:
    """By how much a model's base leans and by how much its joints' positions are read too large."""

    tilt: Array
    """Roll and pitch, rad, (2,)."""
    zeros: Array
    """rad (m), (n,)."""
    turning: tuple[bool, ...]
    """Which joints turn: their zeros are angles, the same after a whole turn."""

    @classmethod
    def none(cls, robot: Robot) -> Pose:
        """Return the pose of a level robot whose zeros are right."""
        return cls(np.zeros(2), np.zeros(robot.n), tuple(joint.revolute for joint in robot.joints))

    def __bool__(self) -> bool:
        """Whether anything is turned."""
        return bool(np.any(self.tilt) or np.any(self.zeros))

    def of(self, kind: type[Effect], joint: int) -> Array:
        """Return the amplitudes of an effect that the model has already, (d,): zeros of one that turns nothing."""
        if kind.turns_gravity:
            return self.tilt
        return self.zeros[[joint]] if kind.moves_zero else np.zeros(len(kind.amplitudes))

    def moved(self, effect: Effect, more: Array) -> Pose:
        """Return the pose with more of an effect's amplitudes, (d,)."""
        if type(effect).turns_gravity:
            return replace(self, tilt=np.clip(self.tilt + more, -STEEPEST, STEEPEST))
        zeros = self.zeros.copy()
        zeros[effect.joint] += float(more[0])
        if self.turning[effect.joint]:
            zeros[effect.joint] = np.remainder(zeros[effect.joint] + np.pi, 2.0 * np.pi) - np.pi
        return replace(self, zeros=zeros)

    def without(self, effect: Effect) -> Pose:
        """Return the pose without what an effect turns."""
        return self.moved(effect, -self.of(type(effect), effect.joint)) if turns_model(type(effect)) else self

    def whole(self, kind: type[Effect], joint: int, values: Mapping[str, float]) -> dict[str, float]:
        """Return an effect's named parameters with what the model has already; without a tilt that no joint feels."""
        if not turns_model(kind):
            return dict(values)
        names = [parameter.name for parameter in kind.amplitudes]
        had = zip(names, self.of(kind, joint).tolist(), strict=True)
        return {name: float(values.get(name, 0.0)) + own for name, own in had if name in values or own}

    def robot(self, robot: Robot) -> Robot:
        """Return the robot so turned; declared effects that turn it stay, with nothing left to add."""
        rest = tuple(EffectSpec(s.effect, s.joint, {}) if _turns(s) else s for s in robot.effects)
        return replace(tilted(with_zeros(robot, self.zeros), self.tilt), effects=rest) if self else robot


def turns_model(kind: type[Effect]) -> bool:
    """Whether an effect's amplitudes are angles (m) by which the model itself is turned."""
    return kind.turns_gravity or kind.moves_zero


def _turns(spec: EffectSpec) -> bool:
    kind = effect_classes().get(spec.effect)
    return kind is not None and turns_model(kind)


def declared_pose(robot: Robot) -> Pose:
    """Return the pose that a robot file declares, 0 where it gives no value.

    Raises
    ------
    RobotError
        A zero at a joint that the robot does not have.
    """
    pose = Pose.none(robot)
    for spec in robot.effects:
        if _turns(spec):
            kind, joint = resolve(robot, spec)
            given = [float(spec.parameters.get(parameter.name, 0.0)) for parameter in kind.amplitudes]
            if kind.turns_gravity:
                pose = replace(pose, tilt=np.array(given))
            else:
                pose = pose.moved(kind(joint), np.array(given))
    return pose


def as_posed(robot: Robot) -> Robot:
    """Return the robot turned as its declared effects say; these stay, with nothing left to add."""
    return declared_pose(robot).robot(robot)


def posed(robot: Robot) -> Robot:
    """Return the robot in the gravity and with the geometry that its declared effects stand for, without these."""
    kept = tuple(spec for spec in robot.effects if not _turns(spec))
    return robot if len(kept) == len(robot.effects) else replace(as_posed(robot), effects=kept)


def settled(
    fit: Fit, pose: Pose, left: Callable[[Fit], Iterable[tuple[Effect, Array]]], again: Callable[[Fit, Pose], Fit]
) -> tuple[Fit, Pose]:
    """Return a fit with the model turned until nothing is left for columns to say, and the pose.

    Parameters
    ----------
    fit, pose
        Where it starts.
    left
        What a fit says is still missing of the effects that turn the model, (d,) each.
    again
        Fits in another pose.
    """
    for _ in range(_SETTLING):
        more = list(left(fit))
        if all(np.abs(values).max() < LEVEL for _, values in more):
            break
        for effect, values in more:
            pose = pose.moved(effect, values)
        fit = again(fit, pose)
    return fit, pose
