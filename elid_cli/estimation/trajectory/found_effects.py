"""Effects of a trajectory fit as reports and robot files name them, and the robot that a fit describes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.result import FittedEffect
from elid_cli.estimation.trajectory.acting import acting, scene_along
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.model.linearised import Linearised
from elid_cli.robot.robot import EffectSpec, Robot

CONSTANT = 1e-9
"""Relative change of a torque that counts as none."""


def settled(fit: TrajectoryFit) -> Array:
    """Return the unknowns (U,) with effects that push a joint nowhere on the whole: the offset holds what is constant.

    An amplitude that only adds a constant torque, as the preload of a spring, cannot be told from the offset.
    """
    z, own = fit.z.copy(), fit.unknowns
    scene = scene_of_fit(fit)
    for place, effect in enumerate(fit.effects):
        if effect.softens or place < own.held:  # a robot file that says where a spring rests is believed
            continue
        part = own.amplitudes_of(place)
        pushed = acting((effect,), scene).push[:, :, effect.joint]
        constant = np.ptp(pushed, axis=1) <= CONSTANT * np.maximum(np.abs(pushed).max(axis=1), 1e-300)
        for k in np.flatnonzero(constant & (np.abs(pushed[:, 0]) > 0)):
            rest = float((z[part] @ pushed).mean() - z[part.start + k] * pushed[k, 0])
            z[3 + effect.joint * len(KINDS)] += z[part.start + k] * pushed[k, 0] + rest
            z[part.start + k] = -rest / pushed[k, 0]
    return z


def scene_of_fit(fit: TrajectoryFit) -> Scene:
    """Return the scene of the first stretch's simulated motion."""
    item, robot = fit.tracked[0], fit.unknowns.robot
    local = item.equations(Linearised(robot, without=PARAMETERS))
    return scene_along(robot, item.x, item.v, local, item.run.dt, robot.reference(), len(item.x))


def fitted_effects(robot: Robot, fit: TrajectoryFit) -> tuple[FittedEffect, ...]:
    """Return the effects that a fit holds, with standard errors."""
    z, scene, found, own = settled(fit), None, [], fit.unknowns
    for place, effect in enumerate(fit.effects):
        scene = scene_of_fit(fit) if scene is None else scene
        part = own.amplitudes_of(place)
        at, shapes = own.shapes_of(place)
        places = np.concatenate([np.arange(part.start, part.stop), at])
        errors = _named_errors(effect, scene, z[part], shapes, fit.covariance[np.ix_(places, places)])
        found.append(FittedEffect(effect.name, robot.joint_names[effect.joint], effect.named(scene, z[part]), errors))
    kind = effect_that(of_drive="filter")
    (time,) = (parameter.name for parameter in kind.amplitudes)
    found += [FittedEffect(kind.name, robot.joint_names[joint], {time: value}, {time: error})
              for joint, value, error in fit.open_filters]  # fmt: skip
    return tuple(found)


def _named_errors(
    effect: Effect, scene: Scene, amplitudes: Array, shapes: Sequence[int], covariance: Array
) -> dict[str, float]:
    """Return standard errors of named parameters, by first order from those of amplitudes and unknown shapes."""
    known = np.concatenate([amplitudes, [effect.shape[place] for place in shapes]])

    def named(values: Array) -> Array:
        shape = list(effect.shape)
        for place, value in zip(shapes, values[len(amplitudes) :].tolist(), strict=True):
            shape[place] = value
        other = type(effect)(effect.joint, shape) if shapes else effect
        return np.array(list(other.named(scene, values[: len(amplitudes)]).values()))

    steps = 1e-4 * np.maximum(np.abs(known), 1e-9)
    slopes = [(named(known + step * unit) - named(known)) / step
              for step, unit in zip(steps, np.eye(len(known)), strict=True)]  # fmt: skip
    spread = np.sqrt(np.maximum(np.einsum("ka,kl,la->a", slopes, covariance, slopes), 0.0))
    return {name: float(s) for name, s in zip(effect.named(scene, amplitudes), spread, strict=True) if s > 0}


def robot_of(fit: TrajectoryFit, z: Array) -> Robot:
    """Return the robot with unknowns (U,), its offsets and effects, without delays."""
    robot, values = fit.unknowns.robot, fit.unknowns.joint_values(z)
    joints = tuple(
        replace(joint, parameters={**joint.parameters, **dict(zip(PARAMETERS, row[:3].tolist(), strict=True))})
        for joint, row in zip(robot.joints, values, strict=True)
    )
    scene = scene_of_fit(fit) if fit.unknowns.effects else None
    specs = [EffectSpec(offset_name(), joint.name, {"offset": float(row[3])})
             for joint, row in zip(robot.joints, values, strict=True)]  # fmt: skip
    for place, effect in enumerate(fit.unknowns.effects_at(fit.unknowns.possible(z))):
        assert scene is not None
        named = effect.named(scene, z[fit.unknowns.amplitudes_of(place)])
        specs.append(EffectSpec(effect.name, robot.joint_names[effect.joint], named))
    return replace(robot, joints=joints, effects=tuple(specs))


def offset_name() -> str:
    """Return the name of the effect that a torque offset is."""
    return effect_that(nuisance="offset").name


def delay_name() -> str:
    """Return the name of the effect that a delay of the drives is."""
    return effect_that(nuisance="delay").name
