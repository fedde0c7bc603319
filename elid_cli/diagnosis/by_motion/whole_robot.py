"""The search by motion, and again where the drives' gains, a tilted base or encoders' zeros explain more than it found.

Springs and other effects of single joints imitate both. A search that knows them finds what else is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array, Progress
from elid_cli.diagnosis.by_motion.carried import load_of, load_rivals
from elid_cli.diagnosis.by_motion.free_bodies import DOUBTED
from elid_cli.diagnosis.by_motion.poses import effects_of, tilt_of, zeros_of
from elid_cli.diagnosis.by_motion.search import Searched, search
from elid_cli.diagnosis.by_motion.torque_gains import (
    Gains,
    asked_by_motion,
    given_up,
    moved_by_gains,
    nearer,
)
from elid_cli.diagnosis.result import Rival
from elid_cli.estimation.known_load import LoadScale
from elid_cli.estimation.trajectory.beside import Beside
from elid_cli.estimation.trajectory.changes import CLEARLY, Changed, nearer_by, retuned
from elid_cli.estimation.trajectory.fit import ABOVE, TrajectoryFit
from elid_cli.estimation.trajectory.identification import started_from
from elid_cli.estimation.trajectory.integral_terms import integral_terms
from elid_cli.estimation.trajectory.late_joints import late_joints
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import with_drives
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

CHANGES = 3
"""Most changes that are taken one after the other."""
EXPLAINED = 0.8
"""Part of the squared error that a change must take alone which is named only where it explains all but noise."""
PASSES = 3
"""Times that each of several is found again beside the others."""


@dataclass(frozen=True)
class Found:
    """What a search came to, with what acts on the whole."""

    done: Searched
    """`before` is the fit of the robot as it is described."""
    plain: TrajectoryFit
    """The fit without effects beside what acts on the whole."""
    robot: Robot
    """The robot as it is changed."""
    ratio: Array
    """What the computed torque of every joint is over the one that acts, (n,)."""
    scaled: NDArray[np.bool_]
    """Joints where that is named, (n,)."""
    changes: tuple[Changed, ...]
    """Angles of the base, zeros of encoders, delays of some drives: each as found with those before it."""
    gains: Gains | None
    """The fit by drives of another torque at the other joints that are doubted."""
    taken: Gains | None
    """The one whose gains are named."""
    rivals: tuple[Rival, ...] = ()
    """What does as well as these."""


def searched(
    robot: Robot, signals: Signals, runs: Sequence[Run], declared: tuple[Sequence[Effect], Sequence[float]],
    off: Sequence[LoadScale], only: Sequence[str] = (), progress: Progress | None = None,
) -> Found:  # fmt: skip
    """Search for effects, for gains of the drives in their place, for a robot that stands otherwise than described.

    Parameters
    ----------
    robot, signals, runs
        The robot, the log, and its stretches that commands drive.
    declared
        Effects that the robot declares, and their amplitudes.
    off
        What multiplies the torque that the bodies need, of the joints where that is surely not 1.
    only, progress
        As `search` has them.
    """
    done = search(robot, runs, started_from(robot, signals), *declared, only, progress)
    first = done.before
    plain = Found(done, first, robot, np.ones(robot.n), np.zeros(robot.n, dtype=bool), (), None, None)
    if done.partial:
        return plain
    found = plain
    try:
        found = _by_both(plain, _Log(signals, runs, declared, only, progress), off)
        return replace(found, done=replace(found.done, before=first, after=_aware(found)))
    except KeyboardInterrupt:
        return replace(found, done=replace(found.done, before=first, partial=True))


@dataclass(frozen=True)
class _Log:
    """What is searched."""

    signals: Signals
    runs: Sequence[Run]
    declared: tuple[Sequence[Effect], Sequence[float]]
    only: Sequence[str]
    progress: Progress | None

    def searched(self, robot: Robot, start: Array) -> Searched:
        """Return what a search finds; one that Ctrl-C ends was not compared, and what was found before stands."""
        done = search(robot, self.runs, start, *self.declared, self.only, self.progress)
        if done.partial:
            raise KeyboardInterrupt
        return done

    def delivering(self, ratio: Array) -> _Log:
        """Return the log of drives that deliver the computed torque over a ratio, (n,)."""
        right = with_drives(self.signals, np.zeros(len(ratio)), ratio)
        return replace(self, signals=right, runs=[run.delivering(ratio) for run in self.runs])

    def is_left(self, fit: TrajectoryFit) -> bool:
        """Whether a fit leaves more than the encoders' noise at a joint."""
        return bool((fit.above_noise(self.signals) >= DOUBTED).any())

    def may(self, kind: type[Effect]) -> bool:
        """Whether an effect may be tried."""
        return not self.only or kind.name in self.only


