"""The search by motion, and again where the drives' gains, a tilted base or encoders' zeros explain more than it found.

Springs and other effects of single joints imitate both. A search that knows them finds what else is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Progress
from elid_cli.diagnosis.by_motion.carried import kinds_of_loads, load_rivals, other_load_of
from elid_cli.diagnosis.by_motion.found import Found
from elid_cli.diagnosis.by_motion.free_bodies import DOUBTED
from elid_cli.diagnosis.by_motion.gain_twins import with_gain_twins
from elid_cli.diagnosis.by_motion.loop_gains import damping_gains, damping_gains_of, position_gains, position_gains_of
from elid_cli.diagnosis.by_motion.poses import BaseAngles, Zeros, tilt_of, zeros_of
from elid_cli.diagnosis.by_motion.search import Searched, search
from elid_cli.diagnosis.by_motion.searched_log import SearchedLog
from elid_cli.diagnosis.by_motion.together import (
    Kind,
    Together,
    aware,
    clearly_nearer,
    drives_itself,
    gains_as_near,
    rivals_of,
    shifts_of_twins,
    simplest,
    twins_of_gains,
    with_another,
)  # fmt: skip
from elid_cli.diagnosis.by_motion.torque_gains import Gains, asked_by_motion, gains_of, given_up, nearer
from elid_cli.diagnosis.result import Rival
from elid_cli.estimation.known_load import LoadScale
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.changes import Changed, retuned
from elid_cli.estimation.trajectory.first_fits import FirstFit
from elid_cli.estimation.trajectory.fit import ABOVE, TrajectoryFit
from elid_cli.estimation.trajectory.integral_terms import integral_terms, terms_of
from elid_cli.estimation.trajectory.late_joints import LEAST, LateJoints, late_joints
from elid_cli.estimation.trajectory.timing_doubts import counting
from elid_cli.estimation.trajectory.velocity_filters import filters_of, velocity_filters
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import TUNED
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

CHANGES = 3
"""Most changes that are taken one after the other."""
HIDING = 1.03
"""Times the encoders' noise from which a load, which imitates much, is asked for with something else beside it, and the
masses of another body in place of what was found. Measured: what is right leaves 0.9 to 1."""
HOPED = 0.3
"""Part of the squared error beyond noise that other masses must take alone for a search to be made with them …"""
PROMISED = 0.15
"""… and a load, but where it brings the motion clearly nearer beside what was found. Measured: beside an integral term,
with which it explains all, 0.27."""


def searched(
    robot: Robot, signals: Signals, runs: Sequence[Run], declared: tuple[Sequence[Effect], Sequence[float]],
    off: Sequence[LoadScale], only: Sequence[str] = (), progress: Progress | None = None, first: FirstFit | None = None,
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
    only, progress, first
        As `search` has them.
    """
    done = search(robot, runs, started_from(robot, signals), *declared, only, progress, first)
    before = done.before
    plain = Found(done, before, robot, np.ones(robot.n), np.zeros(robot.n, dtype=bool), (), None, None)
    if done.partial:
        return plain
    found = plain
    try:
        log = SearchedLog(signals, runs, declared, only, progress)
        found = with_gain_twins(_by_other_bodies(plain, _by_both(plain, log, off), log), before)
        after = counting(aware(found.done.after, found.changes, found.scaled, found.robot), found.shifts)
        return replace(found, done=replace(found.done, before=before, after=after))
    except KeyboardInterrupt:
        return replace(found, done=replace(found.done, before=before, partial=True))


def _by_both(plain: Found, log: SearchedLog, off: Sequence[LoadScale]) -> Found:
    """Return what a search finds by gains of the drives and by changes: first by what comes nearer.

    Or by what leaves less to name beside it, and is no farther.
    """
    found, gains, scales = _asked_gains(plain, log, off)
    found, asked, rivals = _asked_changes(found, log)
    one: Found | None = None
    if asked is None or (gains is not None and not _goes_before(asked, gains, plain)):
        one = _gains_first(found, log, gains, scales, asked, rivals)
        if asked is None or one.items <= len(asked.changes):
            return one
    other, log = _by_changes(found, log, asked, (*rivals, *gains_as_near(gains, asked, plain.plain)))
    if other.changes:
        other, gains, scales = _asked_gains(other, log, ())
    other = _by_gains(other, log, gains, scales)[0]
    better = one is None or (other.items < one.items and not clearly_nearer(one.done.after, other.done.after))
    return other if better or one is None else one


def _gains_first(
    found: Found, log: SearchedLog, gains: Gains | None, scales: Sequence[LoadScale], asked: Together | None,
    rivals: tuple[Rival, ...],
) -> Found:  # fmt: skip
    """Return what a search finds by gains, then by changes; those `asked` for without gains are rivals of these."""
    plain = found.plain
    found, log = _by_gains(found, log, gains, scales)
    if found.scaled.any():
        twins = twins_of_gains(found.taken, asked, plain)
        shifts = shifts_of_twins(found.taken, asked) if twins else ()
        found, asked, rivals = _asked_changes(replace(found, rivals=(*found.rivals, *twins), shifts=shifts), log)
    return _by_changes(found, log, asked, rivals)[0]


