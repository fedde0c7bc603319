"""Several changes of the whole robot or of its drives, with the values that they have beside each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.poses import effects_of
from elid_cli.diagnosis.by_motion.torque_gains import CHECK, Gains, found_gains, gain_name, moved_by_gains
from elid_cli.diagnosis.result import Rival
from elid_cli.estimation.trajectory.beside import Beside
from elid_cli.estimation.trajectory.changes import CLEARLY, SURE, Change, Changed, descended, nearer_by, retuned
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.held_loops import negative
from elid_cli.estimation.trajectory.late_joints import beyond_common, declared_late, may_be_late, with_doubts
from elid_cli.model.effects.of_drives import TUNED
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

EXPLAINED = 0.8
"""Part of the squared error beyond noise that what is named only where it explains all but noise must take."""
HINTED = 2.0
"""Standard errors of a first step from which on a joint is looked at: a large error makes them too large."""


@dataclass(frozen=True)
class Several(Change):
    """The numbers of several changes, one after the other."""

    parts: tuple[Change, ...]

    @property
    def count(self) -> int:
        """How many they are."""
        return sum(part.count for part in self.parts)

    @property
    def most(self) -> Array:  # type: ignore[override]
        """Largest size of each."""
        return np.concatenate([np.broadcast_to(part.most, part.count) for part in self.parts])

    def split(self, values: Array) -> list[Array]:
        """Return the numbers of each change."""
        return np.split(values, np.cumsum([part.count for part in self.parts])[:-1])

    def robot(self, level: Robot, values: Array) -> Robot:
        """Return the robot with all changes."""
        for part, own in zip(self.parts, self.split(values), strict=True):
            level = part.robot(level, own)
        return level

    def run(self, plain: Run, values: Array) -> Run:
        """Return a stretch with all changes of the drives."""
        for part, own in zip(self.parts, self.split(values), strict=True):
            plain = part.run(plain, own)
        return plain

    def but(self, place: int, level: Robot, values: Array) -> Robot:
        """Return the robot with all changes but one."""
        for k, (part, own) in enumerate(zip(self.parts, self.split(values), strict=True)):
            level = level if k == place else part.robot(level, own)
        return level

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return how the positions change with each number, with all others as they are."""
        found = [part.moved(fit, self.but(k, level, values), own)
                 for k, (part, own) in enumerate(zip(self.parts, self.split(values), strict=True))]  # fmt: skip
        return [np.concatenate(stretch, axis=2) for stretch in zip(*found, strict=True)]


