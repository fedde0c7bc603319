"""The search: forward steps with re-fit of everything, ambiguity kept as a set, backward pruning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Progress
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import (
    FLOOR_RATIO,
    is_change,
    left_behind,
    predicted_better,
    touched,
    worthwhile,
)
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.encoder_skew import Skew
from elid_cli.diagnosis.search.encoders_first import (
    against_friction,
    by_torques,
    measurement_first,
    seen_again,
    seen_in_positions,
)
from elid_cli.diagnosis.search.event_times import timed
from elid_cli.diagnosis.search.far_zeros import with_far_zeros
from elid_cli.diagnosis.search.screening import best_of, score, sensible
from elid_cli.diagnosis.search.steps import NEAR, NEAR_SHARE, TWIN_SHARE, Found, Step, are_twins, best_step
from elid_cli.diagnosis.search.together import worth_together
from elid_cli.diagnosis.search.torque_limits import judged_by_fit
from elid_cli.estimation.regression.effect_shapes import fit_declared
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.model.effects.declared import Declared
from elid_cli.model.effects.effect import Effect
from elid_cli.robot.robot import EffectSpec

NET = 12.0
"""Net log-likelihood an effect must gain."""
NET_AT_FLOOR = 60.0
"""The same when no row is above its floor: noise that enters columns imitates effects by up to 45."""
KEPT = 0.03
"""Part of the left-out error that an effect must take away to be kept whatever its likelihood."""
PASSED = 0.6
"""Part of the cut-off up to which frequencies are named."""
STEPS = 14
"""Most candidates that are fitted in full …"""
REFUSALS = 8
"""… and most that may turn out not to be worth their parameters."""
AGAIN = 2.0
"""Growth of its net gain, after others were accepted, from which an effect that was not worth it is tried again."""
SMOOTHED = 0.1
"""Part of what channels explain that are moved in time by which equals may differ."""
REFINED = 2
"""Times that shapes are refined where effects have gone."""
POSSIBLE = 6
"""Supported candidates that are fitted where the present model has impossible parameters."""


def search(
    log: Log,
    declared: Sequence[Effect],
    library: Mapping[str, type[Effect]],
    progress: Progress | None = None,
    jobs: int = 1,
) -> Found:
    """Search a log for effects that the model lacks.

    Parameters
    ----------
    log
        The log, divided in training and held-out stretches.
    declared
        Effects that the robot file already declares.
    library
        Effects to try.
    progress
        Called with a label and the finished part.
    jobs
        Processes that try effects side by side.
    """
    before = refreshed(fit(log, declared))

    def onward(state: State, steps: Sequence[Step]) -> Found:
        first = len(state.effects) - len(steps)
        return _searched(state, steps, library, progress, jobs, before=before, declared=first)

    return with_far_zeros(onward(before, ()), library, onward)


def _searched(
    state: State, steps: Sequence[Step], library: Mapping[str, type[Effect]], progress: Progress | None, jobs: int,
    *, before: State, declared: int,
) -> Found:  # fmt: skip
    """Return what the search finds that goes on from a state and the steps that led to it."""
    begun = state
    state, seen = seen_in_positions(begun, library)
    state, seen = against_friction(begun, state, seen, library)
    state = by_torques(state, seen)
    state, more = measurement_first(state, library)
    steps = [*steps, *more]
    candidates, remaining = list[Candidate](), list[Candidate]()
    tried, refusals, partial = 0, 0, False
    refused: dict[tuple[str, int], float] = {}
    screened, missed = None, list[Step]()
    try:
        for number in range(STEPS):
            if state is not screened:  # one that was refused leaves all as it was
                candidates, count = best_of(state, library, progress, f"search {number + 1}", jobs)
                screened, tried = state, max(tried, count)
            chosen = _chosen(state, candidates, refused, lambda one: best_of(one, library, None, "", jobs)[0])
            remaining = candidates
            if chosen is None or refusals > REFUSALS:
                pair = worth_together(state, missed)
                if pair is None:
                    break
                (state, both), missed, refusals = pair, [], 0
                state, steps = by_torques(state, seen), [*steps, *both]
                continue
            grown = _grown(state, chosen.candidate, seen)
            if grown is None:
                refused[chosen.candidate.key], refusals = chosen.candidate.net, refusals + 1
                missed = [*missed, chosen]
                continue
            state, steps, missed = grown, [*steps, chosen], []
            if chosen.candidate.effect.corrects is not None:
                state, seen = seen_again(state, library, seen)
    except KeyboardInterrupt:  # whoever waits no longer gets what is found so far
        partial = True
    if not partial:
        state, steps = _pruned(state, steps, declared)
        state, steps = _refined_or_dropped(state, steps, declared)
    return Found(before, state, tuple(steps), tuple(remaining[:5]), tried, seen, partial=partial)


def _chosen(
    state: State,
    candidates: Sequence[Candidate],
    refused: Mapping[tuple[str, int], float],
    screen: Callable[[State], Sequence[Candidate]],
) -> Step | None:
    """Return what is tried next, of candidates or, where none deserves a name, of those beside offsets; None: none."""

    def left(found: Sequence[Candidate]) -> list[Candidate]:
        return [c for c in found if c.net > AGAIN * refused.get(c.key, -np.inf)]

    chosen = _choose(state, left(candidates))
    if chosen is not None or at_floor(state):
        return chosen
    beside = state.with_free_offsets()
    return None if beside is state else _choose(beside, left(screen(beside)))


def _grown(state: State, candidate: Candidate, seen: Sequence[Skew]) -> State | None:
    """Return the model with a candidate, skews put right by it; None where it is not worth its parameters.

    It must be so before the skews are put right, too: that moves them by a tenth of a sample at most, and fits each of
    them many times where the candidate and the model have to agree.
    """
    grown = fit(state.log, (*state.effects, candidate.effect), state.scene)
    for number in range(len(grown.effects)):  # what an effect explains may have moved the instants of others
        grown = timed(grown, number)
    grown = refreshed(grown)
    if not worthwhile(state, grown, candidate):
        return None
    if not seen:
        return grown
    grown = by_torques(grown, seen)
    return grown if worthwhile(state, grown, candidate) else None


def at_floor(state: State) -> bool:
    """Whether no row is above its noise floor."""
    return max(state.ratios().values()) < FLOOR_RATIO


def _choose(state: State, candidates: Sequence[Candidate]) -> Step | None:
    """Return the best supported candidate with its rivals, or None when nothing deserves a name."""
    threshold = NET_AT_FLOOR if at_floor(state) else NET
    present = {(effect.name, effect.joint) for effect in state.effects}
    # of a late channel the columns hold to first order only: its fit tells whether folds support it
    told = judged_by_fit(state, candidates)
    able = [c for c in told if (c.supported or (c.plausible and c.effect.corrects is not None))
            and c.net > threshold and _within(state, c)
            and all((name, c.effect.joint) in present for name in c.effect.comes_with)]  # fmt: skip
    if not able:
        return None
    step = best_step(able)
    if state.impossible:
        return _possible(state, step, candidates)
    return _in_time(state, step, able) if step.candidate.effect.corrects is not None else step


def _in_time(state: State, step: Step, able: Sequence[Candidate]) -> Step:
    """Return the step of the late channel that explains most, as fits with the channels moved tell.

    To first order, one channel that is late is part of another; and with the torques late as well, the one joint of two
    is read late where the other one is read early. Of equals the one counts that leaves the torques least late.
    """
    tried = [step.candidate, *(c for c in able if c.effect.corrects is not None and c is not step.candidate)]
    grown = [refreshed(fit(state.log, (*state.effects, c.effect), state.scene)) for c in tried[:POSSIBLE]]
    behind = [left_behind(state, other) for other in grown]
    # channels that are moved are smoothed by it: equals differ by some per cent of what they explain
    most = min(behind)
    near = [k for k, value in enumerate(behind) if value < most + max(NEAR, SMOOTHED * -most)]
    best = tried[min(near, key=lambda k: sum(map(abs, grown[k].delays.values())))]
    others = [c for c in (step.candidate, *step.rivals, *(tried[k] for k in near)) if c is not best]
    return Step(best, tuple({c.key: c for c in others}.values()))


def _possible(state: State, step: Step, candidates: Sequence[Candidate]) -> Step:
    """Return the step, or where parameters are impossible the supported candidate that makes most of them possible.

    A curve that imitates a friction may follow a torque better and leave a stiffness below 0; the friction mends it.
    With such parameters the screening weighs rows wrongly: what the candidates are worth is told by fits.
    """
    able = sorted((c for c in candidates if c.supported and c.net > 0), key=lambda c: -c.gain.whole)
    tried = [step.candidate, *(c for c in able[:POSSIBLE] if c is not step.candidate)]
    worth = []
    for candidate in tried:
        grown = fit(state.log, (*state.effects, candidate.effect), state.scene)
        better = predicted_better(state, grown, touched(state, grown, candidate.columns.rows))
        worth.append((-len(grown.impossible), better or 0.0))
    best = tried[max(range(len(tried)), key=worth.__getitem__)]
    if best is step.candidate:
        return step
    return Step(best, tuple(c for c in (step.candidate, *step.rivals) if c is not best))


def _within(state: State, candidate: Candidate) -> bool:
    """Whether a frequency lies clear of the filter's edge, where the filter itself makes a resonance."""
    frequency = candidate.values.get("frequency")
    return frequency is None or frequency < PASSED * state.log.signals.filter.cutoff


