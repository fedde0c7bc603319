"""Models before and after as identifications; what each effect is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, cast

import numpy as np

from elid_cli.diagnosis.effect_errors import held_errors
from elid_cli.diagnosis.evidence.held_out import held_out_triangles
from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.form_errors import reaching_forms
from elid_cli.diagnosis.result import Diagnosis, FoundEffect, Unexplained
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.diagnosis.stiffness_by_load import with_load
from elid_cli.diagnosis.summary import described
from elid_cli.diagnosis.written import robot_between, worse
from elid_cli.errors import DataError
from elid_cli.estimation.assembly import assemble, judged
from elid_cli.estimation.data import Solved
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.identify import identify
from elid_cli.estimation.judgement import Insufficient, JointError
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.regression.standard_errors import covariance_of
from elid_cli.estimation.result import EstimateOptions, FittedEffect, Identification, Nuisance
from elid_cli.estimation.stretches import STRETCHES
from elid_cli.estimation.validation.prediction import Validation, validate
from elid_cli.estimation.validation.sufficiency import UNCLEAR
from elid_cli.model.effects import effect_classes, nuisance_of
from elid_cli.model.effects.shifts import corrected, declared_shifts
from elid_cli.model.regressor import EstimationRow, Kind
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import Signals

HELD = 0.05
"""Part of themselves within which found effects' amplitudes stay when parameters are published …"""
LOOSE = 1.0
"""… and the same where base parameters had taken up one of them: neither is then known without the other."""


def identified(state: State, error: Mapping[str, JointError], declared: int = 0) -> Identification:
    """Return what a state's fit to the training stretches says about the base parameters.

    Parameters
    ----------
    state
        The model before or after.
    error
        Its error on the held-out stretches.
    declared
        How many of the state's effects, the first ones, the robot file declares.
    """
    log = state.log
    options = EstimateOptions(folds=STRETCHES, offsets=False)
    solved = Solved(log.base, log.data, state.nuisances, None, state.triangles, state.solution)
    if state.known is not None:  # a collocation holds the trajectory to the equations: its deflections are no noise
        found = assemble(DefaultFit(**vars(solved), covariance=state.known), options)
    else:
        covariance = covariance_of(state.solved)  # shapes of effects and shares of rotors among what is unknown
        _, _, found = judged(DefaultFit(**vars(solved), covariance=covariance), options)
    whole = {"instants": log.observation.instants, "masked": [float(share) for share in log.observation.masked]}
    effects = tuple(FittedEffect(s.effect, s.joint, s.parameters, {}) for s in state.specs[:declared])
    found = replace(found, error=error, settings={**found.settings, **whole}, effects=effects)
    return with_load(found, state)


UNCHANGED = 0.99
"""Part of itself above which a row's held-out error is the same as without an effect."""


class Published(NamedTuple):
    """What is said of the parameters before and after, and the robot that is written."""

    before: Identification
    after: Identification
    robot: Robot
    worse: tuple[str, ...] = ()
    """Joints whose left-out torque is predicted worse with what was found: the robot then has the parameters before."""
    left_out: tuple[Mapping[str, JointError], Mapping[str, JointError]] = ({}, {})
    """Errors on left-out stretches by the models before and after, both at one cut-off of identification's."""
    cutoff: float = float("nan")
    """That cut-off, Hz."""


def published(found: Diagnosis, signals: Signals) -> Published:
    """Return what identification says of the models before and after: at its own cut-off, with the effects held.

    Noise of coarse encoders enters the columns at the cut-off that effects need, and bends what is estimated there.
    A model that a collocation fitted stands as it is.

    Parameters
    ----------
    found
        The diagnosis.
    signals
        The log as identification takes it.
    """
    declared = len(found.state_before.effects)
    first = _identified_again(found.robot, found.state_before, found.before, signals, declared)
    hold = LOOSE if any(effect.absorbed for effect in found.effects) else HELD
    last = _identified_again(found.robot, found.state_after, found.after, signals, declared, hold)
    rows = {(row.joint, row.rows): row for row in found.rows_after}
    noise = tuple(item for item in last.told.noise if (item.joint, item.rows) in rows)
    told = with_unexplained(replace(last.told, noise=noise), found.unexplained)
    after = reaching_forms(told, found.effects, found.also_possible)
    if last.robot is None or first.robot is None:
        return Published(first.told, after, last.robot or found.refined)
    errors, cutoff = _comparable(first, last, signals) if found.effects else ((first.told.published,) * 2, first.cutoff)
    joints = worse(*errors) if found.effects else ()
    robot = robot_between(first.robot, last.robot) if joints else last.robot
    return Published(first.told, after, robot, joints, errors, cutoff)


