"""The first fit of a log's motion, handed on: several questions of one log begin with the same one.

How its drives were told (`nearer.py`), what its parameters are and what is missing from the model all begin there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.decided import fit_with_columns
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects.effect import Effect
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

Declared = tuple[Sequence[Effect], Sequence[float]]
"""Effects that a robot declares, and their amplitudes."""


@dataclass(frozen=True)
class FirstFit:
    """What `decided.fit_with_columns` found of a robot and stretches of a log, and what that was of."""

    robot: Robot
    runs: tuple[Run, ...]
    start: Array
    """Drive parameters that it started from, (n, 4)."""
    found: tuple[TrajectoryFit, list[Array]]
    plain: bool
    """Whether the robot declares no effects: the fit of one that does is not handed on."""

    @property
    def fit(self) -> TrajectoryFit:
        """The fit; the motion of its stretches, which later fits change, is the caller's own."""
        return self.with_columns[0]

    @property
    def with_columns(self) -> tuple[TrajectoryFit, list[Array]]:
        """The same, and how the positions of its stretches change with the unknowns, (N, n, U) each."""
        fit, columns = self.found
        return replace(_apart(fit), held=None if fit.held is None else _apart(fit.held)), list(columns)

    def is_of(self, robot: Robot, runs: Sequence[Run], start: Array, declared: Declared) -> bool:
        """Whether it is the fit of such a robot to such stretches, started there."""
        same = self.plain and not declared[0] and np.array_equal(self.start, start)
        return same and _alike(self.runs, tuple(runs)) and repr(self.robot) == repr(robot)


def first_fit(
    robot: Robot, runs: Sequence[Run], start: Array, declared: Declared, known: object = None,
    tell: Callable[[float], None] | None = None,
) -> FirstFit:  # fmt: skip
    """Return the first fit of stretches of a log, with a delay and friction that fades in where the log asks for them.

    Parameters
    ----------
    robot, runs, start, declared
        As `decided.fit_trajectory` has them.
    known
        A first fit that was made before, or anything else: it is the answer where it is of the same.
    tell
        Called with the part of the work that is done.
    """
    if isinstance(known, FirstFit) and known.is_of(robot, runs, start, declared):
        return known
    found = fit_with_columns(robot, runs, start, *declared, tell=tell)
    return FirstFit(robot, tuple(runs), start, found, not declared[0])


def _apart(fit: TrajectoryFit) -> TrajectoryFit:
    return replace(fit, tracked=tuple(replace(item) for item in fit.tracked))


def _alike(one: object, other: object) -> bool:
    """Whether two values, with all that they hold, are the same to the bit."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_alike, one, other))
    if is_dataclass(one):
        return all(_alike(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    return bool(one == other)
