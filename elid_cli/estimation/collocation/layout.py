"""What stands where among a collocation's unknowns: channels, rows, parameters, and the shapes of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.collocation.problem import Setting
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.model.effects.declared import declared_effects
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow

LOOSER = 3.0
"""Amplitudes that the robot file gives are held this many times more loosely than in the default fit, whose noise is
larger."""


@dataclass(frozen=True)
class UnknownsLayout:
    """What stands where in a collocation of a fit."""

    fit: DefaultFit
    channels: tuple[tuple[str, int], ...]
    """Side (q or theta) and joint of every channel."""
    rows: tuple[EstimationRow, ...]
    p_columns: NDArray[np.intp]
    """Columns of the fit that are unknowns, in the order of p."""
    setting: Setting
    rates: Sequence[Array] = ()
    """Per piece: rate of the measured torque in every row, N·m/s (N/s), (rows, instants); 0 where no delay is free."""


@dataclass(frozen=True)
class Scanned:
    """An effect whose one free shape can be scanned."""

    number: int
    """Its place among the fit's effects."""
    joint: int
    shape: int
    """Place of its shape's logarithm in z."""
    places: NDArray[np.intp]
    """Places of its amplitudes in p."""
    limits: tuple[float, float]
    """Range of the shape's logarithm."""


def free_shapes(effects: FittedEffects | None) -> Array:
    """Return the logarithms of the shapes that are refined (only positive ones are)."""
    if effects is None:
        return np.zeros(0)
    shapes = [item.effect.shape[k] for item in effects.effects for k in item.free]
    return np.array([np.log(shape) for shape in shapes if shape > 0])


def shaped(effects: FittedEffects, z: Array) -> list[Effect]:
    """Return the effects at shapes whose logarithms are z."""
    found, place = [], 0
    for item in effects.effects:
        shape = list(item.effect.shape)
        for k in item.free:
            if shape[k] > 0:
                shape[k] = float(np.exp(z[place]))
                place += 1
        found.append(type(item.effect)(item.effect.joint, shape))
    return found


def given_effects(fit: DefaultFit) -> FittedEffects | None:
    """Return the effects as the robot file gives them, their amplitudes held loosely."""
    if fit.effects is None:
        return None
    declared = declared_effects(fit.model.robot, fit.effects.scene)
    looser = (replace(e, spread=np.where(e.mean != 0, LOOSER, 1.0) * e.spread) for e in declared)
    return replace(fit.effects, effects=tuple(looser))
