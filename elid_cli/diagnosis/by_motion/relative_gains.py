"""Gains of drives by how much they are larger than those that act: of the whole torque, or of one term of the loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.changes import Change
from elid_cli.estimation.trajectory.fit import TrajectoryFit

LEAST_RATIO = 0.05
"""Told over acting gain, at least."""


@dataclass(frozen=True)
class RelativeGains(Change):
    """By how much a told gain of some joints' drives is larger than the one that acts, in parts of that.

    Beyond what the robot declares.
    """

    joints: tuple[int, ...]
    known: tuple[float, ...] = ()
    """What the robot declares: told over acting gain, (n,)."""
    most = 3.0

    def over(self, count: int, values: Array) -> Array:
        """Return the told gain over the one that acts, beyond what is declared, never none, of `count` joints."""
        found = np.ones(count)
        found[list(self.joints)] = np.maximum(1.0 + values, LEAST_RATIO)
        return found

    def named(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the whole gains."""
        found: Array = np.array(self.known)[list(self.joints)] * (1.0 + values) - 1.0
        return found

    def spread(self, fit: TrajectoryFit, deviations: Array) -> Array:
        """Return their standard errors."""
        found: Array = np.array(self.known)[list(self.joints)] * deviations
        return found
