"""The search: forward steps with re-fit of everything, ambiguity kept as a set, backward pruning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli._types import Progress
from elid_cli.diagnosis.fit.state import Log, State, fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import FLOOR_RATIO, improves, predicted_better, touched, worthwhile
from elid_cli.diagnosis.search.encoder_skew import Skew, looked_again, visible_skew
from elid_cli.diagnosis.search.screening import Candidate, score, screen, sensible
from elid_cli.estimation.regression.effect_shapes import fit_declared
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.model.effects import effect_classes, effect_that, twins_of
from elid_cli.model.effects.declared import Declared
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.robot import EffectSpec

NET = 12.0
"""Net log-likelihood an effect must gain."""
NET_AT_FLOOR = 60.0
"""The same when no row is above its floor: noise that enters columns imitates effects by up to 45."""
NEAR = 10.0
"""Effects whose net gain is this near to the best cannot be told apart from it …"""
NEAR_SHARE = 0.01
"""… or whose gain differs by this part: then the form of the curve decides, which a log can only hint at."""
TWIN_SHARE = 0.7
"""Part of the best gain from which a declared twin is named as possible, too."""
KEPT = 0.03
"""Part of the left-out error that an effect must take away to be kept whatever its likelihood."""
PASSED = 0.6
"""Part of the cut-off up to which frequencies are named."""
STEPS = 14
"""Most candidates that are fitted in full …"""
REFUSALS = 8
"""… and most that may turn out not to be worth their parameters."""
EVEN = 0.5
"""Difference in log-likelihood that says nothing."""
POSSIBLE = 6
"""Supported candidates that are fitted where the present model has impossible parameters."""
APART = 0.02
"""Part by which errors left out must differ for the torques to decide between a skew and friction."""
LOOKS, SETTLED = 4, 0.02
"""Times that a skew seen in the positions is looked at, and part of a sample within which it counts as settled."""
PAIR_GAIN = 0.1
"""Least part of the left-out motor row's error that both together must take away, also from either alone."""


@dataclass(frozen=True)
class Step:
    """One accepted effect and what could not be told apart from it."""

    candidate: Candidate
    rivals: tuple[Candidate, ...]
    together: float | None = None
    """Net gain of effects that were accepted together; None: the candidate's own."""
    quarters: tuple[float, ...] = ()
    """What it takes from the squared error of each quarter of the log, predicted from the others; NaN: cannot tell."""

    @property
    def net(self) -> float:
        """Net gain in log-likelihood."""
        return self.candidate.net if self.together is None else self.together


@dataclass(frozen=True)
class Term:
    """What the collocation says of one term of a friction curve."""

    gain: float
    """Part of what the held-out stretches show beyond noise that the curve's further terms take away."""
    net: float
    """Gain in log-likelihood on the held-out stretches."""


@dataclass(frozen=True)
class Found:
    """Outcome of a search."""

    before: State
    after: State
    steps: tuple[Step, ...]
    remaining: tuple[Candidate, ...]
    """Best candidates that were not accepted, best first."""
    tried: int
    skews: tuple[Skew, ...] = ()
    """Skews between encoders that the positions show and the torques cannot."""
    terms: Mapping[int, Term] = field(default_factory=dict)
    """By number of the effect: terms of curves that the collocation told."""
    kept: int = 0
    """How many effects after the declared ones stay in the model without being named."""
    partial: bool = False
    """Whether Ctrl-C ended it."""


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
    state, seen = _seen_in_positions(before, library)
    state, seen = _against_friction(before, state, seen, library)
    state, steps = _measurement_first(state, library)
    remaining: list[Candidate] = []
    tried, partial = 0, False
    refused: set[tuple[str, int]] = set()
    try:
        for number in range(STEPS):
            candidates = screen(state, library, progress, f"search {number + 1}", jobs)
            tried = max(tried, len(candidates))
            chosen = _choose(state, [c for c in candidates if c.key not in refused])
            remaining = candidates
            if chosen is None:
                break
            grown = refreshed(fit(state.log, (*state.effects, chosen.candidate.effect), state.scene))
            if not worthwhile(state, grown, chosen.candidate):
                refused.add(chosen.candidate.key)
                if len(refused) > REFUSALS:
                    break
                continue
            state, steps = grown, [*steps, chosen]
    except KeyboardInterrupt:  # whoever waits no longer gets what is found so far
        partial = True
    if not partial:
        state, steps = _pruned(state, steps, len(declared))
        state = _polished(state, len(declared))
    return Found(before, state, tuple(steps), tuple(remaining[:5]), tried, seen, partial=partial)


def at_floor(state: State) -> bool:
    """Whether no row is above its noise floor."""
    return max(state.ratios().values()) < FLOOR_RATIO


