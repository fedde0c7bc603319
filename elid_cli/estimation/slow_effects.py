"""Cut-offs for robots that declare effects whose form holds at low frequencies alone.

Above, such an effect predicts what does not happen. The highest cut-off is taken at which hardly more is left, over the
sensors' noise, than at the best one; the noise itself may be estimated too large, so no ratio alone decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from elid_cli.model.effects import effect_classes
from elid_cli.robot.robot import Robot

CUTOFFS = (10.0, 7.0, 5.0, 3.5, 2.5)
"""Tried besides the usual one, Hz."""
MORE = 1.05
"""Part by which what is left over the noise may be above the least of all. Measured: with 1.15, stiffnesses were up to
4.4 standard errors off, at a cut-off above the antiresonance that left 6 % more than the best one."""

T = TypeVar("T")


def declares_slow(robot: Robot) -> bool:
    """Whether a robot declares effects whose form holds at low frequencies alone."""
    return any(effect_classes()[spec.effect].quasi_static for spec in robot.effects)


def highest_that_holds(tried: Sequence[tuple[float, T]]) -> T:
    """Return the first of what was found at falling cut-offs, each after what it left, that leaves hardly the most."""
    least = min(left for left, _ in tried)
    return next(found for left, found in tried if left <= MORE * least)
