"""Faults of the torque channels that are worth a name: offsets, and delays of more than a sample.

Zero and delay of a torque channel are unknowns of every model here, as they are in identification: no effect has to be
made up for them, and none is judged before they are corrected. What clearly predicts better with its correction is
named as well, by the same rules as an effect that the search finds. Friction that differs between the two directions
is the same constant as long as a joint does not rest, and a damper in the transmission nearly the same delay: what does
as well in its place is told beside it.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

from elid_cli.diagnosis.effect_errors import standard_errors
from elid_cli.diagnosis.evidence.held_out import held_out_gain
from elid_cli.diagnosis.evidence.leftover import only_helps, silences
from elid_cli.diagnosis.evidence.quarters import left_out, survival
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import left_out_error, predicted_better, touched
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.screening import score, sensible
from elid_cli.diagnosis.search.steps import Found, Step
from elid_cli.estimation.data import sum_row
from elid_cli.model.effects import effect_classes, twins_of
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow

TWIN_TAKES = 0.98
"""Part of what a fault takes from left-out folds that a twin must take in its place, to be as possible."""
LEAVES, BLURRED = 1.05, 1.15
"""Left-out error of any one row, over that with the fault, from which a twin is not as possible, and that of a twin
that follows the motor's speed alone: noise blurs the sign of that at reversals. On 24 simulated logs friction that
differs between directions, the truth, was worse than an offset by up to 8 % in one row."""
SHORT = 1.05
"""Samples up to which a delay is one of the sampling, which every log has, and no effect."""


def with_channel_faults(found: Found, names: Container[str]) -> Found:
    """Return the outcome with faults of torque channels as effects where they are worth a name.

    Parameters
    ----------
    found
        What the search found.
    names
        Effects that may be named.
    """
    faults = [(effect_classes()[extra.name], sum_row(extra).joint) for extra in found.after.nuisances]
    for kind, joint in faults:
        if kind.name not in names:
            continue
        if kind.nuisance == "offset" and found.after.log.signals.still[joint]:
            continue  # what holds a joint that does not move may be its friction
        short = SHORT * found.after.log.signals.dt
        if kind.nuisance == "delay" and abs(found.after.delays.get(joint, 0.0)) <= short:
            continue
        named = _named(found.after, kind(joint))
        if named is not None:
            state, step = named
            found = replace(found, after=state, steps=(*found.steps, step))
    return found


def _named(state: State, effect: Effect) -> tuple[State, Step] | None:
    """Return the state with a fault of a channel as its last effect, if it deserves a name, and the step to it."""
    grown = fit(state.log, (*state.effects, effect), state.scene, but=state.but)
    number = len(grown.effects) - 1
    lacking = without(grown, number)
    candidate = score(lacking, effect, 1, 1)
    if candidate is None or not sensible(effect, grown.scene, grown.named(number)):
        return None
    rows = touched(lacking, grown, grown.columns[number].rows)
    gain = held_out_gain(grown, number)
    if gain < effect.least_gain or predicted_better(lacking, grown, rows) is None:
        return None
    if only_helps(grown, number, gain) or silences(grown, number):
        return None
    quarters = survival(grown, number, left_out(grown))
    if not quarters.survives:
        return None
    candidate = replace(candidate, values=grown.named(number))
    return grown, Step(candidate, _as_possible(grown, lacking, effect, rows), quarters=quarters.gains)


def _as_possible(state: State, lacking: State, effect: Effect, rows: Sequence[EstimationRow]) -> tuple[Candidate, ...]:
    """Return the twins of a fault that take as much from left-out folds in its place."""
    present, found = {(other.name, other.joint) for other in state.effects}, []
    for name in twins_of(type(effect)):
        twin = effect_classes()[name]
        if (name, effect.joint) in present or not twin.applies(state.log.model.robot, effect.joint):
            continue
        candidate = score(lacking, twin(effect.joint), 1, 1)
        if candidate is None:
            continue
        other = refreshed(fit(lacking.log, (*lacking.effects, candidate.effect), lacking.scene, but=lacking.but))
        values = other.named(len(other.effects) - 1)
        nothing, by_fault, by_twin = (left_out_error(s, state, rows) for s in (lacking, state, other))
        most = BLURRED if twin.of_motor_speed else LEAVES
        worse = any(left_out_error(other, state, [r]) > most * left_out_error(state, state, [r]) for r in rows)
        takes = not worse and nothing - by_twin >= TWIN_TAKES * (nothing - by_fault)
        errors = standard_errors(other, len(other.effects) - 1) if takes else {}
        room = takes and twin.can_be(other.scene, effect.joint, values, errors)
        if room and sensible(candidate.effect, other.scene, values):
            found.append(replace(candidate, values=values))
    return tuple(found)
