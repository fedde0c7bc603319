"""Unknowns of the trajectory fit: four of every joint's drive, and where a robot's parameters hold them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.rollout import Joints
from elid_cli.robot.robot import Robot

KINDS = ("inertia", "coulomb", "viscous", "offset")
"""Rotor inertia kg·m² (kg), Coulomb N·m (N), viscous friction N·m·s/rad, torque offset N·m (N); columns of an array."""
PARAMETERS = ("Ja", "fs", "fv")
"""Names of the first three among a joint's parameters."""
STEP = 0.05
"""Part of a value, and of the usual size where it is small, by which variants differ."""


@dataclass(frozen=True)
class Chains:
    """Joints that move each other, and the place of each among its own."""

    joints: tuple[NDArray[np.intp], ...]

    @classmethod
    def of(cls, robot: Robot) -> Chains:
        """Return the chains of a robot from its base."""
        roots: dict[int, list[int]] = {}
        for k in range(robot.n):
            roots.setdefault(robot.ancestors[k][0], []).append(k)
        return cls(tuple(np.array(chain, dtype=np.intp) for chain in roots.values()))

    @property
    def longest(self) -> int:
        """Joints of the longest chain."""
        return max(map(len, self.joints))


def steps_of(values: Array) -> Array:
    """Return by how much each unknown (n, 4) differs in its variant."""
    usual = np.median(np.abs(values), axis=0)
    usual[3] = max(usual[3], 0.1 * usual[1])
    steps: Array = STEP * np.maximum(np.abs(values), np.maximum(usual, 1e-6))
    return steps


def variants(values: Array, chains: Chains) -> tuple[Joints, Array]:
    """Return the variants of unknowns (n, 4), the first as they are, and the steps (n, 4).

    A variant changes one unknown of one joint of every chain: chains do not move each other.
    """
    steps = steps_of(values)
    made = [values]
    for place in range(chains.longest):
        own = [chain[place] for chain in chains.joints if len(chain) > place]
        for kind in range(len(KINDS)):
            other = values.copy()
            other[own, kind] += steps[own, kind]
            made.append(other)
    stacked = np.array(made)
    return Joints(*(stacked[:, :, k] for k in range(len(KINDS)))), steps


def number_of(place: int, kind: int) -> int:
    """Return the variant that changes an unknown of the joint at a place in its chain."""
    return 1 + place * len(KINDS) + kind
