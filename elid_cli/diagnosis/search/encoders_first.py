"""Faults between the encoders of a joint, which come before any physics: skews, offsets, scales, eccentricities."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.acceptance import improves, left_out_error, predicted_better
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.encoder_skew import Skew, looked_again, visible_skew
from elid_cli.diagnosis.search.screening import score, sensible
from elid_cli.diagnosis.search.steps import Step
from elid_cli.model.effects import effect_classes, effect_that, twins_of
from elid_cli.model.effects.effect import Effect

APART = 0.02
"""Part by which errors left out must differ for the torques to decide between a skew and friction."""
LOOKS, SETTLED = 4, 0.02
"""Times that a skew seen in the positions is looked at, and part of a sample within which it counts as settled."""
LAST = 0.1
"""Part of a sample up to which the torques may put right a skew that the positions show."""
PAIR_GAIN = 0.1
"""Least part of the left-out motor row's error that both together must take away, also from either alone."""
MUCH = 0.5
"""Error left out over that of a simpler form below which another one is taken: what more amplitudes take of noise is
less."""
SCALE_GAIN = 0.99
"""Least part of it that a wrong scale takes away: the load follows the position, too, and springs bend by it."""


def measurement_first(state: State, library: Mapping[str, type[Effect]]) -> tuple[State, list[Step]]:
    """Accept skew and offset between a joint's two encoders where they help together, or what follows the position.

    They imitate physics, and each hides behind the other: the deflection of a stiff joint is so small that either
    of them alone falsifies the stiffness, so neither alone would improve the fit. Of a wrong scale an offset takes a
    part where the joint's mean position is not 0, and comes with it where its zero is another one.
    """
    steps: list[Step] = []
    kinds = _between_encoders()
    for joint in range(state.log.model.robot.n):
        # where the positions have shown the skew, what hides behind it can still be the offset
        moved = state.log.shifts.of("link", joint) != 0.0
        pair = [k for k in kinds if k.in_deflection in ("velocity", "constant")]
        trial = _bent(state, joint, [k for k in kinds if _is_free(state, k, joint, library)], library)
        if trial is None and all(_is_free(state, k, joint, library) for k in pair):
            trial = _pair(state, joint, [k for k in pair if not (moved and k.corrects == "link")])
        if trial is not None:
            state, found = trial
            steps += found
    return state, steps


def _is_free(state: State, kind: type[Effect], joint: int, library: Mapping[str, type[Effect]]) -> bool:
    """Whether a fault may be looked for at a joint, which does not have it yet."""
    there = any(isinstance(effect, kind) and effect.joint == joint for effect in state.effects)
    return kind.name in library and kind.applies(state.log.model.robot, joint) and not there


def _between_encoders() -> list[type[Effect]]:
    """Return the faults between a joint's two encoders, those that move a channel first."""
    found = [kind for kind in effect_classes().values() if kind.in_deflection]
    return sorted(found, key=lambda kind: kind.corrects is None)


def seen_in_positions(
    state: State, library: Mapping[str, type[Effect]], known: Collection[int] = ()
) -> tuple[State, tuple[Skew, ...]]:
    """Move the link channels of joints whose skew only the positions show, but not of those in `known`."""
    if effect_that(corrects="link").name not in library:
        return state, ()
    present = {e.joint for e in state.effects if e.corrects == "link"} | set(known)
    seen = [visible_skew(state, k) for k in range(state.log.model.robot.n) if k not in present]
    skews = tuple(s for s in seen if s is not None)
    if not skews:
        return state, ()
    before = state.log
    for _ in range(LOOKS):
        state = refreshed(fit(_moved(before, skews), state.effects, state.scene))
        again = tuple(looked_again(state, item) for item in skews)
        change = max(abs(now.skew - then.skew) for now, then in zip(again, skews, strict=True))
        if change < SETTLED * state.log.signals.dt:
            break
        skews = again
    return state, skews


def against_friction(
    before: State, skewed: State, seen: tuple[Skew, ...], library: Mapping[str, type[Effect]]
) -> tuple[State, tuple[Skew, ...]]:
    """Let the torques decide between a skew seen in the positions and what also follows the speed, or name both.

    Losses on the link's side and in the transmission bend a spring with the speed, as a skew seems to.
    """
    kept = []
    for item in seen:
        rows = [row for row in before.triangles.rows if row.joint == item.joint and before.rms(row) > 0]
        least, rivals = left_out_error(skewed, before, rows), []
        for name in twins_of(effect_that(corrects="link")):
            kind = library.get(name)
            if kind is None or not kind.applies(before.log.model.robot, item.joint):
                continue
            other = refreshed(fit(before.log, (*before.effects, kind(item.joint)), before.scene))
            values = other.named(len(other.effects) - 1)
            explains = visible_skew(other, item.joint) is None  # with its torque the positions show none
            possible = other.impossible <= skewed.impossible and sensible(other.effects[-1], other.scene, values)
            if explains and possible:
                rivals.append((left_out_error(other, before, rows), name, values))
        if any(error < (1 - APART) * least for error, _, _ in rivals):
            continue
        as_good = tuple((name, values) for error, name, values in rivals if error < (1 + APART) * least)
        kept.append(replace(item, rivals=as_good))
    if len(kept) == len(seen):
        return skewed, tuple(kept)
    state = refreshed(fit(_moved(before.log, kept), before.effects, before.scene)) if kept else before
    return state, tuple(kept)