def _choose(state: State, candidates: Sequence[Candidate]) -> Step | None:
    """Return the best supported candidate with its rivals, or None when nothing deserves a name."""
    threshold = NET_AT_FLOOR if at_floor(state) else NET
    able = [c for c in candidates if c.supported and c.net > threshold and _within(state, c)]
    if not able:
        return None
    most = max(able, key=lambda c: c.gain.whole)
    share = most.gain.likelihood / most.gain.whole if most.gain.whole > 0 else 1.0
    able.sort(key=lambda c: -c.merit(share))
    highest = able[0].merit(share)
    near = [c for c in able if c.merit(share) > highest - max(NEAR, NEAR_SHARE * highest)]
    # among equals the one with the fewest parameters: the others hold it as a special case, or fit its noise
    fewest = min((c.size, c.gain.width) for c in near)
    simplest = [c for c in near if (c.size, c.gain.width) == fewest]
    # of twins that differ by less than chance a joint's own effect goes before the whole robot's
    top = max(c.merit(share) for c in simplest)
    best = min(simplest, key=lambda c: (c.merit(share) <= top - EVEN, c.effect.whole_robot, -c.merit(share)))
    twins = [c for c in able if c not in near and _twins(best, c) and c.merit(share) > TWIN_SHARE * highest]
    step = Step(best, tuple(c for c in (*near, *twins) if c is not best))
    return _possible(state, step, candidates) if state.impossible else step


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


