"""Position loops with an integral term that the log does not tell of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.beginning import torque_of_drives
from elid_cli.estimation.trajectory.beside import Beside, moved_by_runs
from elid_cli.estimation.trajectory.changes import SURE, Change, Changed, changed_joints, nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.of_drives import declared_integrals
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

NUDGE = 1e-2
"""1/s, or rad (m), by which a number is changed to see what that does."""
HELPS = 0.05
"""Part of the squared torque left, by least squares, that the integral of the error must explain to be begun with."""


@dataclass(frozen=True)
class IntegralTerms(Change):
    """Integral over proportional gains of some joints' drives, 1/s, and what they hold when a recording begins.

    That is the torque over kp, rad (m), beyond the one when the first recording begins, which the offset is. Rates are
    beyond those that the robot declares.
    """

    joints: tuple[int, ...]
    recordings: int = 1
    known: tuple[float, ...] = ()
    """Rates that the robot declares, 1/s, (n,)."""
    kind = effect_that(of_drive="integral")
    most = 30.0

    @property
    def count(self) -> int:
        """How many they are: rates, then those of every further recording."""
        return self.recordings * len(self.joints)

    def run(self, plain: Run, values: Array) -> Run:
        """Return the stretch under drives that add up the error."""
        return self._begun(self._at(plain, values), values)

    def named(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the whole rates, then what the drives hold."""
        found: Array = values + np.append(np.array(self.known)[list(self.joints)], np.zeros(self._further))
        found[: len(self.joints)] = np.maximum(found[: len(self.joints)], 0.0)
        return found

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return what it does to raise each number a little."""

        def more(place: int) -> Callable[[Run], Run]:
            step = NUDGE * np.eye(self.count)[place]
            return lambda run: self._begun(self._at(run, values + step), step)

        return [part / NUDGE for part in moved_by_runs(fit, [more(k) for k in range(self.count)])]

    @property
    def _further(self) -> int:
        return self.count - len(self.joints)

    def _at(self, run: Run, values: Array) -> Run:
        """Return the stretch with the rates of the values."""
        rates = np.array(self.known)
        rates[list(self.joints)] += values[: len(self.joints)]
        return run.integrating(np.maximum(rates, 0.0))

    def _begun(self, run: Run, values: Array) -> Run:
        """Return the stretch with what the drives hold when its recording begins."""
        if run.source == 0:
            return run
        held = np.zeros(run.measured.shape[1])
        held[list(self.joints)] = values.reshape(self.recordings, -1)[run.source]
        return run.pushed(run.drives.kp * held)


def integral_terms(before: TrajectoryFit, signals: Signals) -> Changed | None:
    """Return the integral terms that the motion asks for beside drives and delays; None where it asks for none.

    They are found from two starts: from none, where the rates of all joints are looked at together, and from those that
    least squares on the torque show. From none, the motion tells too little of a fast one.

    Parameters
    ----------
    before
        The fit without.
    signals
        The logs, with torques of the drives as the robot declares them.
    """
    robot, known = before.unknowns.robot, declared_integrals(before.unknowns.robot)
    every = terms_of(before, tuple(range(robot.n)))
    alone = Beside.of(before, every.moved(before, robot, np.zeros(every.count)))
    clear = (np.abs(alone.steps) > SURE * alone.deviations)[: robot.n]
    rates = shown_rates(before, signals)
    more = clear & (alone.steps[: robot.n] + known > 0)

    found = [
        changed_joints(before, np.flatnonzero(joints).tolist(), lambda left: terms_of(before, left), start=start)
        for joints, start in ((more, None), (rates != 0, rates))
    ]
    kept = [one for one in found if one is not None and _may_be(one)]
    return max(kept, key=lambda one: nearer_by(one.fit, before), default=None)


def terms_of(fit: TrajectoryFit, joints: tuple[int, ...]) -> IntegralTerms:
    """Return the terms of some joints' drives as numbers, beyond what the robot declares."""
    return IntegralTerms(joints, fit.unknowns.recordings, tuple(declared_integrals(fit.unknowns.robot).tolist()))


def _may_be(found: Changed) -> bool:
    """Whether no rate is surely negative."""
    by, joints = found.by, len(found.by.joints)
    assert isinstance(by, IntegralTerms)
    rates = found.values[:joints] + np.array(by.known)[list(by.joints)]
    return bool((rates > -SURE * found.deviations[:joints]).all())


def shown_rates(fit: TrajectoryFit, signals: Signals) -> Array:
    """Return the rates beyond the declared that least squares on the torque show, 1/s, (n,); 0 where they show none."""
    robot, found = fit.unknowns.robot, np.zeros(fit.unknowns.robot.n)
    if signals.error_integrals is None:
        return found
    dq, ddq, integral = signals.motion.dtheta, signals.motion.ddtheta, signals.error_integrals[0]
    left, known = torque_of_drives(robot, signals), declared_integrals(robot)
    inside = np.zeros((len(dq), fit.unknowns.recordings), dtype=bool)
    for segment in signals.segments:
        inside[segment.start : segment.stop, segment.source] = True
    for k in range(robot.n):
        use = inside.any(axis=1) & np.isfinite(left[:, k])
        columns = np.column_stack([ddq[:, k], np.sign(dq[:, k]), dq[:, k], inside, integral[:, k]])[use]
        _, bare = _fitted(columns[:, :-1], left[use, k])
        step, whole = _fitted(columns, left[use, k])
        rate = -float(step[-1])
        if whole < (1.0 - HELPS) * bare and abs(rate) < IntegralTerms.most:
            found[k] = max(rate, -float(known[k]))
    return found


def _fitted(columns: Array, target: Array) -> tuple[Array, float]:
    """Return the coefficients of columns (N, C) by least squares, and the squared error that they leave."""
    step = np.asarray(np.linalg.lstsq(columns, target, rcond=None)[0], dtype=np.float64)
    return step, float(np.sum((target - columns @ step) ** 2))