def with_unexplained(told: Identification, unexplained: Sequence[Unexplained]) -> Identification:
    """Return an identification that lacks what a diagnosis could not explain, at its own cut-off or at a higher one.

    Many times the noise may move what has its place at that joint.
    """
    if not unexplained:
        return told
    known = {(item.joint, item.rows) for item in told.insufficient}
    more = [
        Insufficient(item.joint, cast(Kind, item.rows), item.ratio, item.variable, item.share)
        for item in unexplained
        if (item.joint, item.rows) not in known
    ]
    loud = {item.joint for item in unexplained if item.ratio > UNCLEAR}
    names = told.robot.joint_names
    parameters = tuple(
        replace(p, bias_possible=p.bias_possible or names[p.leader.joint] in loud) for p in told.parameters
    )
    lacking = (*told.insufficient, *more)
    return replace(told, model="insufficient", insufficient=lacking, parameters=parameters, not_excluded=())


def _comparable(
    first: _Again, last: _Again, signals: Signals
) -> tuple[tuple[Mapping[str, JointError], Mapping[str, JointError]], float]:
    """Return the errors of two models on left-out stretches at one cut-off: that of both, or identification's usual."""
    if first.cutoff == last.cutoff:
        return (first.told.published, last.told.published), first.cutoff
    return (first.left_out(), last.left_out()), signals.filter.cutoff


class _Again(NamedTuple):
    """What identification says of a model: of its parameters, the robot with them, errors on stretches left out."""

    told: Identification
    robot: Robot | None = None
    fitted: tuple[Robot, Signals] | None = None
    options: EstimateOptions = EstimateOptions(fit="torque", hold=HELD)

    @property
    def cutoff(self) -> float:
        """Cut-off that the fit chose, Hz."""
        return float(self.told.settings["published"]["cutoff"])  # type: ignore[index]

    def left_out(self) -> Mapping[str, JointError]:
        """Return the errors on left-out stretches at the cut-off of the signals, whatever the fit chose."""
        assert self.fitted is not None
        robot, signals = self.fitted
        if self.cutoff == signals.filter.cutoff:
            return self.told.published
        return identify(robot, replace(signals, cutoff_free=False), self.options).error


def _identified_again(
    robot: Robot, state: State, error: Mapping[str, JointError], signals: Signals, declared: int, hold: float = HELD
) -> _Again:
    at_search = identified(state, error, declared)
    if state.known is not None:
        return _Again(at_search)
    described_ = described(robot, state)
    own = [(spec.effect, spec.joint) for spec in robot.effects]
    held, late = [], []
    for spec in described_.effects:
        kind = effect_classes()[spec.effect]
        if kind.corrects in ("link", "position"):
            late.append(spec)
        elif kind.nuisance == "delay" and next(iter(spec.parameters.values())) < 0:
            late.append(spec)  # logged later than it acts: identification corrects the other sign
        # identification estimates offsets and delays of any size itself
        elif kind.nuisance != "delay" and (kind.nuisance != "offset" or (spec.effect, spec.joint) in own):
            held.append(spec)
    # a late encoder is put right as a prediction does it: its first order alone would bend the bodies' torques
    moved = corrected(signals, declared_shifts(replace(described_, effects=tuple(late))))
    # with the values of the file, not those of the search: a link's equation would give these back as known inertias,
    # and what the log does not show stays as identify leaves it
    joints = tuple(
        replace(joint, parameters=own.parameters) for joint, own in zip(described_.joints, robot.joints, strict=True)
    )
    # what is held loosely is estimated again, shapes and all
    options = EstimateOptions(fit="torque", hold=hold, held=held_errors(state) if hold < LOOSE else None)
    fitted = replace(described_, joints=joints, effects=tuple(held)), moved
    try:
        found = identify(*fitted, options)
    except DataError:  # too few instants at the lower cut-off
        return _Again(at_search)
    items = zip(found.parameters, at_search.parameters, strict=True)
    told = replace(
        at_search,
        parameters=tuple(replace(item, reference=other.reference) for item, other in items),
        nuisances=_with_moved(found.nuisances, late), covariance=found.covariance, standard=found.standard,
        rotors=found.rotors,
        condition=found.condition, rank=found.rank,
        rank_margin=found.rank_margin, warnings=found.warnings, notes=found.notes,
        noise=found.noise, insufficient=found.insufficient, model=found.model, not_excluded=found.not_excluded,
        settings={**at_search.settings, "published": dict(found.settings)}, published=found.error,
    )  # fmt: skip
    written = identified_robot(replace(found, parameters=told.parameters))
    return _Again(told, replace(written, effects=_summed((*written.effects, *late))), fitted, options)