@dataclass(frozen=True)
class Together:
    """Changes beside each other, and the fit of the robot with all of them."""

    changes: tuple[Changed, ...]
    fit: TrajectoryFit
    runs: tuple[Run, ...]
    """The stretches with the drives as they are changed."""

    @classmethod
    def of(cls, change: Changed, plain: Sequence[Run]) -> Together:
        """Return a change, or each of several; `plain` are the stretches with the drives as they are described."""
        runs = tuple(change.runs(plain))
        if not isinstance(change.by, Several):
            return cls((change,), change.fit, runs)
        by, numbers = change.by, zip(change.by.split(change.values), change.by.split(change.deviations), strict=True)
        parts = [Changed(by.parts[k], values, deviations, by.but(k, change.level, change.values), change.fit)
                 for k, (values, deviations) in enumerate(numbers)]  # fmt: skip
        return cls(tuple(parts), change.fit, runs)

    @property
    def robot(self) -> Robot:
        """The robot as it is changed."""
        return self.fit.unknowns.robot

    @property
    def whole(self) -> bool:
        """Whether one of them is named only where all but noise is explained with it."""
        return any(change.by.whole for change in self.changes)

    def is_nearer(self, one: TrajectoryFit, other: TrajectoryFit) -> bool:
        """Whether a fit with them is clearly nearer than another, or with one that counts however little it does."""
        return clearly_nearer(one, other) or (
            len(self.changes) == 1 and replace(self.changes[0], fit=one).is_nearer(other)
        )

    def explains(self, before: Array, signals: Signals, least: float, part: float = EXPLAINED) -> bool:
        """Whether they take a part of what a fit without leaves beyond the encoders' noise, by the joints' mean.

        `before` is its error over the noise, (n,); joints from `least` on count.
        """
        off = before >= least
        bare, left = before[off] ** 2 - 1.0, np.maximum(self.fit.above_noise(signals)[off] ** 2 - 1.0, 0.0)
        return bool(np.mean(left / bare) <= 1.0 - part) if off.any() else False

    def tuned(self, robot: Robot, plain: Sequence[Run]) -> Together:
        """Return the changes with the values that they have beside each other.

        `robot` and `plain` are the robot and the stretches as they are described.
        """
        again = retuned(self._with(robot), self.fit, plain)
        return self if again is None or nearer_by(again.fit, self.fit) <= 0 else Together.of(again, plain)

    def _with(self, robot: Robot, *more: Change) -> Changed:
        """Return the changes as one, with more that do nothing yet."""
        by = Several((*(change.by for change in self.changes), *more))
        values = np.concatenate([*(change.values for change in self.changes), *(np.zeros(one.count) for one in more)])
        return Changed(by, values, np.zeros(by.count), robot, self.fit)

    def with_joints(self, robot: Robot, plain: Sequence[Run], kind: Kind) -> tuple[Together, list[Together]] | None:
        """Return the changes with one more, of the joints that the motion is sure of, and the same of others.

        None where it is sure of none.
        """
        joints = tuple(range(robot.n))
        one, own = self._with(robot, kind.of(joints)), kind.of(joints).count
        held = self.fit.unknowns.delays if kind.common else slice(0)
        moved = one.by.moved(self.fit, robot, one.values)
        alone = Beside.of(self.fit, moved, held)
        steps, deviations = (part[len(one.values) - own :] for part in (alone.steps, alone.deviations))
        may = may_be_late(self.fit, steps, deviations) if kind.common else np.ones(robot.n, dtype=bool)
        steps = beyond_common(self.fit, steps) if kind.common else steps
        left = tuple(k for k in joints if not kind.local or (may[k] and abs(steps[k]) > HINTED * deviations[k]))
        if not left and own == robot.n and not kind.common:
            # numbers of several joints that move it alike are sure of none beside each other
            return self._one_of(robot, plain, kind, self._hinted(moved, own))
        while left:
            one = self._with(robot, kind.of(left))
            found = descended(one, plain, self.fit)
            if found is None:
                return None
            both = Together.of(found, plain)
            last = both.changes[-1]
            if not kind.local:
                return (both, []) if last.sure.any() else None
            sure = last.sure & (np.abs(last.values[: len(left)]) > kind.least)
            kept = tuple(k for k, may in zip(left, sure, strict=True) if may)
            if kept == left:
                return self._fewer(both, robot, plain, kind, left)
            left = kept
        return None

    def _hinted(self, moved: Sequence[Array], own: int) -> list[int]:
        """Return the joints, whose numbers are the last ones of those that move the positions, that alone are sure."""
        first = moved[0].shape[2] - own
        found = []
        for k in range(own):
            kept = [*range(first), first + k]
            alone = Beside.of(self.fit, [part[:, :, kept] for part in moved])
            found += [k] if abs(alone.steps[-1]) > HINTED * alone.deviations[-1] else []
        return found

    def _one_of(
        self, robot: Robot, plain: Sequence[Run], kind: Kind, joints: Sequence[int]
    ) -> tuple[Together, list[Together]] | None:
        """Return changes with one more of a single joint, the one that comes nearest, and others that do as well."""
        tried = [descended(self._with(robot, kind.of((k,))), plain, self.fit) for k in joints]
        found = sorted((one for one in tried if one is not None), key=lambda one: -nearer_by(one.fit, self.fit))
        found = [one for one in found if abs(Together.of(one, plain).changes[-1].values[0]) > kind.least]
        near = [one for one in found if nearer_by(found[0].fit, one.fit) < CLEARLY]
        every = [Together.of(one, plain) for one in near]
        return (every[0], every[1:]) if every and every[0].changes[-1].sure.any() else None

    def _fewer(
        self, both: Together, robot: Robot, plain: Sequence[Run], kind: Kind, joints: Sequence[int]
    ) -> tuple[Together, list[Together]]:
        """Return changes with one more of a single joint where that comes as near as that of several; others that do.

        Beside a load, numbers of several joints make up for each other: all of them come out surely, and wrong.
        """
        asked = joints if len(joints) > 1 else ()
        alone = [descended(self._with(robot, kind.of((k,))), plain, self.fit) for k in asked]
        near = [one for one in alone if one is not None and nearer_by(both.fit, one.fit) < CLEARLY]
        if not near:
            return both, []
        first, *others = sorted(near, key=lambda one: -nearer_by(one.fit, self.fit))
        return Together.of(first, plain), [Together.of(one, plain) for one in others]


