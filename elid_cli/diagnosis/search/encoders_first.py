"""Faults between the encoders of a joint, which come before any physics: skews and offsets that the positions show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.acceptance import improves, predicted_better
from elid_cli.diagnosis.search.encoder_skew import Skew, looked_again, visible_skew
from elid_cli.diagnosis.search.screening import score, sensible
from elid_cli.diagnosis.search.steps import Step
from elid_cli.model.effects import effect_classes, effect_that, twins_of
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow

APART = 0.02
"""Part by which errors left out must differ for the torques to decide between a skew and friction."""
LOOKS, SETTLED = 4, 0.02
"""Times that a skew seen in the positions is looked at, and part of a sample within which it counts as settled."""
PAIR_GAIN = 0.1
"""Least part of the left-out motor row's error that both together must take away, also from either alone."""


def measurement_first(state: State, library: Mapping[str, type[Effect]]) -> tuple[State, list[Step]]:
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


def seen_in_positions(state: State, library: Mapping[str, type[Effect]]) -> tuple[State, tuple[Skew, ...]]:
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


def against_friction(
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
