"""From the outcome of a search to what is said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.effect_errors import standard_errors
from elid_cli.diagnosis.evidence.held_out import held_out_gain
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.form_errors import beside_rivals, in_forms
from elid_cli.diagnosis.residuals import Organised, RowState, follows_motion, judged_rows, organise, rows_of, words
from elid_cli.diagnosis.result import Diagnosis, FoundEffect, Moved, Nearest, OtherForm, Unexplained
from elid_cli.diagnosis.rivals import rivals_of, rivals_of_skews
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.encoder_skew import Skew
from elid_cli.diagnosis.search.steps import Found, Step, Term
from elid_cli.diagnosis.unexplained import away_from_changes, unseen
from elid_cli.estimation.identify import Nuisance
from elid_cli.estimation.refined_robot import refined_robot, representative
from elid_cli.estimation.regression.rotor_shares import with_rotors
from elid_cli.estimation.regression.standard_errors import told_rotors
from elid_cli.estimation.stretches import spans
from elid_cli.estimation.validation.cross_validation import floored
from elid_cli.estimation.validation.prediction import validate
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.model.effects.effect import Channel, Effect
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.robot import EffectSpec, Robot

CHANNEL = ("delay", "offset")
"""Nuisances of a torque channel, which stand in the list of what is corrected even where they are named as effects."""
_SIDES = {"load": "link", "drive": "motor"}
"""What lies in a row of a joint with a torque sensor."""


def result(
    robot: Robot, log: Log, found: Found, declared: int, curves: Sequence[Effect], named: State,
    forms: Mapping[int, tuple[OtherForm, ...]],
) -> Diagnosis:  # fmt: skip
    """Return what is said of a search; `named` is the model after without curves, which explain nothing.

    `forms` are those of the effects, by number, that explain the log about as well.
    """
    before, after = found.before, found.after
    chosen = log.fold < 0
    first = described(robot, before)
    last = described(robot, after)
    validations = [validate(r, log.raw, chosen) for r in (first, last)]
    rows_before, rows_after = rows_of(before), rows_of(after)
    effects = tuple(
        in_forms(_found(after, k, step, found.terms), forms.get(k, ()))
        for k, step in enumerate(found.steps, start=declared)
    )
    rivals = rivals_of(after, declared, found.steps, effects)
    effects = tuple(beside_rivals(effect, rivals) for effect in effects)
    known = declared + len(found.steps)
    terms = tuple(_term(after, k, term) for k, term in sorted(found.terms.items()) if k >= known)
    fitted = {e.joint for e in after.effects if e.corrects == "link"}
    seen = tuple(_seen(robot, after, skew) for skew in found.skews if skew.joint not in fitted)
    extra = tuple(_curve(after, len(after.effects) - len(curves) + k) for k in range(len(curves)))
    last_error = floored(validations[1].error, robot.joint_names, after.floor.rms)
    unexplained = _unexplained(named, rows_of(named), found.remaining)
    unexplained += unseen(away_from_changes(last_error, validations[1], after, chosen), rows_after, unexplained)
    return Diagnosis(
        robot=robot,
        refined=last,
        before=floored(validations[0].error, robot.joint_names, before.floor.rms),
        after=last_error,
        effects=(*seen, *effects, *terms),
        also_possible=(*rivals, *rivals_of_skews(robot, found.skews)),
        nuisances=(
            *_nuisances(after),
            *(_kept(after, k) for k in range(declared - found.kept, declared)),
            *(_kept(after, k) for k in range(declared, len(after.effects)) if after.effects[k].nuisance in CHANNEL),
        ),
        unexplained=unexplained,
        rows_before=rows_before,
        rows_after=rows_after,
        triage=words(rows_before),
        organised={
            (robot.joint_names[row.joint], row.kind): tuple(organise(before, row)[:4]) for row in judged_rows(before)
        },
        moved=moved(before, after),
        sufficient=not effects and not seen and not unexplained,
        tried=found.tried,
        held_out=spans(log.observation.t, chosen),
        validation_before=validations[0],
        validation_after=validations[1],
        chosen=chosen,
        state_before=before,
        state_after=after,
        curves=extra,
        partial=found.partial,
    )


def described(robot: Robot, state: State) -> Robot:
    """Return the robot description that a state amounts to: parameters, effects, corrected torque channels."""
    base = state.log.base
    rotors = {joint: inertia for joint, (inertia, _) in told_rotors(state.solved).items()}
    near, kept = with_rotors(robot, robot.reference(), rotors)
    standard = representative(base, base.transform @ state.standard, near, kept)
    specs = [*state.specs, *channel_specs(state)]
    moved_joints = {e.joint for e in state.effects if e.corrects == "link"}
    specs += [
        late_by("link", robot.joint_names[j], float(state.log.shifts.link[j]))
        for j in np.flatnonzero(state.log.shifts.link)
        if j not in moved_joints
    ]
    return refined_robot(robot, standard, specs)


def channel_specs(state: State) -> list[EffectSpec]:
    """Return what a state corrects in the torque channels, as effects of the measurement: delays and offsets."""
    names = state.log.model.robot.joint_names
    offset = effect_that(nuisance="offset")
    late = [late_by("torque", names[j], delay) for j, delay in state.delays.items()]
    shifted = [
        EffectSpec(offset.name, names[j], {offset.amplitudes[0].name: value}) for j, value in state.offsets.items()
    ]
    return [*late, *shifted]


def late_by(channel: Channel, joint: str, seconds: float) -> EffectSpec:
    """Return the effect of a channel that is late."""
    kind = effect_that(corrects=channel)
    return EffectSpec(kind.name, joint, {kind.amplitudes[0].name: seconds})


def _found(state: State, number: int, step: Step, terms: Mapping[int, Term]) -> FoundEffect:
    effect = state.effects[number]
    gain = terms[number].gain if number in terms else held_out_gain(state, number)
    folds = tuple(bool(g > 0) for g in step.candidate.gain.folds)
    found = FoundEffect(*_told(state, number), gain, effect.summary, step.net, folds, effect.local)
    return replace(found, collocated=number in terms, quarters=step.quarters, absorbed=step.absorbed)


def _told(state: State, number: int) -> tuple[str, str | None, dict[str, float], dict[str, float]]:
    """Return name, joint, parameters and their standard errors of an effect."""
    effect = state.effects[number]
    return effect.name, state.joint_of(effect), state.named(number), standard_errors(state, number)


def _term(state: State, number: int, term: Term) -> FoundEffect:
    """Return a further term of a friction curve, which the collocation told."""
    summary = "further term of a friction curve"
    return FoundEffect(*_told(state, number), term.gain, summary, term.net, collocated=True)


def _seen(robot: Robot, state: State, skew: Skew) -> FoundEffect:
    """Return a skew that only the positions show; its gain is in the variance of the deflection."""
    spec = late_by("link", robot.joint_names[skew.joint], float(state.log.shifts.link[skew.joint]))
    summary = f"{effect_classes()[spec.effect].summary}; seen in the positions alone"
    errors, rms = dict.fromkeys(spec.parameters, skew.deviation), (skew.without, skew.with_it)
    found = FoundEffect(spec.effect, spec.joint, spec.parameters, errors, skew.share, summary)
    return replace(found, deflection=rms, quarters=skew.quarters)


def _curve(state: State, number: int) -> FoundEffect:
    effect = state.effects[number]
    gain = held_out_gain(state, number)
    return FoundEffect(effect.name, state.joint_of(effect), state.named(number), {}, gain, effect.summary)


def _nuisances(state: State) -> tuple[Nuisance, ...]:
    names = state.log.model.robot.joint_names
    found = []
    first = state.log.model.parameters
    for k, extra in enumerate(state.nuisances):
        where = np.flatnonzero(state.solution.basis == first + k)
        deviation = float(np.sqrt(state.covariance[where[0], where[0]])) if len(where) else float("nan")
        joint = names[next(iter(extra.rows)).joint]
        value = float(state.solution.values[first + k])
        if extra.nuisance == "delay":
            value = state.delays[next(iter(extra.rows)).joint]
        name = effect_classes()[extra.name].amplitudes[0].name
        found.append(Nuisance(extra.name, joint, {name: value}, {name: deviation}))
    return tuple(found)


def _kept(state: State, number: int) -> Nuisance:
    """Return an effect that stays in the model without being named, or is a fault of a channel that is corrected."""
    effect = state.effects[number]
    joint = state.log.model.robot.joint_names[effect.joint]
    return Nuisance(effect.name, joint, state.named(number), standard_errors(state, number))


def _unexplained(state: State, rows: Sequence[RowState], remaining: Sequence[Candidate]) -> tuple[Unexplained, ...]:
    names = state.log.model.robot.joint_names
    found = []
    for item in rows:
        if not item.high:
            continue
        joint = names.index(item.joint)
        if not follows_motion(state, EstimationRow(item.rows, joint)):
            continue
        organised = organise(state, EstimationRow(item.rows, joint))
        best = organised[0] if organised else Organised("none", 0.0)
        taken = sorted(
            (
                (c, state.projected.taken(c.columns.rows))
                for c in remaining
                if c.plausible and (c.effect.joint == joint or c.effect.whole_robot)
            ),
            key=lambda pair: -pair[1],
        )
        best_of = {
            c.key: Nearest(c.effect.name, None if c.effect.whole_robot else item.joint, part, c.values)
            for c, part in taken[::-1]
        }
        near = tuple(item for item in reversed(best_of.values()) if item.gain > 0)[:3]
        side = "link" if item.rows == "sum" and _quiet(rows, item.joint) else _SIDES.get(item.rows, item.rows)
        found.append(Unexplained(item.joint, side, best.variable, best.share, item.rms, item.ratio, near))
    return tuple(found)


def _quiet(rows: Sequence[RowState], joint: str) -> bool:
    """Whether the motor row of a joint is at its floor (so that a high sum row means the link side)."""
    motor = [r.high for r in rows if r.joint == joint and r.rows == "motor"]
    return bool(motor) and not motor[0]


def moved(before: State, after: State) -> tuple[Moved, ...]:
    """Return the base parameters with their shift in standard deviations, largest first."""
    base = before.log.base
    new, deviation, known = after.base_values(base, shapes=True)
    old = base.transform @ before.standard
    shifts = [
        Moved(name, float(a), float(b), float((b - a) / d))
        for name, a, b, d, k in zip(base.names, old, new, deviation, known, strict=True)
        if k and d > 0
    ]
    return tuple(sorted(shifts, key=lambda m: -abs(m.deviations)))