def _twins(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are declared to imitate each other at this place."""
    kinds = type(one.effect), type(other.effect)
    named = kinds[1].name in twins_of(kinds[0])
    return named and (one.effect.joint == other.effect.joint or any(kind.whole_robot for kind in kinds))


def _within(state: State, candidate: Candidate) -> bool:
    """Whether a frequency lies clear of the filter's edge, where the filter itself makes a resonance."""
    frequency = candidate.values.get("frequency")
    return frequency is None or frequency < PASSED * state.log.signals.filter.cutoff


def _measurement_first(state: State, library: Mapping[str, type[Effect]]) -> tuple[State, list[Step]]:
    """Accept skew and offset between a joint's two encoders where they help together.

    They imitate physics, and each hides behind the other: the deflection of a stiff joint is so small that either
    of them alone falsifies the stiffness, so neither alone would improve the fit.
    """
    steps: list[Step] = []
    kinds = _between_encoders()
    if any(kind.name not in library for kind in kinds):
        return state, steps
    for joint in range(state.log.model.robot.n):
        if not all(kind.applies(state.log.model.robot, joint) for kind in kinds):
            continue
        present = {(e.name, e.joint) for e in state.effects}
        if any((kind.name, joint) in present for kind in kinds):
            continue
        # where the positions have shown the skew, what hides behind it can still be the offset
        moved = state.log.shifts.of("link", joint) != 0.0
        trial = _pair(state, joint, [kind for kind in kinds if not (moved and kind.corrects == "link")])
        if trial is not None:
            state, found = trial
            steps += found
    return state, steps


def _between_encoders() -> list[type[Effect]]:
    """Return the faults between a joint's two encoders, those that move a channel first."""
    found = [kind for kind in effect_classes().values() if kind.in_deflection]
    return sorted(found, key=lambda kind: kind.corrects is None)


def _seen_in_positions(state: State, library: Mapping[str, type[Effect]]) -> tuple[State, tuple[Skew, ...]]:
    """Move the link channels of joints whose skew only the positions show."""
    if effect_that(corrects="link").name not in library:
        return state, ()
    present = {e.joint for e in state.effects if e.corrects == "link"}
    seen = [visible_skew(state, k) for k in range(state.log.model.robot.n) if k not in present]
    skews = tuple(s for s in seen if s is not None)
    if not skews:
        return state, ()
    before = state.log.shifts
    for _ in range(LOOKS):
        shifts = before
        for item in skews:
            shifts = shifts.moved("link", item.joint, before.of("link", item.joint) + item.skew)
        state = refreshed(fit(state.log.shifted(shifts), state.effects, state.scene))
        again = tuple(looked_again(state, item) for item in skews)
        change = max(abs(now.skew - then.skew) for now, then in zip(again, skews, strict=True))
        if change < SETTLED * state.log.signals.dt:
            break
        skews = again
    return state, skews


def _against_friction(
    before: State, skewed: State, seen: tuple[Skew, ...], library: Mapping[str, type[Effect]]
) -> tuple[State, tuple[Skew, ...]]:
    """Let the torques decide between a skew seen in the positions and what also follows the speed, or name both.

    Losses on the link's side and in the transmission bend a spring with the speed, as a skew seems to.
    """
    kept = []
    for item in seen:
        rows = [row for row in before.triangles.rows if row.joint == item.joint]
        unit = {row: before.rms(row) ** -2 for row in rows if before.rms(row) > 0}

        def left(state: State, unit: Mapping[EstimationRow, float] = unit) -> float:
            return sum(weight * float(state.left_out[row].sum()) for row, weight in unit.items())

        least, rivals = left(skewed), []
        for name in twins_of(effect_that(corrects="link")):
            kind = library.get(name)
            if kind is None or not kind.applies(before.log.model.robot, item.joint):
                continue
            other = refreshed(fit(before.log, (*before.effects, kind(item.joint)), before.scene))
            values = other.named(len(other.effects) - 1)
            explains = visible_skew(other, item.joint) is None  # with its torque the positions show none
            if explains and sensible(other.effects[-1], other.scene, values):
                rivals.append((left(other), name, values))
        if any(error < (1 - APART) * least for error, _, _ in rivals):
            continue
        as_good = tuple((name, values) for error, name, values in rivals if error < (1 + APART) * least)
        kept.append(replace(item, rivals=as_good))
    if len(kept) == len(seen):
        return skewed, tuple(kept)
    shifts = before.log.shifts
    for item in kept:
        shifts = shifts.moved("link", item.joint, before.log.shifts.of("link", item.joint) + item.skew)
    state = refreshed(fit(before.log.shifted(shifts), before.effects, before.scene)) if kept else before
    return state, tuple(kept)


def _pair(state: State, joint: int, kinds: Sequence[type[Effect]]) -> tuple[State, list[Step]] | None:
    candidates = [score(state, kind(joint), 1, len(_between_encoders())) for kind in kinds]
    scored = [c for c in candidates if c is not None]
    if len(scored) < len(kinds):
        return None
    grown = refreshed(fit(state.log, (*state.effects, *(c.effect for c in scored)), state.scene))
    first = len(grown.effects) - len(scored)
    if not all(sensible(grown.effects[first + k], grown.scene, grown.named(first + k)) for k in range(len(scored))):
        return None
    rows = [state.log.observation.spring_row(joint)]
    gain = predicted_better(state, grown, rows)
    if gain is None or gain < PAIR_GAIN or not improves(state, grown, rows[0]):
        return None
    for candidate in scored if len(scored) > 1 else []:
        single = refreshed(fit(state.log, (*state.effects, candidate.effect), state.scene))
        if (predicted_better(single, grown, rows) or 0.0) < PAIR_GAIN:
            return None
    net = 0.5 * state.projected.count / len(state.projected.places) * float(np.log(1.0 / max(1.0 - gain, 1e-6)))
    return grown, [Step(c, (), net) for c in scored]


def _pruned(state: State, steps: list[Step], declared: int) -> tuple[State, list[Step]]:
    """Drop accepted effects that the others made unnecessary, the least needed first."""
    while len(steps) > 1:
        losses = []
        for k in range(len(steps)):
            lacking = without(state, declared + k)
            again = score(lacking, state.effects[declared + k], steps[k].candidate.shapes, 1)
            gain = predicted_better(lacking, state, touched(lacking, state, state.columns[declared + k].rows)) or 0.0
            losses.append(np.inf if gain > KEPT or again is None else again.net)
        worst = int(np.argmin(losses))
        if losses[worst] > NET:
            break
        state = refreshed(without(state, declared + worst))
        gone = steps[worst].candidate
        steps = [beside(s, gone) for i, s in enumerate(steps) if i != worst]
    return state, steps


def beside(step: Step, gone: Candidate) -> Step:
    """Return a step with an effect that was dropped for it as a rival, where the two imitate each other."""
    known = gone.key in [c.key for c in step.rivals]
    return step if known or not _twins(step.candidate, gone) else replace(step, rivals=(*step.rivals, gone))


def _polished(state: State, declared: int) -> State:
    """Refine the shapes of all found effects together, and fit once more."""
    if not any(e.shape for e in state.effects):
        return state
    items = [Declared(EffectSpec(e.name, None), e) for e in state.effects]
    others: Sequence[ExtraColumns] = state.nuisances
    fitted = fit_declared(state.log.training, state.log.signals, state.scene, items, state.solution.weights, others)
    effects = [item.effect for item in fitted.effects]
    polished = refreshed(fit(state.log, effects, state.scene))
    better = sum(polished.rms(r) / state.rms(r) for r in state.triangles.rows) < len(state.triangles.rows) + 1e-9
    kept = range(declared, len(effects))
    possible = all(sensible(polished.effects[k], polished.scene, polished.named(k)) for k in kept)
    return polished if better and possible else state