def _goes_before(asked: Together, gains: Gains, plain: Found) -> bool:
    """Whether a change is named before gains: it comes clearly nearer, or is a load that does as well as several.

    Or a joint has viscous friction with it that has none with the gains.
    """
    if drives_itself(gains, asked, 0.0) and not clearly_nearer(gains.fit, asked.fit):
        return True
    several = int(nearer(plain.done.after, gains, plain.done.named).sum()) > 1
    return clearly_nearer(asked.fit, gains.fit) or (
        asked.whole and several and not clearly_nearer(gains.fit, asked.fit)
    )


def _by_other_bodies(plain: Found, found: Found, log: SearchedLog) -> Found:
    """Return what a search finds where one other body's masses are off, if that leaves noise alone and the rest not.

    Or if it does as well in place of several effects.
    """
    doubted = log.is_left(found.done.after, HIDING) or found.items > 1
    may = log.may(effect_that(carried=True)) and doubted
    change = other_load_of(plain.plain) if may else None
    if change is None or not change.is_nearer(plain.plain):
        return found
    asked = Together.of(change, log.runs)
    if not asked.explains(plain.plain.above_noise(log.signals), log.signals, DOUBTED, HOPED):
        return found
    other, _ = _by_asked(plain, log, asked, ())
    found = replace(found, done=replace(found.done, tried=found.done.tried + plain.robot.n - 1))
    if not other.changes:
        return found
    as_near = other.items < found.items and not clearly_nearer(found.done.after, other.done.after)
    if not as_near and not clearly_nearer(other.done.after, found.done.after):
        return found
    return replace(other, done=replace(other.done, tried=other.done.tried + found.done.tried))


def _by_changes(
    found: Found, log: SearchedLog, asked: Together | None, rivals: Sequence[Rival]
) -> tuple[Found, SearchedLog]:
    """Return what a search finds with one change after the other, as long as each comes clearly nearer; the log."""
    first, robot = log, found.robot
    for _ in range(CHANGES):
        before = len(found.changes)
        found, log = _by_asked(found, log, asked, rivals)
        if len(found.changes) == before:
            if asked is None or not asked.whole:
                break
            # what is named only where it explains all did not: what else there is
            found, asked, rivals = _asked_changes(found, log, whole=False)
            found, log = _by_asked(found, log, asked, rivals)
        if len(found.changes) == before:
            break
        found, asked, rivals = _asked_changes(found, log)
    return _together(found, log, first, robot)


def _together(found: Found, log: SearchedLog, first: SearchedLog, robot: Robot) -> tuple[Found, SearchedLog]:
    """Return what a search finds with the values that several changes have beside each other; the log then.

    Parameters
    ----------
    found, log
        As they were found one after the other.
    first, robot
        The log and the robot as they are described.
    """
    if len(found.changes) < 2 or not log.is_left(found.done.after):
        return found, log
    both = Together(found.changes, found.done.after, tuple(log.runs)).tuned(robot, first.runs)
    if not clearly_nearer(both.fit, found.done.after):
        return found, log
    other, done = log.changed(both)
    if not clearly_nearer(done.after, found.done.after):
        return found, log
    done = replace(done, tried=done.tried + found.done.tried)
    return replace(found, done=done, plain=done.before, robot=both.robot, changes=both.changes), other


def _asked_gains(
    found: Found, log: SearchedLog, off: Sequence[LoadScale]
) -> tuple[Found, Gains | None, list[LoadScale]]:
    """Return the fit by drives of another torque at the joints that are doubted, and these."""
    may = log.may(effect_that(of_drive="gain"))
    scales = asked_by_motion(found.plain, log.signals, off) if may else list(off)
    found = replace(found, done=replace(found.done, tried=found.done.tried + (len(scales) if may else 0)))
    return found, Gains.of(found.plain, found.done.after, scales, log.signals), scales


def _by_gains(
    found: Found, log: SearchedLog, gains: Gains | None, scales: Sequence[LoadScale]
) -> tuple[Found, SearchedLog]:
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


