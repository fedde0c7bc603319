"""Diagnosis of command logs: which effects bring the simulated motion nearer to the measured one.

One round after the other: simulate, screen the whole library at every joint, take the best effect of each joint that
blocks of time not fitted to support, fit all again. An effect stays only if the final motion is worse without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array, Progress
from elid_cli.diagnosis.by_motion.candidates import (
    Candidate,
    View,
    best_of,
    edges_of,
    kinds_of,
    recordings_of,
    screened,
    tried_of,
)
from elid_cli.diagnosis.by_motion.held_out import Blocks, gain
from elid_cli.diagnosis.by_motion.in_common import common_gain, has_one_sign
from elid_cli.diagnosis.by_motion.measured import is_clean, measured_views
from elid_cli.diagnosis.by_motion.refits import (
    again,
    grown,
    hardened,
    in_place,
    softened_again,
    with_delay,
    without,
)  # fmt: skip
from elid_cli.diagnosis.by_motion.rivals import in_best_forms, with_rivals
from elid_cli.diagnosis.by_motion.search_progress import ROUNDS, Told
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.diagnosis.by_motion.torque_limits import TorqueLimit, limited, sharpened
from elid_cli.diagnosis.by_motion.views import own_unknowns, seen_by, views_of
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.changes import CLEARLY, nearer_by
from elid_cli.estimation.trajectory.first_fits import FirstFit, first_fit
from elid_cli.estimation.trajectory.fit import CYCLES, TrajectoryFit
from elid_cli.estimation.trajectory.own_values import with_own_values_again
from elid_cli.estimation.trajectory.softening import gains_of
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

IN_VAIN = 3
"""Further rounds of which nothing is kept: what screening prefers at a joint need not be what is missing there."""
HELPED = 0.75
"""Part of the blocks of time that an effect must make better."""
HOPEFUL = 0.4
"""Part of them that one must make better to be tried at all: screening knows nothing of a joint that sticks."""
FURTHER = 0.3
"""Gain that a further effect at a joint must have: what is left of the first, not quite in its shape, is none."""
SURE = 2.0
"""Standard errors by which an effect's amplitude must be clear of 0."""
ALIKE = 0.9
"""Part of the best effect's gain from which another one does as well."""
STUCK = 0.04
"""Part of a joint's squared error from which a friction that holds is tried."""
LEAST = 0.15
"""Part of the squared error that an effect must take away, at least, whatever it says itself."""


@dataclass(frozen=True)
class Searched:
    """What a search came to."""

    before: TrajectoryFit
    """The fit of the robot as it is described."""
    after: TrajectoryFit
    softer: Mapping[int, float]
    """What friction that fades in takes away, by joint; its effects stand before those of `named`."""
    named: tuple[Named, ...]
    left: tuple[Candidate, ...]
    """The best candidate of every joint that was not taken."""
    tried: int
    partial: bool
    waiting: tuple[Named, ...] = ()
    """Effects that were chosen but not judged yet when the search was stopped."""
    limits: tuple[TorqueLimit, ...] = ()
    """Lower limits of torque, which the fit after has."""


def search(
    robot: Robot,
    runs: Sequence[Run],
    start: Array,
    declared: Sequence[Effect],
    amplitudes: Sequence[float],
    only: Sequence[str] = (),
    progress: Progress | None = None,
    first: FirstFit | None = None,
) -> Searched:
    """Search for the effects that a robot's motion under its commands lacks.

    Parameters
    ----------
    robot, runs
        The robot and stretches of logs that commands drive.
    start
        Drive parameters to start from, (n, 4).
    declared, amplitudes
        Effects that the robot declares, with their amplitudes.
    only
        Names of the effects to try; empty: all that a simulated motion can hold.
    progress
        Called with a label and the finished part.
    first
        The first fit of the motion, where one was made before.
    """
    kinds = kinds_of(effect_classes(), only)
    say = Told(progress)
    tell = say.first()
    fit = first_fit(robot, runs, start, (declared, amplitudes), first, tell).fit
    before, limits, partial, tried = fit.held or fit, tuple[TorqueLimit, ...](), False, 0
    try:
        if any(kind.of_drive == "limit" for kind in tried_of(effect_classes(), only)):
            fit, limits = limited(fit, kinds)
            tried += robot.n
    except KeyboardInterrupt:
        partial = True
    softer, known = gains_of(fit), len(fit.effects)
    named = list[Named]()
    left: tuple[Candidate, ...] = ()
    waiting: list[Named] = []
    dropped = frozenset[tuple[str, int]]()
    try:
        taken = vain = 0
        while True:
            best, left, count = _best(fit, kinds, say.screening(min(taken, ROUNDS - 1)), dropped)
            tried += count
            if partial or not best or taken == ROUNDS or vain == IN_VAIN:
                break
            waiting = best
            # nothing counts as found before it is judged: Ctrl-C may come at any time
            fit, named = _with(best, fit, named, known, say.fitting(taken, len(named) + len(best)))
            kept = _pairs(best) & _pairs(named)
            # a wrong form leaves what looks like a second effect
            fit, named = in_best_forms(fit, named, kept, known)
            taken, vain = taken + bool(kept), vain + (not kept)
            dropped = _dropped(dropped, best, named)
            waiting = []
            if named:  # they may have hidden how friction turns
                fit = with_own_values_again(softened_again(with_delay(fit) if kept else fit))
                softer, known = softer | gains_of(fit), len(fit.effects) - len(named)
        if named:
            fit, named = _among_rivals(fit, named, known)
            fit = with_own_values_again(fit)
            hard = hardened(fit, softer)
            if hard is not fit:
                known -= len(softer)
                softer = {}
                fit, named = _kept(hard, named, known)
        fit, limits = sharpened(with_delay(fit) if named else fit, limits)
    except KeyboardInterrupt:
        partial = True
    return Searched(before, fit, softer, tuple(named), left, tried, partial, tuple(waiting), limits)