def _by_both(plain: Found, log: _Log, off: Sequence[LoadScale]) -> Found:
    """Return what a search finds by gains of the drives and by changes, what comes nearer first."""
    found, gains, scales = _asked_gains(plain, log, off)
    found, change, rivals = _asked_change(found, log)
    if change is None or (gains is not None and not _nearer(change.fit, gains.fit)):
        found, log = _by_gains(found, log, gains, scales)
        if found.scaled.any():
            found, change, rivals = _asked_change(found, log)
        return _by_changes(found, log, change, rivals)[0]
    found, log = _by_changes(found, log, change, rivals)
    if found.changes:
        found, gains, scales = _asked_gains(found, log, ())
    return _by_gains(found, log, gains, scales)[0]


def _by_changes(found: Found, log: _Log, change: Changed | None, rivals: Sequence[Rival]) -> tuple[Found, _Log]:
    """Return what a search finds with one change after the other, as long as each comes clearly nearer; the log."""
    first, robot = log, found.robot
    for _ in range(CHANGES):
        before = len(found.changes)
        found, log = _by_change(found, log, change, rivals)
        if len(found.changes) == before:
            break
        found, change, rivals = _asked_change(found, log)
    return _together(found, log, first, robot)


def _together(found: Found, log: _Log, first: _Log, robot: Robot) -> tuple[Found, _Log]:
    """Return what a search finds with the values that several changes have beside each other; the log then.

    Parameters
    ----------
    found, log
        As they were found one after the other.
    first, robot
        The log and the robot as they are described.
    """
    changes, nearest, before = list(found.changes), found.done.after, log
    for place in [*range(len(changes))] * PASSES if len(changes) > 1 and log.is_left(nearest) else ():
        level, plain = robot, list(first.runs)
        for other in (*changes[:place], *changes[place + 1 :]):
            level, plain = other.by.robot(level, other.values), other.runs(plain)
        again = retuned(replace(changes[place], level=level), nearest, plain)
        if again is not None and nearer_by(again.fit, nearest) > 0:
            changes[place], nearest = again, again.fit
            log = replace(log, runs=again.runs(plain))
    if not _nearer(nearest, found.done.after):
        return found, before
    done = log.searched(nearest.unknowns.robot, nearest.values)
    if not _nearer(done.after, found.done.after):
        return found, before
    done = replace(done, tried=done.tried + found.done.tried)
    return replace(found, done=done, plain=done.before, robot=nearest.unknowns.robot, changes=tuple(changes)), log


def _asked_gains(found: Found, log: _Log, off: Sequence[LoadScale]) -> tuple[Found, Gains | None, list[LoadScale]]:
    """Return the fit by drives of another torque at the joints that are doubted, and these."""
    may = log.may(effect_that(of_drive="gain"))
    scales = asked_by_motion(found.plain, log.signals, off) if may else list(off)
    found = replace(found, done=replace(found.done, tried=found.done.tried + (len(scales) if may else 0)))
    return found, Gains.of(found.plain, found.done.after, scales, log.signals), scales


def _by_gains(found: Found, log: _Log, gains: Gains | None, scales: Sequence[LoadScale]) -> tuple[Found, _Log]:
    """Return what a search finds by drives of another torque, where these come clearly nearer; the log then."""
    before = found.done
    scaled = nearer(before.after, gains, before.named) & log.may(effect_that(of_drive="gain"))
    if gains is None or not scaled.any():
        return replace(found, gains=gains), log
    ratio = np.where(scaled, gains.ratio, 1.0)
    log, robot = log.delivering(ratio), found.robot
    done = log.searched(robot, started_from(robot, log.signals))
    done = replace(done, tried=done.tried + before.tried)
    others = Gains.of(done.before, done.after, [s for s in scales if not scaled[s.joint]], log.signals)
    rivals = (*found.rivals, *given_up(before.after, gains, before.named, scaled))
    return replace(found, done=done, plain=done.before, ratio=ratio, scaled=scaled, gains=others, taken=gains,
                   rivals=rivals), log  # fmt: skip