def _summed(specs: Sequence[EffectSpec]) -> tuple[EffectSpec, ...]:
    """Return effects to write, with delays of one channel as one: the part that was moved, and what is left of it."""
    found = dict[tuple[str, str | None], EffectSpec]()
    for number, spec in enumerate(specs):
        late = effect_classes()[spec.effect].nuisance == "delay"
        key = (spec.effect, spec.joint) if late else (spec.effect, f"{spec.joint} {number}")
        parts = [one.parameters for one in (found.get(key), spec) if one is not None]
        whole = {name: sum(part.get(name, 0.0) for part in parts) for name in parts[0]} if late else spec.parameters
        found[key] = replace(spec, parameters=whole)
    return tuple(found.values())


def _with_moved(found: Sequence[Nuisance], late: Sequence[EffectSpec]) -> tuple[Nuisance, ...]:
    """Return faults of channels with delays that are whole: with those by which the channels were moved before."""
    moved = {(spec.effect, spec.joint): spec.parameters for spec in late}
    return tuple(
        replace(item, parameters={
            name: value + moved.get((item.effect, item.joint), {}).get(name, 0.0)
            for name, value in item.parameters.items()
        })
        for item in found
    )  # fmt: skip


@dataclass(frozen=True)
class Contribution:
    """Held-out error of one row group without an effect and with it, N·m (N); of the deflection in rad (m)."""

    effect: FoundEffect
    joint: str
    rows: str
    without: float
    with_it: float
    whole_without: float
    """Without all terms of the curve that the effect is a term of; as `without` where it stands alone."""


def contributions(found: Diagnosis) -> tuple[Contribution, ...]:
    """Return, per effect and curve, the row group whose held-out error it lowers most."""
    state = found.state_after
    fitted = [e for e in (*found.effects, *found.curves) if e.deflection is None]
    first = len(state.effects) - len(fitted)
    seen = [_seen(effect) for effect in found.effects if effect.deflection is not None]
    places = [(effect.effect, effect.joint) for effect in fitted]
    return (
        *seen,
        *(
            _contribution(found, first + k, effect, [first + n for n, p in enumerate(places) if p == places[k]])
            for k, effect in enumerate(fitted)
        ),
    )


def _seen(effect: FoundEffect) -> Contribution:
    """Return what an effect seen in the positions takes from the deflection, rad."""
    outside, inside = effect.deflection or (float("nan"), float("nan"))
    return Contribution(effect, effect.joint or "", "deflection", outside, inside, outside)


def without_terms(state: State, numbers: Sequence[int]) -> State:
    """Return the model without some of its effects, fitted."""
    for number in sorted(numbers, reverse=True):
        state = without(state, number)
    return state


def _contribution(found: Diagnosis, number: int, effect: FoundEffect, terms: Sequence[int]) -> Contribution:
    state = found.state_after
    outside, inside = _held_out(found, without(state, number)), _rms_by_row(found, found.validation_after)
    alone = len(terms) == len(state.effects) - len(found.state_before.effects) and not nuisance_of(effect.effect)
    if alone:  # nothing else was found: the model without it is the model before
        bare = _rms_by_row(found, found.validation_before)
    else:
        bare = outside if len(terms) == 1 else _held_out(found, without_terms(state, terms))
    outside = bare if len(terms) == 1 else outside
    own, errors = state.columns[number].rows, {row: (outside[row], inside[row]) for row in inside if row in outside}
    helped = touched(without(state, number), state, own)
    gained = any(after < UNCHANGED * before for row, (before, after) in errors.items() if row in own)
    # a gain of one joint's torque scales that joint's parameters until its own rows fit: it shows at another
    errors = {row: pair for row, pair in errors.items() if row in own or (row in helped and not gained)}
    if not errors:  # rows that a prediction does not judge, as a spring's whose stiffness is unknown
        outside, inside, bare = (_by_search(s) for s in (without(state, number), state, without_terms(state, terms)))
        errors = {row: (outside[row], inside[row]) for row in state.columns[number].rows if row in inside}
    row = min(errors, key=lambda r: errors[r][1] / max(errors[r][0], 1e-300))
    joint = state.log.model.robot.joint_names[row.joint]
    return Contribution(effect, joint, row.kind, *errors[row], bare[row])


def _held_out(found: Diagnosis, state: State) -> Mapping[EstimationRow, float]:
    """Return the held-out error of every row of a state, as that of the models before and after is told, N·m (N)."""
    return _rms_by_row(found, validate(described(found.robot, state), state.log.raw, found.chosen))


def _by_search(state: State) -> Mapping[EstimationRow, float]:
    """Return the held-out error of every row of a state with its own values, N·m (N)."""
    held = held_out_triangles(state)
    return {row: held.rms(state.solution.values, row) for row in held.rows}


def _rms_by_row(found: Diagnosis, judged_: Validation) -> Mapping[EstimationRow, float]:
    uses = {
        group.row: group.use & found.chosen for group in judged_.observation.groups if group.row in judged_.residual
    }
    return {row: float(np.sqrt(np.mean(judged_.residual[row][use] ** 2))) for row, use in uses.items() if use.any()}
