"""A base that is not level: declared or found tilt turns the model's gravity, instead of a column about level ground.

A tilt lets the log see parameters that a level robot never shows (first moments about a vertical first axis). Their
product with the angle is no column of a level robot's model, so the model itself is turned, and the effect's column
tells only what is still missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.model.effects.bodies import horizontal_axes, turned
from elid_cli.robot.robot import EffectSpec, Robot

Fit = TypeVar("Fit")

LEVEL = 1e-6
"""rad; tilt below which nothing more is turned."""
STEEPEST = 0.5
"""rad; a base that seems steeper is not turned further."""
_LEVELLING = 12
"""Most fits until gravity is turned as far as the tilt's column says."""


def is_tilt(name: str) -> bool:
    """Whether an effect of that name turns gravity."""
    kind = effect_classes().get(name)
    return kind is not None and kind.turns_gravity


def angles_of(values: Mapping[str, float]) -> list[float]:
    """Return roll and pitch (rad) of a tilt's named parameters, 0 where they give none."""
    return [float(values.get(p.name, 0.0)) for p in effect_that(turns_gravity=True).amplitudes]


def declared_tilt(robot: Robot) -> Array:
    """Return roll and pitch (rad) that a robot file declares, 0 where it gives none, (2,)."""
    angles = np.zeros(2)
    for spec in robot.effects:
        if is_tilt(spec.effect):
            angles += angles_of(spec.parameters)
    return angles


def tilted(robot: Robot, angles: Array) -> Robot:
    """Return the robot in gravity turned by roll and pitch (rad, (2,)) about its horizontal base axes."""
    if not np.any(angles):
        return robot
    first, second = horizontal_axes(robot)
    x, y, z = (float(v) for v in turned(np.array(robot.gravity), angles[0] * first + angles[1] * second))
    return replace(robot, gravity=(x, y, z))


def levelled(robot: Robot) -> Robot:
    """Return the robot in the gravity that its declared tilt gives; the effect stays, with nothing left to add."""
    angles = declared_tilt(robot)
    if not np.any(angles):
        return robot
    rest = tuple(EffectSpec(s.effect, s.joint, {}) if is_tilt(s.effect) else s for s in robot.effects)
    return replace(tilted(robot, angles), effects=rest)


def untilted(values: Mapping[str, float], angles: Array) -> dict[str, float]:
    """Return roll and pitch of the whole tilt, from what is left beyond `angles`; without one that no joint feels."""
    names = [p.name for p in effect_that(turns_gravity=True).amplitudes]
    whole = zip(names, angles_of(values), angles, strict=True)
    return {name: left + float(a) for name, left, a in whole if name in values or a}


def settled(
    fit: Fit, tilt: Array, left: Callable[[Fit], Array], again: Callable[[Fit, Array], Fit]
) -> tuple[Fit, Array]:
    """Return a fit with gravity turned until nothing is left for the tilt's column to say, and the tilt, rad, (2,).

    Parameters
    ----------
    fit, tilt
        Where it starts.
    left
        What a fit says is still missing of roll and pitch, (2,).
    again
        Fits with gravity turned by other angles.
    """
    for _ in range(_LEVELLING):
        more = left(fit)
        if np.abs(more).max() < LEVEL:
            break
        tilt = np.clip(tilt + more, -STEEPEST, STEEPEST)
        fit = again(fit, tilt)
    return fit, tilt
