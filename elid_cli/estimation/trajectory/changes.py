"""A few numbers that change the robot, or what drives it, beside what a trajectory fit finds: Gauss-Newton on both."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.trajectory.beside import SETTLED, Beside
from elid_cli.estimation.trajectory.change_steps import GOES_ON, refitted_as, stepped_to
from elid_cli.estimation.trajectory.change_steps import nearer_by as nearer_by  # others have it from here
from elid_cli.estimation.trajectory.fit import COARSE, TrajectoryFit
from elid_cli.estimation.trajectory.memory import has_memory
from elid_cli.estimation.trajectory.own_values import with_own_values_again
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import TUNED
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

STEPS = 12
"""Most steps of the numbers."""
SURE = 5.0
"""Standard errors by which a number must be clear of 0."""
CLEARLY = 0.2
"""Sum over the joints of the logarithm of the error's size by which a fit is clearly nearer."""
PER_JOINT = 0.04
"""The same per joint that a change alone must reach before a search is made with it. Measured: a quadruped of twelve
joints on level ground 0.028, whose search takes minutes."""
HOPEFUL = 0.5
"""Part of what a change must reach by which the error must fall: by first order with the first step …"""
TRIED = 2
"""… and in fact from this step on, from 0."""
STILL = 1e-9
"""rad (m) by which positions change with 1 of a number that no joint feels."""