def _with(
    best: list[Named], fit: TrajectoryFit, named: list[Named], known: int, tell: Callable[[float], None] | None
) -> tuple[TrajectoryFit, list[Named]]:
    """Return a fit and its effects with further ones, as far as they stay; as they are where the motion runs away."""
    try:
        return _kept(grown(fit, [item.effect for item in best], tell), [*named, *best], known, tell)
    except DataError:
        return fit, named


def _among_rivals(fit: TrajectoryFit, named: list[Named], known: int) -> tuple[TrajectoryFit, list[Named]]:
    """Return a whole fit, its effects in the forms that do best, and with what does as well."""
    # what a first effect left while its shape was on its way is none of its own
    whole, stay = _kept(again(fit, fit.unknowns, fit.z, cycles=CYCLES), named, known)
    # a shape that recordings hardly agree on may wander off on the way: the motion is farther without the effect then
    lost = len(fit.alone) > 1 and len(stay) < len(named) and nearer_by(fit, whole) > CLEARLY
    fit, named = (fit, named) if lost else (whole, stay)
    if len(named) > 1:  # the form of one may have been told beside what another one left
        fit, named = in_best_forms(fit, named, _pairs(named), known)
    fit, named, swapped = with_rivals(fit, named, known)
    return _kept(again(fit, fit.unknowns, fit.z, cycles=CYCLES), named, known) if swapped else (fit, named)


def _dropped(
    before: frozenset[tuple[str, int]], best: Sequence[Named], named: Sequence[Named]
) -> frozenset[tuple[str, int]]:
    """Return the effects and joints that were tried in vain, as long as nothing else was taken at the joint."""
    kept, tried = _pairs(named), _pairs(best)
    changed = {joint for _, joint in tried & kept}
    return frozenset(pair for pair in before | (tried - kept) if pair[1] not in changed)


def _pairs(found: Sequence[Named]) -> set[tuple[str, int]]:
    return {(item.effect.name, item.effect.joint) for item in found}


def _best(
    fit: TrajectoryFit,
    kinds: Sequence[type[Effect]],
    tell: Callable[[str, float], None] | None = None,
    dropped: frozenset[tuple[str, int]] = frozenset(),
) -> tuple[list[Named], tuple[Candidate, ...], int]:
    """Return the effects to take, one at most per joint, the best that was not taken elsewhere, and how many tried."""
    names = fit.unknowns.robot.joint_names
    if tell is not None:
        tell("simulating", 0.0)
    views = views_of(fit)
    measured = measured_views(fit, views)
    found, left, tried = list[Named](), list[Candidate](), 0
    for joint, name in enumerate(names):
        if tell is not None:
            tell(f"{len(kinds)} effects at {name} ({joint + 1} of {len(names)})", joint / len(names))
        unknown = own_unknowns(fit.unknowns, joint)
        further = any(effect.joint == joint and not effect.softens for effect in fit.unknowns.effects)
        near = further or joint in fit.unknowns.soft
        # with an effect that was taken the motion is near
        seen = views, measured if not near and is_clean(views, measured, joint) else ()
        candidates = best_of(
            *(screened(seen_by(of, unknown, joint), joint, kinds, fit.effects) if of else [] for of in seen)
        )
        tried += len(candidates)
        in_vain = [c for c in candidates if (c.effect.name, joint) in dropped]
        candidates = [c for c in candidates if all(c is not other for other in in_vain)]
        if not candidates:
            left += in_vain[:1]
            continue
        hopeful = [c for c in candidates if _is_hopeful(c, further=further)]
        top = (hopeful or candidates)[0].gain
        best = min((c for c in hopeful or candidates if c.gain >= ALIKE * top), key=lambda c: (c.price, -c.gain))
        if not hopeful:
            left.append(best)
            continue
        rivals = [c for c in (*candidates, *best.forms) if c is not best and c.gain >= ALIKE * top]
        found.append(Named(best.effect, best.gain, best.helped, tuple(rivals), best.forms))
    return found, tuple(left), tried