def _asked_change(found: Found, log: _Log) -> tuple[Found, Changed | None, tuple[Rival, ...]]:
    """Return the change that brings the motion clearly nearer, with what does as well; None where none does."""
    asked = (
        (effect_that(turns_gravity=True), tilt_of), (effect_that(moves_zero=True), zeros_of),
        (effect_that(nuisance="delay"), late_joints),
        (effect_that(of_drive="integral"), lambda fit: integral_terms(fit, log.signals)),
        (effect_that(local=True, whole_robot=True), load_of),
    )  # fmt: skip
    known = {change.by.kind for change in found.changes}
    kinds = [(kind, change_of) for kind, change_of in asked if log.may(kind) and kind not in known]
    # what effects that were found hide is asked for beside them
    for near in (found.plain, *([found.done.after] if found.done.named else [])):
        tried = [change_of(near) for _, change_of in kinds]
        found = replace(found, done=replace(found.done, tried=found.done.tried + len(tried)))
        best, rivals = _simplest([one for one in tried if one is not None], near)
        if best is not None:
            return found, best, rivals
    return found, None, ()


def _by_change(found: Found, log: _Log, change: Changed | None, rivals: Sequence[Rival]) -> tuple[Found, _Log]:
    """Return what a search finds with the change, where that comes clearly nearer; the log then."""
    if change is None:
        return found, log
    other = replace(log, runs=change.runs(log.runs))
    done = other.searched(change.robot, change.fit.values)
    if not _nearer(done.after, found.done.after):
        return found, log
    # what was found with it may have moved its values, as it moved what was found before
    again = retuned(change, done.after, log.runs) if log.is_left(done.after) else None
    if again is not None and _nearer(again.fit, done.after):
        change, other = again, replace(log, runs=again.runs(log.runs))
        done = other.searched(change.robot, change.fit.values)
    short = change.gain(found.plain) < EXPLAINED or (done.after.above_noise(log.signals) >= ABOVE).any()
    if change.by.whole and short:
        return found, log
    done = replace(done, tried=done.tried + found.done.tried)
    changes, rivals = (*found.changes, change), (*found.rivals, *rivals, *load_rivals(change, found.plain))
    return replace(found, done=done, plain=done.before, robot=change.robot, changes=changes, gains=None,
                   rivals=rivals), other  # fmt: skip


def _simplest(changes: Sequence[Changed], plain: TrajectoryFit) -> tuple[Changed | None, tuple[Rival, ...]]:
    """Return the change of fewest numbers among the clearly nearest, and what does as well; None where none is near."""
    near = [one for one in changes if one.is_nearer(plain)]
    if not near:
        return None, ()
    most = max(nearer_by(one.fit, plain) for one in near)
    alike = [one for one in near if nearer_by(one.fit, plain) >= most - CLEARLY]
    best = min(alike, key=lambda one: (int(one.sure.sum()), -nearer_by(one.fit, plain)))
    return best, tuple(
        Rival(e.effect, e.joint, best.by.kind.name, e.gain, e.parameters, best.by.kind.record)
        for one in alike if one is not best and one.sure.sum() == best.sure.sum() for e in effects_of(one, plain)
    )  # fmt: skip


def _nearer(one: TrajectoryFit, other: TrajectoryFit) -> bool:
    """Whether the joints' motion is clearly nearer in one fit than in another, on the whole."""
    return nearer_by(one, other) > CLEARLY


def _aware(found: Found) -> TrajectoryFit:
    """Return the fit with errors that know those of gains and of a change."""
    fit = found.done.after
    moved = [change.by.moved(fit, change.level, change.values) for change in found.changes]
    if found.scaled.any():
        moved.append(moved_by_gains(fit, np.flatnonzero(found.scaled).tolist()))
    if not moved:
        return fit
    beside = Beside.of(fit, [np.concatenate(parts, axis=2) for parts in zip(*moved, strict=True)])
    return replace(fit, covariance=fit.covariance + beside.added)
