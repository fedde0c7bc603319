"""Position loops with an integral term that the log does not tell of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.beside import Beside, moved_by_runs
from elid_cli.estimation.trajectory.changes import SURE, Change, Changed, changed_joints
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects import effect_that
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

NUDGE = 1e-2
"""1/s, or rad (m), by which a number is changed to see what that does."""


@dataclass(frozen=True)
class IntegralTerms(Change):
    """Integral over proportional gains of some joints' drives, 1/s, and what they hold when a recording begins.

    That is the torque over kp, rad (m), beyond the one when the first recording begins, which the offset is.
    """

    joints: tuple[int, ...]
    recordings: int = 1
    kind = effect_that(of_drive="integral")
    most = 30.0

    @property
    def count(self) -> int:
        """How many they are: rates, then those of every further recording."""
        return self.recordings * len(self.joints)

    def run(self, plain: Run, values: Array) -> Run:
        """Return the stretch under drives that add up the error."""
        return self._begun(self._at(plain, values), values)

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return what it does to raise each number a little."""

        def more(place: int) -> Callable[[Run], Run]:
            step = NUDGE * np.eye(self.count)[place]
            return lambda run: self._begun(self._at(run, values + step), step)

        return [part / NUDGE for part in moved_by_runs(fit, [more(k) for k in range(self.count)])]

    def _at(self, run: Run, values: Array) -> Run:
        """Return the stretch with the rates of the values."""
        rates = np.zeros(run.measured.shape[1])
        rates[list(self.joints)] = np.maximum(values[: len(self.joints)], 0.0)
        return run.integrating(rates)

    def _begun(self, run: Run, values: Array) -> Run:
        """Return the stretch with what the drives hold when its recording begins."""
        if run.source == 0:
            return run
        held = np.zeros(run.measured.shape[1])
        held[list(self.joints)] = values.reshape(self.recordings, -1)[run.source]
        return run.pushed(run.drives.kp * held)


def integral_terms(before: TrajectoryFit) -> Changed | None:
    """Return the integral terms that the motion asks for beside drives and delays; None where it asks for none.

    The rates of all joints are looked at together, and those that are clear of 0 found without the others.
    """
    robot, recordings = before.unknowns.robot, before.unknowns.recordings
    every = IntegralTerms(tuple(range(robot.n)), recordings)
    alone = Beside.of(before, every.moved(before, robot, np.zeros(every.count)))
    joints = np.flatnonzero((alone.steps > SURE * alone.deviations)[: robot.n]).tolist()
    found = changed_joints(before, joints, lambda left: IntegralTerms(left, recordings))
    return found if found is not None and (found.values[: len(found.by.joints)] > 0).all() else None