def _is_hopeful(candidate: Candidate, *, further: bool) -> bool:
    """Whether screening promises enough of an effect at a joint, that has one already where it is a `further` one."""
    effect = candidate.effect
    # screening knows nothing of a joint that sticks, where such a friction acts most: it is tried for less
    stuck = type(effect).holds() and not further
    least = STUCK if stuck else max(FURTHER if further else LEAST, effect.least_gain)
    return candidate.gain >= least and candidate.helped >= HOPEFUL


def _kept(
    fit: TrajectoryFit, named: list[Named], declared: int, tell: Callable[[float], None] | None = None
) -> tuple[TrajectoryFit, list[Named]]:
    """Drop effects without which the motion is predicted as well, or whose values no robot has; fit again."""
    while named:
        views = views_of(fit)
        judged = [_judged(fit, views, declared + k, item) for k, item in enumerate(named)]
        weak = [
            k for k, item in enumerate(judged)
            if not _stays(fit, declared + k, item) or left_by_main(item, judged)
        ]  # fmt: skip
        if not weak:
            return fit, judged
        joints = {judged[k].effect.joint for k in weak}
        # the worst of each joint: what is left beside it may be better without it
        worst = {min((k for k in weak if judged[k].effect.joint == j), key=lambda k: judged[k].gain) for j in joints}
        turned = {k: judged[k].forms[0] for k in worst if judged[k].forms and not _possible(fit, declared + k)}
        other = in_place(fit, {declared + k: form.effect for k, form in turned.items()}) if turned else None
        if other is not None:
            fit = other
            named = [_turned(item, turned[k]) if k in turned else item for k, item in enumerate(judged)]
            continue
        fit = without(fit, {declared + k for k in worst}, tell)
        named = [item for k, item in enumerate(judged) if k not in worst]
    return fit, named


def left_by_main(item: Named, all_named: Sequence[Named]) -> bool:
    """Return whether an effect beside its joint's main one may be what that one's imperfect shape leaves.

    It helps some blocks and harms others, then: one of its own helps every block.
    """
    main = max((other for other in all_named if other.effect.joint == item.effect.joint), key=lambda o: o.gain)
    return main is not item and item.helped < 1


def _turned(item: Named, form: Candidate) -> Named:
    """Return an effect in another form, with those that are left."""
    alike = [c for c in item.forms[1:] if c.gain >= ALIKE * form.gain and all(c is not r for r in item.rivals)]
    rivals = (*(c for c in item.rivals if c is not form), *alike)
    return Named(form.effect, form.gain, form.helped, rivals, item.forms[1:])


def _possible(fit: TrajectoryFit, place: int) -> bool:
    """Whether the values of an effect are some that a robot may have."""
    from elid_cli.estimation.trajectory.found_effects import scene_of_fit

    effect, scene = fit.effects[place], scene_of_fit(fit)
    values = effect.named(scene, fit.z[fit.unknowns.amplitudes_of(place)])
    return type(effect).plausible(scene, effect.joint, values)


def _clear_of_nothing(fit: TrajectoryFit, place: int) -> bool:
    """Whether an amplitude that the motion shows is clear of 0 by its errors: what may be nothing is not named.

    Of several recordings it is enough in one: the effect may have come or gone between them.
    """
    own, recordings = fit.unknowns.amplitudes_of(place), len(fit.alone)
    shown = np.diag(fit.equations.matrix.sum(axis=0))[own] > 0
    error = fit.deviation if recordings == 1 else fit.within * np.sqrt(recordings / len(fit.spans))
    return bool((np.abs(fit.alone) > SURE * error)[:, own][:, shown].any())


def _stays(fit: TrajectoryFit, place: int, item: Named) -> bool:
    if not _possible(fit, place) or not _clear_of_nothing(fit, place):
        return False
    if len(fit.alone) > 1 and (not has_one_sign(fit, place) or common_gain(fit, place) < LEAST):
        return False
    return item.gain >= max(LEAST, item.effect.least_gain) and item.helped >= HELPED


def _judged(fit: TrajectoryFit, views: Sequence[View], place: int, item: Named) -> Named:
    """Return an effect with what it takes from blocks that it was not fitted to, beside all the others."""
    joint = item.effect.joint
    unknown = own_unknowns(fit.unknowns, joint)
    part = fit.unknowns.amplitudes_of(place)
    z = fit.z[part]
    shapes, _ = fit.unknowns.shapes_of(place)
    of_effect = ((unknown >= part.start) & (unknown < part.stop)) | np.isin(unknown, shapes)
    left = []
    for own in recordings_of(views):
        columns = np.concatenate([view.columns[:, joint, unknown] for view in own])
        # the error that would be there without it
        bare = np.concatenate([view.error[:, joint] - view.columns[:, joint, part] @ z for view in own])
        blocks = Blocks.of(columns, bare, edges_of(own))
        left.append((blocks.left(~of_effect), blocks.left()))
    share, helped = gain(*np.concatenate(left, axis=1))
    return replace(item, effect=fit.effects[place], gain=share, helped=helped)
