"""What stands where in a collocation: channels, rows, parameters and shapes among its unknowns, states among inputs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.collocation.problem import Setting
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.model.effects.declared import declared_effects
from elid_cli.model.effects.effect import Effect
from elid_cli.model.program import Program
from elid_cli.model.regressor import INPUTS, EstimationRow

LOOSER = 3.0
"""Amplitudes that the robot file gives are held this many times more loosely than in the default fit, whose noise is
larger."""

Moved = tuple[int, int, NDArray[np.intp]]
"""Channel, derivative, and the outputs that depend on it."""

_STANDS_IN = {
    ("q", 0): (0, 1, 2, 8), ("q", 1): (3,), ("q", 2): (4,),
    ("theta", 0): (8,), ("theta", 1): (5, 7), ("theta", 2): (6,),
}  # fmt: skip
"""Inputs of a joint (`model.inputs_of`) that a state's derivatives stand in."""


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


def slots_of(side: str, joint: int, derivative: int, *, elastic: bool) -> list[int]:
    """Return the inputs that a derivative of a link's (q) or motor's (theta) position stands in.

    The link of a rigid joint moves its motor along.
    """
    sides = (side,) if elastic else ("q", "theta")
    return [INPUTS * joint + slot for one in sides for slot in _STANDS_IN[one, derivative]]


def moved_together(program: Program, slots: Sequence[Sequence[Collection[int]]]) -> list[list[Moved]]:
    """Return channels and derivatives in groups of which no output depends on two (Curtis, Powell and Reid 1974).

    Parameters
    ----------
    program
        Outputs that may depend on a few inputs each.
    slots
        Per channel and derivative: the inputs that it stands in. What no output depends on is left out.
    """
    groups: list[tuple[set[int], list[Moved]]] = []
    for c, derivatives in enumerate(slots):
        for d, asked in enumerate(derivatives):
            mask = sum(1 << slot for slot in asked)
            touched = [output for output, read in enumerate(program.reads) if read & mask]
            if not touched:
                continue
            item = (c, d, np.array(touched, dtype=np.intp))
            for outputs, members in groups:
                if outputs.isdisjoint(touched):
                    outputs.update(touched)
                    members.append(item)
                    break
            else:
                groups.append((set(touched), [item]))
    return [members for _, members in groups]
