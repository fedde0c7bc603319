"""Zeros of encoders that are off by so much that no small step leads to them: a quarter of a turn, or half of one.

The search adds what a column of the present model explains best. Of a zero far off, model and column are wrong in every
pose, and what looks best is something else, or nothing. So where rows are left that nothing explains, other zeros are
tried from the model before, each joint's around the whole circle (`other_zeros`). One is taken as a first step where it
is worth its parameter as any effect has to be, and where with it the search leaves far less unexplained; or, where it
had found a zero that is far off itself, where stretches that are left out are predicted as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.residuals import rows_of
from elid_cli.diagnosis.search.acceptance import left_out_error, worthwhile
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.diagnosis.search.steps import Found, Step, best_step
from elid_cli.estimation.other_zeros import STARTS, misfit, valleys
from elid_cli.estimation.regression.nuisances import offset_columns
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.regression.triangles import ExtraColumns, to_triangles
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.posed import Pose
from elid_cli.model.regressor import Regressor

LEFT = 0.5
"""Part of what was unexplained, in times the noise of every row, that may stay so with a zero that is far off."""
FAR = 0.5
"""rad; zero from which that of a search may be the ground of a valley that is not the lowest: half a turn from the
right one, gravity only changes its sign, which first moments can take up."""
DEEP = 0.015
"""Mean logarithm by which residuals must fall in a valley, for it to be a zero's: for parked joints, or effects that
nothing explains, some turn of a joint is a little better, by up to half as much."""
ALIKE = 1e-3
"""Part by which the error of left-out folds may be larger where the same is found again, with what else it could be."""
MOST = 3
"""Most of such zeros in one log."""

Searching = Callable[[State, list[Step]], Found]
"""Goes on with a search from a state and the steps that led to it."""


def with_far_zeros(found: Found, library: Mapping[str, type[Effect]], again: Searching) -> Found:
    """Return the outcome of a search, or that of one which begins at other zeros, where this leaves far less.

    Parameters
    ----------
    found
        What the search found.
    library
        Effects to try.
    again
        The search from another beginning.
    """
    kind = effect_that(moves_zero=True)
    left, far = _unexplained(found.after), bool(np.any(np.abs(found.after.log.pose.zeros) > FAR))
    if found.partial or kind.name not in library or not (left or far):
        return found
    try:
        state, steps = _begun(found.before, kind)
    except KeyboardInterrupt:
        return replace(found, partial=True)
    if not steps:
        return found
    other = again(state, steps)
    better = _unexplained(other.after) < LEFT * left or (far and _nearer(other.after, found.after))
    return other if better else replace(found, partial=other.partial)


def _nearer(one: State, other: State) -> bool:
    """Whether a model with no more effects predicts folds that are left out as well as another, in the same units."""
    rows = [row for row in one.triangles.rows if row in other.triangles.rows]
    as_well = left_out_error(one, other, rows) < (1.0 + ALIKE) * left_out_error(other, other, rows)
    return as_well and len(one.effects) <= len(other.effects)


def _unexplained(state: State) -> float:
    """Return what is left beyond noise, in times the noise, of all rows that do not obey the model together."""
    return sum(row.ratio - 1.0 for row in rows_of(state) if row.high)


def _begun(state: State, kind: type[Effect]) -> tuple[State, list[Step]]:
    """Return the state with zeros that are far off, one after the other, and the steps to it."""
    steps = list[Step]()
    while len(steps) < MOST and _unexplained(state):
        more = _next(state, kind)
        if more is None:
            break
        state, steps = more[0], [*steps, more[1]]
    return state, steps


def _next(state: State, kind: type[Effect]) -> tuple[State, Step] | None:
    """Return the state with a joint's zero elsewhere as its last effect, and the step to it; None where none helps."""
    robot = state.log.model.robot
    present = {effect.joint for effect in state.effects if type(effect) is kind}
    joints = [
        k for k, joint in enumerate(robot.joints) if joint.revolute and kind.applies(robot, k) and k not in present
    ]

    def cost(joint: int, offset: float) -> float:
        return _misfit(state, state.log.pose.moved(kind(joint), np.array([offset])))

    here, least = _misfit(state, state.log.pose), DEEP * sum(t.count for t in state.triangles.items)
    able = list[tuple[Candidate, State]]()
    for valley in valleys(joints, here, cost):
        if here - valley.misfit < least:
            break
        effect = kind(valley.joint)
        log = state.log.posed(state.log.pose.moved(effect, np.array([valley.offset])))
        grown = refreshed(fit(log, (*state.effects, effect), but=state.but))
        candidate = _candidate(state, grown, len(joints))
        if candidate is not None and candidate.supported and candidate.net > 0 and worthwhile(state, grown, candidate):
            able.append((candidate, grown))
    if not able:
        return None
    best = {candidate.key: candidate for candidate, _ in sorted(able, key=lambda pair: pair[0].gain.whole)}
    step = best_step(list(best.values()))
    return next(grown for candidate, grown in able if candidate is step.candidate), step


def _misfit(state: State, pose: Pose) -> float:
    """Return how badly the training stretches are fitted in a pose, effects and channels' faults in their columns."""
    log = state.log
    training = observe(Regressor(pose.robot(log.level)), log.signals).only(log.fold >= 0)
    extras = (*state.columns, *offset_columns(training))
    return misfit(to_triangles(training, extras), log.base.count + sum(extra.width for extra in extras))


def _candidate(state: State, grown: State, joints: int) -> Candidate | None:
    """Return the last effect of a grown state as the search would have scored it: by the torque that it changes.

    That is the whole change of the model's torque with the turn, for the parameters after it, over the angle.
    """
    last = len(grown.effects) - 1
    effect, values = grown.effects[last], grown.named(last)
    (offset,) = values.values()
    rows = {}
    for turned, level in zip(grown.log.observation.groups, state.log.observation.groups, strict=True):
        change = grown.standard[turned.index] @ turned.columns - grown.standard[level.index] @ level.columns
        if np.any(change):
            rows[turned.row] = change[None] / offset
    columns = ExtraColumns(effect.name, rows, tuple(p.unit for p in effect.amplitudes))
    gain = state.projected.gain(rows)
    if gain is None:
        return None
    choice = float(np.log(STARTS * joints))
    return Candidate(effect, columns, gain, choice, values, sensible(effect, grown.scene, values), STARTS)
