"""Dry friction that an effect adds as a motor starts to move: what makes static friction differ from Coulomb's."""

from __future__ import annotations

import math

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.scene import Scene
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.motion import Motion

SLOW = 1e-9
"""rad/s or m/s; a speed that is as good as none."""
ANGLES = 360
"""Angles over a turn that friction is averaged over."""


def breakaway(robot: Robot, spec: EffectSpec, angles: Array | None = None) -> float:
    """Return what an effect adds to the dry friction of its motor at no speed and no load, N·m (N).

    Zero for effects that are no dry friction of a motor. What varies with the angle, rad (m), has its mean over
    `angles`, (N,); over a turn where none are given.

    Raises
    ------
    RobotError
        See `resolve`.
    """
    kind, joint = resolve(robot, spec)
    if kind.acts_as != "friction" or not kind.holds():
        return 0.0
    every = np.linspace(0.0, 2 * math.pi, ANGLES, endpoint=False) if angles is None else angles
    scene = _slowly(robot, every)
    linear, shape = kind.coefficients(scene, joint, spec.parameters)
    total: Array = np.asarray(linear) @ next(iter(kind(joint, shape).columns(scene).values()))
    mean = float(np.mean(total / scene.direction(joint)))
    return mean if abs(mean) > SLOW else 0.0


def _slowly(robot: Robot, angles: Array) -> Scene:
    """Return every joint at some angles, (N,), and no speed to speak of."""
    none = np.zeros((len(angles), robot.n))
    angle = angles[:, None] + none
    slow = none + SLOW
    motion = Motion(np.arange(len(angles), dtype=float), angle, slow, none, angle, slow, none)
    unknown = np.full(robot.n, math.nan)
    parameters = np.nan_to_num(robot.reference())
    return Scene(robot, motion, 1.0, none, none, none, parameters, float(len(angles)), unknown)