@dataclass(frozen=True)
class Kind:
    """A kind of changes."""

    alone: Callable[[TrajectoryFit], Changed | None] | None
    """Finds one beside a fit; None: it is asked for otherwise."""
    of: Callable[[tuple[int, ...]], Change]
    """Makes one, of some joints."""
    local: bool = True
    """Whether it is of single joints."""
    least: float = 0.0
    """Size that a number of a joint must have."""
    common: bool = False
    """Whether a fit has one number for all joints: the delay of a recording."""


def with_another(
    one: Together, robot: Robot, plain: Sequence[Run], kinds: Iterable[Kind]
) -> tuple[Together, list[Together]] | None:
    """Return changes with the one more that brings the motion nearest beside them, and others that do as well.

    None where none does clearly.

    A tool and a tilted base imitate each other: what either leaves, with the values that it has alone, looks like
    something else, or like nothing.

    Parameters
    ----------
    one
        The changes.
    robot, plain
        The robot and the stretches as they are described.
    kinds
        What may be beside them.
    """
    asked = (one.with_joints(robot, plain, kind) for kind in kinds)
    tried = [found for found in asked if found is not None and found[0].changes[-1].is_nearer(one.fit)]
    if not tried:
        return None
    most = max(nearer_by(both.fit, one.fit) for both, _ in tried)
    alike = [found for found in tried if nearer_by(found[0].fit, one.fit) >= most - CLEARLY]
    best, twins = min(alike, key=lambda found: found[0].changes[-1].numbers)
    most_numbers = best.changes[-1].numbers
    others = [both for both, _ in alike if both is not best and both.changes[-1].sure.sum() <= most_numbers]
    return best, [*twins, *others]


def simplest(changes: Sequence[Changed], plain: TrajectoryFit) -> tuple[Changed | None, tuple[Rival, ...]]:
    """Return the change of fewest numbers among the clearly nearest, and what does as well; None where none is near."""
    near = [one for one in changes if one.is_nearer(plain)]
    if not near:
        return None, ()
    most = max(nearer_by(one.fit, plain) for one in near)
    alike = [one for one in near if nearer_by(one.fit, plain) >= most - CLEARLY]
    best = min(alike, key=lambda one: (one.numbers, -nearer_by(one.fit, plain)))
    return best, tuple(
        replace(rival, drives=_moved(one, best)) for one in alike if one is not best and one.sure.sum() <= best.numbers
        for rival in rivals_of(one, best, plain)
    )  # fmt: skip


def _moved(one: Changed, best: Changed) -> Array | None:
    """Return by how much the drives' parameters are other with one change of drives than with another, (n * 4,)."""
    both = one.by.kind.of_drive and best.by.kind.of_drive
    return (one.fit.z - best.fit.z)[: best.fit.unknowns.drives] if both else None


