"""What of an effect's friction a constant one stands for, where a format has no place for the effect.

An MJCF holds one dry friction per joint. Over a part of a turn friction that varies with the angle has a mean, of which
the log shows hardly how much is Coulomb's: with it in the file, a simulator that knows no more of the effect moves
nearly right. The effect beside is what is beyond.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.estimation.trajectory.acting import acting, declared
from elid_cli.model.coordinates import coordinates_of
from elid_cli.model.effects.breakaway import breakaway
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.harmonics import Harmonic
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.signals import Signals


@dataclass(frozen=True)
class MeanFriction:
    """What an effect of a robot adds to dry friction on the whole, N·m (N)."""

    effect: EffectSpec
    mean: float
    """While the motor moves."""
    at_rest: float = 0.0
    """As it starts to move, over the same angles."""


def varies_with_angle(robot: Robot, spec: EffectSpec) -> bool:
    """Whether an effect of a robot is dry friction of a motor that repeats with its angle."""
    kind, _ = resolve(robot, spec)
    return issubclass(kind, Harmonic) and kind.acts_as == "friction"


def mean_friction(robot: Robot, signals: Signals, effects: Sequence[EffectSpec]) -> tuple[MeanFriction, ...]:
    """Return the mean of frictions by angle over the instants of a log at which the motor moves, N·m (N).

    Parameters
    ----------
    robot
        Its parameters must be known.
    signals
        The log.
    effects
        Effects of the robot. Those left out: what is no dry friction of a motor that repeats with its angle; those of
        a joint whose Coulomb friction fades in, or would become negative with the mean.
    """
    soft = {joint for spec, kind, joint in ((s, *resolve(robot, s)) for s in robot.effects) if kind.softens}
    dry = [(spec, joint) for spec, joint in ((s, resolve(robot, s)[1]) for s in effects)
           if varies_with_angle(robot, spec) and joint not in soft]  # fmt: skip
    if not dry:
        return ()
    scene = scene_of(Regressor(robot), signals, robot.reference())
    m = scene.motion
    scene = replace(scene, motion=Motion(m.t, m.q, m.dq, m.ddq, m.theta, m.dtheta, m.ddtheta), cache={})  # not splines
    moving = np.abs(scene.motion.dtheta) > signals.min_velocity
    motors, means = coordinates_of(robot).motors, list[MeanFriction]()
    left = {joint: robot.joints[joint].parameters.get("fs", 0.0) for _, joint in dry}
    for spec, joint in dry:
        known = declared(robot, spec, scene)
        if known is None or not moving[:, joint].any():
            continue
        effect, amplitudes = known
        mean = float((amplitudes @ acting([effect], scene).grip[:, moving[:, joint], motors[joint]]).mean())
        if np.isfinite(mean) and mean and left[joint] + mean >= 0:
            at_rest = breakaway(robot, spec, m.theta[moving[:, joint], joint])
            means.append(MeanFriction(spec, mean, at_rest))
            left[joint] += mean
    return tuple(means)


def with_mean_friction(robot: Robot, means: Sequence[MeanFriction]) -> Robot:
    """Return a robot whose Coulomb frictions hold the means of effects."""
    more = np.zeros(robot.n)
    for item in means:
        more[resolve(robot, item.effect)[1]] += item.mean
    joints = tuple(
        replace(joint, parameters=MappingProxyType({**joint.parameters, "fs": joint.parameters.get("fs", 0.0) + own}))
        if own else joint
        for joint, own in zip(robot.joints, more.tolist(), strict=True)
    )  # fmt: skip
    return replace(robot, joints=joints)