def _kinds(found: Found, log: SearchedLog, but: type[Effect] | None = None) -> list[tuple[type[Effect], Kind]]:
    """Return the kinds of changes that have not been found, without one effect's, and the effects that they are."""
    kinds = [
        (effect_that(turns_gravity=True), Kind(tilt_of, lambda _: BaseAngles(), local=False)),
        (effect_that(moves_zero=True), Kind(zeros_of, Zeros)),
        (effect_that(nuisance="delay"), Kind(late_joints, LateJoints, least=LEAST, common=True)),
        (effect_that(of_drive="filter"), Kind(velocity_filters, lambda joints: filters_of(found.robot, joints))),
        # asked for alone where the bodies' weight shows them, see `_asked_gains`
        (effect_that(of_drive="gain"), Kind(None, lambda joints: gains_of(found.robot, joints))),
        (
            effect_that(of_drive="kp"),
            Kind(lambda fit: position_gains(fit, log.signals), lambda joints: position_gains_of(found.robot, joints)),
        ),
        (
            effect_that(of_drive="kd"),
            Kind(lambda fit: damping_gains(fit, log.signals), lambda joints: damping_gains_of(found.robot, joints)),
        ),
        (
            effect_that(of_drive="integral"),
            Kind(lambda fit: integral_terms(fit, log.signals), lambda joints: terms_of(found.plain, joints)),
        ),
        *((effect_that(carried=True), kind) for kind in kinds_of_loads(found.robot)),
    ]
    known = {but, *(change.by.kind for change in found.changes)}
    known |= {effect_that(of_drive=which) for which in ("gain", *TUNED)} if found.scaled.any() else set()
    return [(kind, one) for kind, one in kinds if log.may(kind) and kind not in known]


def _asked_changes(
    found: Found, log: SearchedLog, whole: bool = True
) -> tuple[Found, Together | None, tuple[Rival, ...]]:
    """Return the change that brings the motion clearly nearer, with what does as well; None where none does.

    Without `whole`, no load.
    """
    kinds = _kinds(found, log, None if whole else effect_that(carried=True))
    # what effects that were found hide is asked for beside them
    for near in (found.plain, *([found.done.after] if found.done.named else [])):
        tried = [_worth(log.ask(*kind, near), near, found) for kind in kinds if kind[1].alone is not None]
        found = replace(found, done=replace(found.done, tried=found.done.tried + len(tried)))
        best, rivals = simplest([one for one in tried if one is not None], near)
        if best is not None:
            return found, Together.of(best, log.runs), rivals
    return found, None, ()


def _worth(one: Changed | None, near: TrajectoryFit, found: Found) -> Changed | None:
    """Return a change, but for one gain of a loop that effects which were found bring the motion clearly nearer than.

    Gains of a loop imitate springs: a search with them takes long, and leads nowhere then.
    """
    gain = one is not None and one.by.kind.of_drive in TUNED and near is found.plain
    return None if one is not None and gain and clearly_nearer(found.done.after, one.fit) else one


def _by_asked(
    found: Found, log: SearchedLog, asked: Together | None, rivals: Sequence[Rival]
) -> tuple[Found, SearchedLog]:
    """Return what a search finds with changes, where they come clearly nearer; the log then."""
    if asked is None or (asked.whole and not _may_explain(asked, found, log)):
        return found, log
    other, done = log.changed(asked)  # a load may bring little with the values that it has alone
    if not (asked.whole or asked.is_nearer(done.after, found.done.after)):
        return found, log
    if log.is_left(done.after, HIDING if asked.whole else DOUBTED):
        for again, twins in _nearer_yet(found, log, asked, done):
            if clearly_nearer(again.fit, done.after):
                more, better = log.changed(again)
                if clearly_nearer(better.after, done.after):
                    asked, other, done, rivals = again, more, better, (*rivals, *twins)
    if not asked.is_nearer(done.after, found.done.after):
        return found, log
    explained = asked.explains(found.plain.above_noise(log.signals), log.signals, DOUBTED)
    if asked.whole and not (explained and (done.after.above_noise(log.signals) < ABOVE).all()):
        return found, log
    done = replace(done, tried=done.tried + found.done.tried)
    rivals = (*rivals, *(rival for change in asked.changes for rival in load_rivals(change, found.plain)))
    shifts = (*found.shifts, *(rival.drives for rival in rivals if rival.drives is not None))
    return replace(found, done=done, plain=done.before, robot=asked.robot, changes=(*found.changes, *asked.changes),
                   gains=None, rivals=(*found.rivals, *rivals), shifts=shifts), other  # fmt: skip


def _may_explain(asked: Together, found: Found, log: SearchedLog) -> bool:
    """Whether a load, which is named only where all but noise is explained with it, may come to that."""
    if asked.explains(found.plain.above_noise(log.signals), log.signals, DOUBTED, PROMISED):
        return True
    beside = log.ask(effect_that(carried=True), kinds_of_loads(found.robot)[0], found.done.after)
    return beside is not None and beside.is_nearer(found.done.after)


def _nearer_yet(
    found: Found, log: SearchedLog, asked: Together, done: Searched
) -> Iterator[tuple[Together, Sequence[Rival]]]:
    """Yield a change as it is beside what a search found with it, and one that may hide others with what that is.

    With the latter, what does as well.
    """
    (change,) = asked.changes
    again = retuned(change, done.after, log.runs)
    if again is not None:
        yield Together.of(again, log.runs), ()
    if change.by.whole:
        alone = replace(asked, fit=done.before)
        kinds = [kind for _, kind in _kinds(found, log, change.by.kind)]
        both = with_another(alone, found.robot, log.runs, kinds)
        if both is not None:
            best = both[0].changes[-1]
            yield both[0], [rival for twin in both[1]
                            for rival in rivals_of(twin.changes[-1], best, alone.fit, twin.changes[:-1])]  # fmt: skip