def _pruned(state: State, steps: list[Step], declared: int) -> tuple[State, list[Step]]:
    """Drop accepted effects that the others made unnecessary, the least needed first."""
    while len(steps) > 1:
        losses = []
        for k in range(len(steps)):
            lacking = without(state, declared + k)
            effect = state.effects[declared + k]
            again = score(lacking, effect, steps[k].candidate.shapes, 1)
            rows, change = touched(lacking, state, state.columns[declared + k].rows), is_change(effect)
            gain = predicted_better(lacking, state, rows, change=change) or 0.0
            losses.append(np.inf if gain > KEPT or again is None else again.net)
        worst = int(np.argmin(losses))
        if losses[worst] > NET:
            break
        state = refreshed(without(state, declared + worst))
        gone = steps[worst].candidate
        steps = [s if outdone(gone, s, later=i > worst) else beside(s, gone) for i, s in enumerate(steps) if i != worst]
    return state, steps


def outdone(gone: Candidate, step: Step, *, later: bool) -> bool:
    """Whether a step that came after an effect explained so much on top that the two are no rivals (`TWIN_SHARE`)."""
    own = gone.gain.likelihood
    return later and own < TWIN_SHARE * (own + step.candidate.gain.likelihood)


def beside(step: Step, gone: Candidate) -> Step:
    """Return a step with an effect that was dropped for it as a rival, where the two imitate each other."""
    known = gone.key in [c.key for c in step.rivals]
    return step if known or not are_twins(step.candidate, gone) else replace(step, rivals=(*step.rivals, gone))


