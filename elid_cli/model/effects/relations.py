"""How an effect stands to others: the same in every row of a log, or a member of a family."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from elid_cli.model.effects.effect import Effect
    from elid_cli.robot.robot import Robot


def in_deflection(effect: Effect | type[Effect], robot: Robot, joint: int) -> bool:
    """Whether an effect at a joint is a fault between its two encoders."""
    return bool(effect.in_deflection) and robot.joints[joint].elastic


class Same(NamedTuple):
    """Another effect that is the same in every row of a log."""

    effect: str
    joint: int
    values: Mapping[str, float]
    """Its named parameters as far as they follow."""


class Member(NamedTuple):
    """A member of a family of models that one effect is: what it adds, and the value of its first shape."""

    title: str
    formula: str
    shape: float
    forms: tuple[float, ...] = ()
    """Values of the third shape that are tried; empty: it has no part in this member."""
