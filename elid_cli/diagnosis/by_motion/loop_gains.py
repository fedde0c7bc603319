"""Gains of drives' loops, kp or kd alone, that are others than the log tells, while torque constants are right.

Without commanded velocities kd is as good as viscous friction, and a torque gain differs from one of kp in the friction
that it leaves alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.relative_gains import RelativeGains
from elid_cli.diagnosis.by_motion.torque_gains import DOUBTED, LEAST
from elid_cli.estimation.trajectory.beside import BESIDE, Beside, moved_by_runs
from elid_cli.estimation.trajectory.changes import SURE, Changed, changed_joints
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.of_drives import TUNED, declared_loop_gains
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals


class PositionGains(RelativeGains):
    """Gains of the position's error, kp."""

    kind = effect_that(of_drive=TUNED[0])

    def run(self, plain: Run, values: Array) -> Run:
        """Return the stretch under drives of these gains."""
        return self._tuned(plain, self.over(plain.measured.shape[1], values))

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return what it does to raise each gain a little."""
        own = self.over(level.n, values)[list(self.joints)]

        def larger(place: int) -> Callable[[Run], Run]:
            step = np.ones(level.n)
            step[self.joints[place]] = (own[place] + BESIDE) / own[place]
            return lambda run: self._tuned(run, step)

        return [part / BESIDE for part in moved_by_runs(fit, [larger(k) for k in range(self.count)])]

    def _tuned(self, run: Run, ratio: Array) -> Run:
        return run.tuned(ratio, np.ones(len(ratio)))


class DampingGains(PositionGains):
    """Gains of the velocity's error, kd."""

    kind = effect_that(of_drive=TUNED[1])

    def _tuned(self, run: Run, ratio: Array) -> Run:
        return run.tuned(np.ones(len(ratio)), ratio)


def position_gains(before: TrajectoryFit, signals: Signals) -> Changed | None:
    """Return the kp that the motion asks for beside drives and delays; None where it asks for none.

    Parameters
    ----------
    before
        The fit without.
    signals
        The logs.
    """
    return _asked(before, signals, lambda joints: position_gains_of(before.unknowns.robot, joints))


def damping_gains(before: TrajectoryFit, signals: Signals) -> Changed | None:
    """Return the kd that the motion asks for, likewise, where drives are told velocities."""
    parts = [item.run.parts for item in before.tracked]
    if not any(part is not None and part[1].any() for part in parts):
        return None
    return _asked(before, signals, lambda joints: damping_gains_of(before.unknowns.robot, joints))


def position_gains_of(robot: Robot, joints: tuple[int, ...]) -> PositionGains:
    """Return the kp of some joints' drives as numbers, beyond what the robot declares."""
    return PositionGains(joints, tuple(declared_loop_gains(robot)[0].tolist()))


def damping_gains_of(robot: Robot, joints: tuple[int, ...]) -> DampingGains:
    """Return the kd of some joints' drives as numbers, beyond what the robot declares."""
    return DampingGains(joints, tuple(declared_loop_gains(robot)[1].tolist()))


def _asked(before: TrajectoryFit, signals: Signals, of: Callable[[tuple[int, ...]], PositionGains]) -> Changed | None:
    above, driven = before.above_noise(signals), np.any([item.run.drives.kp > 0 for item in before.tracked], axis=0)
    joints = tuple(np.flatnonzero((above >= DOUBTED) & driven).tolist())
    if not joints:
        return None
    every = of(joints)
    alone = Beside.of(before, every.moved(before, before.unknowns.robot, np.zeros(every.count)))
    clear = np.abs(alone.steps) > np.maximum(LEAST, SURE * alone.deviations)
    asked = [joint for joint, may in zip(joints, clear, strict=True) if may]
    return changed_joints(before, asked, of, LEAST)