def _moved(log: Log, skews: Sequence[Skew]) -> Log:
    """Return a log with link channels moved by skews that the positions show, beyond what they are moved already."""
    for item in skews:
        log = log.seen_late(item.joint, log.shifts.of("link", item.joint) + item.skew)
    return log


def seen_again(
    state: State, library: Mapping[str, type[Effect]], seen: tuple[Skew, ...]
) -> tuple[State, tuple[Skew, ...]]:
    """Move further link channels, whose skew the positions show now that another channel is where it belongs."""
    skewed, more = seen_in_positions(state, library, {item.joint for item in seen})
    if more:
        state, more = against_friction(state, skewed, more, library)
    return by_torques(state, more), (*seen, *more)


def by_torques(state: State, seen: Sequence[Skew]) -> State:
    """Return the state with skews that the positions show put right by the last part of a sample that the torques tell.

    What the positions leave of a skew is a torque along the speed on one side of the spring: friction of the link.
    """
    kind = effect_that(corrects="link")
    for item in seen:
        grown = refreshed(fit(state.log, (*state.effects, kind(item.joint)), state.scene, but=state.but))
        late = grown.named(len(grown.effects) - 1)[kind.amplitudes[0].name]
        change = abs(late - state.log.shifts.of("link", item.joint))
        rows = [row for row in state.triangles.rows if row.joint == item.joint]
        if change < LAST * state.log.signals.dt and predicted_better(state, grown, rows) is not None:
            state = refreshed(fit(state.log.seen_late(item.joint, late), state.effects, state.scene, but=state.but))
    return state


def _bent(
    state: State, joint: int, kinds: Sequence[type[Effect]], library: Mapping[str, type[Effect]]
) -> tuple[State, list[Step]] | None:
    """Return the state with what of a joint's deflection follows its position; None where nothing does.

    The one of the fewest amplitudes is taken that none predicts much better than; what predicts as well is its rival.
    """
    offset = [kind for kind in kinds if kind.in_deflection == "constant"]
    bends = [kind for kind in kinds if kind.in_deflection in ("position", "turn")] if offset else []
    trials = [_scaled(state, joint, kind, offset[0]) for kind in sorted(bends, key=lambda kind: len(kind.amplitudes))]
    found = [trial for trial in trials if trial is not None]
    if not found:
        return None
    rows = [state.log.observation.spring_row(joint)]
    errors = [left_out_error(grown, state, rows) for grown, _ in found]
    simple = next(k for k, error in enumerate(errors) if MUCH * error <= min(errors))
    grown, steps = found[simple]
    as_good = [k for k, error in enumerate(errors) if k != simple and error <= (1 + APART) * errors[simple]]
    first = type(steps[0].candidate.effect)
    twins = [kind for name in twins_of(first) if (kind := library.get(name)) and _is_free(state, kind, joint, library)]
    return _beside_twins(state, grown, steps, [found[k][1][0].candidate for k in as_good], twins)


def _beside_twins(
    state: State, grown: State, steps: list[Step], rivals: list[Candidate], twins: Sequence[type[Effect]]
) -> tuple[State, list[Step]] | None:
    """Return a state with twins that have shapes of their own as rivals, too; None where one of them does better."""
    first = steps[0].candidate.effect
    rows = [row for row in state.triangles.rows if row.joint == first.joint]
    least = left_out_error(grown, state, rows)
    for kind in twins:
        shapes = kind.grid(state.scene, first.joint)[:1] if kind.shapes else []
        for candidate in (score(state, kind(first.joint, shape), 1, 1) for shape in shapes):
            if candidate is None:
                continue
            effects = (*state.effects, candidate.effect, *(step.candidate.effect for step in steps[1:]))
            other = refreshed(fit(state.log, effects, state.scene))
            values, error = other.named(len(state.effects)), left_out_error(other, state, rows)
            if not sensible(candidate.effect, other.scene, values) or error > (1 + APART) * least:
                continue
            if error < (1 - APART) * least:
                return None
            rivals = [*rivals, replace(candidate, values=values)]
    return grown, [replace(steps[0], rivals=tuple(rivals)), *steps[1:]]


def _scaled(state: State, joint: int, scale: type[Effect], offset: type[Effect]) -> tuple[State, list[Step]] | None:
    """Return the state with a joint's wrong scale, with an offset where that is needed; None where it has none."""
    alone = _pair(state, joint, (scale,), SCALE_GAIN)
    both = _pair(state, joint, (scale, offset), SCALE_GAIN)
    if both is not None or alone is None:
        return both
    other = refreshed(fit(state.log, (*state.effects, offset(joint)), state.scene))
    rows = [state.log.observation.spring_row(joint)]
    return alone if (predicted_better(other, alone[0], rows) or 0.0) >= PAIR_GAIN else None


def _pair(
    state: State, joint: int, kinds: Sequence[type[Effect]], least: float = PAIR_GAIN
) -> tuple[State, list[Step]] | None:
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
    if gain is None or gain < least or not improves(state, grown, rows[0]):
        return None
    for candidate in scored if len(scored) > 1 else []:
        single = refreshed(fit(state.log, (*state.effects, candidate.effect), state.scene))
        if (predicted_better(single, grown, rows) or 0.0) < PAIR_GAIN:
            return None
    net = 0.5 * state.projected.count / len(state.projected.places) * float(np.log(1.0 / max(1.0 - gain, 1e-6)))
    return grown, [Step(c, (), net) for c in scored]