def rivals_of(one: Changed, best: Changed, before: TrajectoryFit, others: Sequence[Changed] = ()) -> list[Rival]:
    """Return a change as rivals of the one that is named; `others` are named, as they are beside it."""
    beside = tuple(effect for change in others for effect in effects_of(change, before))
    return [
        Rival(e.effect, e.joint, best.by.kind.name, e.gain, e.parameters, best.by.kind.record, beside=beside)
        for e in effects_of(one, before)
    ]


def twins_of_gains(gains: Gains | None, asked: Together | None, before: TrajectoryFit) -> tuple[Rival, ...]:
    """Return changes that were asked for where gains were named, as their rivals where they come as near.

    `before` is the fit without both.
    """
    if gains is None or asked is None or clearly_nearer(gains.fit, asked.fit):
        return ()
    return tuple(
        Rival(e.effect, e.joint, gain_name(), e.gain, e.parameters, _separates(change))
        for change in asked.changes for e in effects_of(change, before)
    )  # fmt: skip


def shifts_of_twins(gains: Gains | None, asked: Together | None) -> tuple[Array, ...]:
    """Return by how much drive parameters are other where it is kp alone that is off, (n * 4,), if it may be that."""
    if gains is None or asked is None or all(change.by.kind.of_drive not in TUNED for change in asked.changes):
        return ()
    drives = asked.fit.unknowns.drives
    return (asked.fit.z[:drives] - gains.fit.z[:drives],)


def _separates(change: Changed) -> str:
    """Return what tells a change from gains of the drives."""
    return change.by.kind.record if change.by.kind.of_drive in TUNED else CHECK


def gains_as_near(gains: Gains | None, asked: Together, before: TrajectoryFit) -> tuple[Rival, ...]:
    """Return gains of the drives where changes were named, as their rivals where they come as near.

    `before` is the fit without both.
    """
    if gains is None or clearly_nearer(asked.fit, gains.fit) or drives_itself(gains, asked):
        return ()
    told = found_gains(before.unknowns.robot, before, gains.fit, gains, gains.deviation > 0)
    first, record = asked.changes[0].by.kind.name, _separates(asked.changes[0])
    return tuple(Rival(e.effect, e.joint, first, e.gain, e.parameters, record, e.std_error) for e in told)


def drives_itself(gains: Gains, asked: Together, errors: float = SURE) -> bool:
    """Whether a joint has no viscous friction with gains, less than none by so many errors, and some with changes."""
    return bool((negative(gains.fit, errors) & ~negative(asked.fit, errors)).any())


def clearly_nearer(one: TrajectoryFit, other: TrajectoryFit) -> bool:
    """Whether the joints' motion is clearly nearer in one fit than in another, on the whole."""
    return nearer_by(one, other) > CLEARLY


def aware(fit: TrajectoryFit, changes: Sequence[Changed], scaled: NDArray[np.bool_], robot: Robot) -> TrajectoryFit:
    """Return a fit with errors that know those of changes, of joints' gains (n,), and of delays that were not taken.

    Delays that the robot declares of some drives have the values of the motion then, unless they were not believed, or
    some were found.
    """
    found = any(change.by.kind.nuisance == "delay" for change in changes)
    known = None if found or not np.any(fit.tracked[0].run.extra) else declared_late(fit, robot)
    if known is not None:
        fit, changes = known.fit, (*changes, known)
    moved = [change.by.moved(fit, change.level, change.values) for change in changes]
    if scaled.any():
        moved.append(moved_by_gains(fit, np.flatnonzero(scaled).tolist()))
    fit, apart = with_doubts(fit), np.zeros(fit.unknowns.robot.n)
    for change in changes:
        if change.by.kind.nuisance == "delay":
            apart[list(change.by.joints)] = change.deviations[: len(change.by.joints)]
    fit = replace(fit, apart=apart)
    if not moved:
        return fit
    beside = Beside.of(fit, [np.concatenate(parts, axis=2) for parts in zip(*moved, strict=True)])
    return replace(fit, covariance=fit.covariance + beside.added)
