"""What stands where among a collocation's unknowns: channels, rows, parameters, and the shapes of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.collocation.problem import Setting
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow


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