def with_refined_shapes(state: State, declared: int) -> State:
    """Refine the shapes of all found effects together, and fit once more."""
    refined = _refined_together(state)
    return refined if _is_better(refined, state) and not _impossible(refined, declared) else state


def _refined_or_dropped(state: State, steps: list[Step], declared: int) -> tuple[State, list[Step]]:
    """Return the state with the shapes of all found effects refined together, and the steps that are left.

    An effect that stood in for what the rough shape of another one left has no possible values beside the refined one,
    or nearly its shape: it goes, where the rest explains as much without it.
    """
    refined = _refined_together(state)
    impossible = _impossible(refined, declared)
    gone = impossible or _alike(refined, state, declared)
    if gone and len(gone) < len(steps):
        fewer = state
        for k in reversed(gone):
            fewer = refreshed(without(fewer, k))
        for _ in range(REFINED):  # what has gone had bent the others' shapes
            fewer = with_refined_shapes(fewer, declared)
        if _is_better(fewer, state) or (not impossible and _as_near(fewer, refined, declared)):
            left = [step for k, step in enumerate(steps, start=declared) if k not in gone]
            return _pruned(fewer, left, declared)
    return (refined if not impossible and _is_better(refined, state) else state), steps


def _as_near(fewer: State, refined: State, declared: int) -> bool:
    """Whether a state explains what another with more effects does, but for a small part of what those are worth."""
    nothing = fit(refined.log, refined.effects[:declared], refined.scene, but=refined.but)
    return left_behind(refined, fewer) < max(NEAR, NEAR_SHARE * left_behind(refined, nothing))


def _place(effect: Effect) -> tuple[str, int]:
    return effect.name, effect.joint


def _alike(refined: State, rough: State, declared: int) -> list[int]:
    """Return the numbers of found effects whose refined shapes are not told apart from a stronger one's of their kind.

    How strong they are is asked before: two of nearly one shape may both be large and cancel.
    """
    kept, gone = list[int](), list[int]()
    found = range(declared, len(refined.effects))
    for k in sorted(found, key=lambda k: -float(np.linalg.norm(rough.coefficients(k)))):
        one = refined.effects[k]
        present = [refined.effects[i].shape for i in kept if _place(refined.effects[i]) == _place(one)]
        distinct = not present or type(one).distinct(refined.scene, one.joint, one.shape, present)
        (kept if distinct else gone).append(k)
    return sorted(gone)


def _refined_together(state: State) -> State:
    if not any(e.shape for e in state.effects):
        return state
    items = [Declared(EffectSpec(e.name, None), e) for e in state.effects]
    others: Sequence[ExtraColumns] = state.nuisances
    fitted = fit_declared(state.log.training, state.log.signals, state.scene, items, state.solution.weights, others)
    return refreshed(fit(state.log, [item.effect for item in fitted.effects], state.scene))


def _is_better(refined: State, state: State) -> bool:
    """Whether a state leaves no more than another one, joint by joint on the whole."""
    rows = state.triangles.rows
    return sum(refined.rms(r) / state.rms(r) for r in rows) < len(rows) + 1e-9


def _impossible(state: State, declared: int) -> list[int]:
    """Return the numbers of the found effects whose values no robot has."""
    found = range(declared, len(state.effects))
    return [k for k in found if not sensible(state.effects[k], state.scene, state.named(k))]