class Change(ABC):
    """Numbers that change a robot or its drives against their description."""

    kind: type[Effect]
    """The effect that they are."""
    joints: tuple[int, ...] = ()
    """Of which joints they are, the first numbers, one each; () of the whole robot. Others are found beside them."""
    most: float | Array
    """Largest size of a number, of all or (count,) of each."""
    summary: str = ""
    """What it is, in words; empty: those of the effect."""
    little: bool = False
    """Whether it counts however little nearer it brings the motion, where nothing but noise is left with it: it bends
    other values by many of their errors."""
    curved: bool = False
    """Whether its error falls to a narrow bottom that a whole step may jump over: steps that end farther are halved."""
    whole: bool = False
    """Whether it is named only where all but noise is explained with it: what else is missing may imitate it."""

    @property
    def at(self) -> int | None:
        """The joint that it is told of, where it is of the whole robot and told of one."""
        return None

    @property
    def count(self) -> int:
        """How many they are."""
        return len(self.joints)

    def robot(self, level: Robot, values: Array) -> Robot:
        """Return the robot, changed from its description by values, (count,)."""
        return level

    def written(self, robot: Robot, level: Robot) -> Robot:
        """Return the changed robot as it is written: one that can be built. `level` is the one that is described."""
        return robot

    def run(self, plain: Run, values: Array) -> Run:
        """Return a stretch with drives that are changed by values, (count,)."""
        return plain

    def beside(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the unknowns (U,) that a fit with values to begin with, (count,), begins with."""
        return fit.z

    def ratio(self, count: int, values: Array) -> Array:
        """Return the computed torque over the one that acts, beyond what is declared, of `count` joints, (count,)."""
        return np.ones(count)

    def named(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the values as the effect's parameters, (count,)."""
        return values

    def spread(self, fit: TrajectoryFit, deviations: Array) -> Array:
        """Return the standard errors of these parameters, (count,)."""
        return deviations

    @abstractmethod
    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return how the positions of a fit's stretches change with the values, rad (m) per 1, (N, n, count) each.

        `level` is the robot as it is described, the fit that of the changed one.
        """


@dataclass(frozen=True)
class Changed:
    """The robot with such a change, and the fit of it."""

    by: Change
    values: Array
    """(count,)."""
    deviations: Array
    """Standard errors, (count,); infinite of a number that no joint of the robot feels."""
    level: Robot
    """The robot as it is described."""
    fit: TrajectoryFit

    @property
    def robot(self) -> Robot:
        """The robot as it is changed."""
        return self.fit.unknowns.robot

    def runs(self, plain: Sequence[Run]) -> list[Run]:
        """Return stretches with drives as they are changed."""
        return [self.by.run(run, self.values) for run in plain]

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Which numbers are clear of 0: one for each joint, or all of the whole robot's."""
        found: NDArray[np.bool_] = np.abs(self.values) > SURE * self.deviations
        return found[: len(self.by.joints) or self.by.count]

    @property
    def numbers(self) -> int:
        """How many numbers it is: those of joints that are clear of 0, all of the whole robot's that a joint feels."""
        return int(self.sure.sum()) if self.by.joints else int(np.isfinite(self.deviations).sum())

    @property
    def rates(self) -> Array:
        """Integral over proportional gain of every joint's drive that it finds, 1/s, (n,)."""
        return self._of_drives("integral")

    @property
    def filters(self) -> Array:
        """Time constant of the filter of every joint's velocity that it finds, s, (n,)."""
        return self._of_drives("filter")

    @property
    def loop_gains(self) -> Array:
        """The logged kp, and kd, of every joint's drive over the one that it finds, beyond what is declared, (2, n)."""
        return 1.0 + np.array([self._of_drives(which) for which in TUNED])

    def _of_drives(self, which: str) -> Array:
        found = np.zeros(self.level.n)
        if self.by.kind.of_drive == which:
            found[list(self.by.joints)] = self.values[: len(self.by.joints)]
        return found

    @property
    def ratio(self) -> Array:
        """The computed torque of every joint over the one that acts, beyond what is declared, (n,)."""
        return self.by.ratio(self.level.n, self.values)

    def aware(self) -> TrajectoryFit:
        """Return the fit with errors that know those of the change."""
        beside = Beside.of(self.fit, self.by.moved(self.fit, self.level, self.values))
        return replace(self.fit, covariance=self.fit.covariance + beside.added)

    def is_nearer(self, before: TrajectoryFit) -> bool:
        """Whether it brings the motion clearly nearer than a fit without, on the whole."""
        least = _least(self.level)
        if _counts(self.by, self.fit):
            # twice the logarithm of the likelihood of noise without memory
            least = min(least, 0.5 * SURE**2 / sum(int(item.counts.sum()) for item in before.tracked))
        return nearer_by(self.fit, before) > least and self.gain(before) > 0

    def squares(self, before: TrajectoryFit) -> tuple[Array, Array]:
        """Return the squared errors of every joint, in the size that a fit leaves, of that fit and with the change."""
        bare, left = (fit.equations.lighter.sum(axis=0) / before.equations.size**2 for fit in (before, self.fit))
        return bare, left

    def gain(self, before: TrajectoryFit) -> float:
        """Return what it takes from the squared error of a fit without, every joint in its size."""
        bare, left = self.squares(before)
        return float(1.0 - left.sum() / bare.sum())


def _least(robot: Robot) -> float:
    """Return the logarithm of the errors' sizes, summed over the joints, by which a change must be nearer."""
    return max(CLEARLY, PER_JOINT * robot.n)


def least_of(fit: TrajectoryFit) -> float:
    """Return by how much another fit without memory must be nearer to be clearly so, `nearer_by`."""
    return 0.5 * SURE**2 / sum(int(item.counts.sum()) for item in fit.tracked)


def nearer_throughout(one: TrajectoryFit, other: TrajectoryFit) -> float:
    """Return by how many of its standard errors one fit is nearer than another over the course of the log.

    The mean over short parts of what its squared error is less by beside its scatter (Vuong, Econometrica, 1989): an
    error with a memory has far fewer samples than the log, and the parts tell how many.
    """
    sizes = np.maximum(other.equations.size, 1e-12) ** 2
    less = ((other.equations.course - one.equations.course) / sizes).sum(axis=1)
    return float(less.mean() / max(less.std() / np.sqrt(max(len(less) - 1, 1)), 1e-300))


def changed(before: TrajectoryFit, by: Change, start: Array | None = None) -> Changed | None:
    """Return the change that the motion asks for beside all that a fit finds; None where it asks for none.

    Parameters
    ----------
    before
        The fit of the robot and the drives as they are described.
    by
        What is to be changed.
    start
        Values to begin with, (count,); None: 0.
    """
    values, robot, plain = np.zeros(by.count), before.unknowns.robot, [item.run for item in before.tracked]
    if start is None:
        return descended(Changed(by, values, values, robot, before), plain, before)
    fit = refitted_as(before, by.robot(robot, start), [by.run(run, start) for run in plain], by.beside(before, start))
    return None if fit is None else descended(Changed(by, start, values, robot, fit), plain, before, TRIED)


def retuned(change: Changed, fit: TrajectoryFit, plain: Sequence[Run]) -> Changed | None:
    """Return a change with the values that it has beside what was found since.

    Parameters
    ----------
    change, fit
        The change, and the fit of the changed robot with what was found since.
    plain
        The stretches with the drives as they are described.
    """
    return descended(replace(change, fit=fit), plain, None)


def descended(
    started: Changed, plain: Sequence[Run], before: TrajectoryFit | None, done: int = 0, *, known: bool = False
) -> Changed | None:
    """Return a change at the values that the motion asks for; None where it asks for none, or not enough of `before`.

    Parameters
    ----------
    started
        The values and the fit to begin with.
    plain
        The stretches with the drives as they are described.
    before
        The fit without the change, where it may be none; None: it is a change that was found.
    done
        Steps that were done before.
    known
        Whether the change is there, however small it comes out.
    """
    by, level, fit, values = started.by, started.level, started.fit, started.values
    fell, hopeful = np.inf, HOPEFUL * _least(level)
    for number in range(done, STEPS):
        moved = by.moved(fit, level, values)
        found = Beside.of(fit, moved)
        if before is not None and number == 0 and not by.little and -0.5 * np.log(found.left).sum() < hopeful:
            return None
        shown = np.any([np.abs(part).max(axis=(0, 1)) > STILL for part in moved], axis=0)
        deviations = np.where(shown, np.hypot(found.deviations, COARSE * by.most), np.inf)
        settled = (np.abs(found.steps) <= SETTLED * deviations).all()
        if number == STEPS - 1 or (settled and fell < GOES_ON):
            other = with_own_values_again(fit)
            if set(other.unknowns.own) > set(fit.unknowns.own):
                # without the change, what is missing hid how offsets differ between recordings
                anew = replace(started, values=values, fit=other)
                return descended(anew, plain, before, max(done, TRIED), known=known)
            break
        stepped = stepped_to(
            fit, (values, found.steps, found.along), by.most,
            lambda new: (by.robot(level, new), [by.run(run, new) for run in plain]), halved=by.curved,
        )  # fmt: skip
        if stepped is None:
            return None
        values, again = stepped
        fell = nearer_by(again, fit)
        fit = again
        tried = number >= (1 if by.little else TRIED)
        falls = by.curved and fell > hopeful  # from outside of a valley the way into it leads over worse
        if before is not None and tried and nearer_by(fit, before) < hopeful and not (falls or _counts(by, fit)):
            return None
    made = Changed(by, values, deviations, level, fit)
    return made if (known or made.sure.any()) and (np.abs(values) < by.most).all() else None


def _counts(by: Change, fit: TrajectoryFit) -> bool:
    """Whether a change counts however little nearer it brings the motion: it leaves nothing but noise."""
    return by.little and not has_memory(fit.equations)


def changed_joints(
    before: TrajectoryFit, joints: Sequence[int], of: Callable[[tuple[int, ...]], Change], least: float = 0.0,
    start: Array | None = None,
) -> Changed | None:  # fmt: skip
    """Return the change of those of some joints that the motion is sure of; None where there are none.

    Parameters
    ----------
    before
        The fit without.
    joints
        Where the change may be. Those that are not clear of 0 are left out, and the others found again.
    of
        Makes the change of some joints.
    least
        Size that a change must have.
    start
        The first numbers of all joints to begin with, (n,); None: 0.
    """
    left = tuple(joints)
    while left:
        by = of(left)
        begun = None if start is None else np.append(start[list(left)], np.zeros(by.count - len(left)))
        found = changed(before, by, begun)
        if found is None:
            return None
        sure = found.sure & (np.abs(found.values[: len(left)]) > least)
        kept = tuple(joint for joint, may in zip(left, sure, strict=True) if may)
        if kept == left:
            return found
        left = kept
    return None
