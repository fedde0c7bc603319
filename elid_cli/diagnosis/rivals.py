"""What explains a log as well as an effect that was found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Required, TypedDict

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.effect_errors import standard_errors
from elid_cli.diagnosis.evidence.held_out import held_out_share
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.result import FoundEffect, Rival
from elid_cli.diagnosis.search.acceptance import left_behind, touched
from elid_cli.diagnosis.search.encoder_skew import Skew
from elid_cli.diagnosis.search.other_forms import MOVED, moved_between
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.diagnosis.search.steps import NEAR, NEAR_SHARE, TWIN_SHARE, Step, are_twins
from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.model.effects import effect_classes, effect_that, twins_of
from elid_cli.model.effects.effect import Effect, Same
from elid_cli.model.effects.posed import turns_model
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.robot import Robot

MOST = 0.5
"""Least part of what the named effect is worth, as log-likelihood, that a rival is worth in its place."""


def rivals_of_skews(robot: Robot, skews: Sequence[Skew]) -> tuple[Rival, ...]:
    """Return what the torques like as well as a skew that the positions show."""
    named = effect_that(corrects="link").name
    return tuple(
        Rival(
            name,
            robot.joint_names[skew.joint],
            named,
            skew.share,
            values,
            effect_classes()[name].record,
            at=robot.joint_names[skew.joint],
        )
        for skew in skews
        for name, values in skew.rivals
    )


def rivals_of(state: State, declared: int, steps: Sequence[Step], effects: Sequence[FoundEffect]) -> tuple[Rival, ...]:
    """Return what else each of the named effects could be, each once.

    Parameters
    ----------
    state
        The model with them.
    declared
        How many of its effects, the first ones, are not named.
    steps, effects
        How each was accepted, and what is said of it.
    """
    robot = state.log.model.robot
    named = {(e.effect, e.joint) for e in effects}
    rivals: dict[tuple[str, str | None], Rival] = {}
    said = dict(enumerate(effects, start=declared))
    for number, (step, effect) in enumerate(zip(steps, effects, strict=True), start=declared):
        own = state.effects[number]
        for twin in type(own).same_here(state.scene, own.joint, effect.parameters):
            kind = effect_classes()[twin.effect]
            place = (twin.effect, None if kind.whole_robot else robot.joint_names[twin.joint])
            if place not in named:
                fitted = _twin_in_its_place(state, number, twin, said)
                alike = fitted or _InPlace(gain=effect.gain, parameters=twin.values)
                rivals[place] = Rival(*place, effect.effect, separate=kind.record, at=effect.joint, **alike)
        for other, values, twins in _others(state, number, step):
            key = (other.name, state.joint_of(other))
            if key in named or key in rivals:
                continue
            there = _in_its_place(state, number, other, values, said, twins=twins)
            if there is not None:
                # of two that imitate each other the one that declares so says what tells them apart
                record = own.record if other.name in own.twins else other.record
                rivals[key] = Rival(*key, effect.effect, separate=record, at=effect.joint, **there)
    for rival in _together(robot, effects):
        rivals.setdefault((rival.effect, rival.joint), rival)
    return tuple(rivals.values())


def _others(state: State, number: int, step: Step) -> Iterator[tuple[Effect, Mapping[str, float], bool]]:
    """Yield what is tried in the place of effect `number`, with what is known of its values, and whether it is a twin.

    Beside what the search could not tell from it these are declared twins at joints that have what they come with: the
    search screened them with what the model knew then.
    """
    for candidate in step.rivals:
        yield candidate.effect, candidate.values, are_twins(step.candidate, candidate)
    own, present = state.effects[number], {(e.name, e.joint) for e in state.effects}
    for name in twins_of(type(own)):
        kind = effect_classes()[name]
        places = {e.joint for k, e in enumerate(state.effects) if k != number and e.name in kind.comes_with}
        able = (joint for joint in sorted(places) if not kind.shapes and (name, joint) not in present)
        yield from ((kind(joint), {}, True) for joint in able)


class _InPlace(TypedDict, total=False):
    """What a rival is in the place of the named effect (`Rival`)."""

    gain: Required[float]
    behind: float
    parameters: Required[Mapping[str, float]]
    std_error: Mapping[str, float]
    change: Array
    further: Array
    moved: tuple[tuple[str, float], ...]
    beside: tuple[FoundEffect, ...]


def _twin_in_its_place(state: State, number: int, twin: Same, named: Mapping[int, FoundEffect]) -> _InPlace | None:
    """Return what an effect's other name is in its place, with what it does there to the parameters; None: no fit."""
    kind = effect_classes()[twin.effect]
    if not set(kind.parameter_names()) <= twin.values.keys():
        return None
    shape = tuple(twin.values[p.name] for p in kind.shapes)
    return _in_its_place(state, number, kind(twin.joint, shape), twin.values, named, twins=True)


def _in_its_place(
    state: State, number: int, rival: Effect, values: Mapping[str, float], named: Mapping[int, FoundEffect],
    *, twins: bool,
) -> _InPlace | None:  # fmt: skip
    """Return what a rival is from a fit with it in the place of effect `number`; None where it does not explain that.

    `named` are what is said of the effects, by number.

    It came as near as that beside what was known when the effect was found. What it explained then may have been
    another effect's, which is in the model now: it must come as near again, `twins` as near as twins do.
    """
    lacking = without(state, number)
    log, scene = lacking.log, lacking.scene
    if turns_model(type(rival)):  # begun where it was found: the first step from nothing may lead elsewhere
        log = log.posed(log.pose.moved(rival, np.array(list(values.values()))))
        scene = scene_of(log.model, log.signals, lacking.standard, scene.rotors)
    other = refreshed(fit(log, (*lacking.effects, rival), scene, but=lacking.but))
    last = len(other.effects) - 1
    gain = _explained(lacking, state, other, number)
    behind, worth = left_behind(state, other), left_behind(state, lacking)
    near = behind < max(NEAR, NEAR_SHARE * worth) or (twins and behind < (1.0 - TWIN_SHARE) * worth)
    if gain is None or not (near and behind < (1.0 - MOST) * max(worth, 0.0)):
        return None
    told, fitted = _InPlace(gain=gain, behind=behind, parameters=values), other.named(last)
    if not sensible(other.effects[last], other.scene, fitted):
        return told if values else None
    change, moved = moved_between(state, other)
    (_, own, known), (_, there, still) = (one.base_values(state.log.base) for one in (state, other))
    further = np.where(known & still, np.sqrt(np.maximum(there**2 - own**2, 0.0)), 0.0)
    errors = standard_errors(other, last)
    return told | _InPlace(
        gain=gain, behind=behind, parameters=fitted, std_error=errors, change=change, further=further,
        moved=moved, beside=tuple(_moved_effects(other, number, named)),
    )  # fmt: skip


def _moved_effects(other: State, number: int, named: Mapping[int, FoundEffect]) -> Iterator[FoundEffect]:
    """Yield the named effects that a state without effect `number` has with other values, as they are there."""
    for k, effect in named.items():
        if k == number:
            continue
        values = other.named(k if k < number else k - 1)
        errors = effect.std_error
        if any(abs(values[p] - effect.parameters[p]) > MOVED * errors[p] for p in errors.keys() & values.keys()):
            yield replace(effect, parameters=values)


def _explained(lacking: State, state: State, other: State, number: int) -> float | None:
    """Return the part of what effect `number` is there for that another state's last effect takes; None: too little.

    It is asked on data that no fit saw. Counted as log-likelihood: what leaves half the residual where the other leaves
    noise is no rival. What acts for a moment need not be in those data at all: it is asked where they were fitted, as
    all is that helps nowhere else.
    """
    rows = touched(lacking, state, state.columns[number].rows)
    judges: list[Callable[[State], float]] = [lambda one: _taken(lacking, one, state, rows)]
    if not state.effects[number].local:
        judges.insert(0, lambda one: held_out_share(lacking, one, rows))
    for judge in judges:
        gained, share = judge(state), judge(other)
        if gained > 0:
            return share if _likelihood(share) > MOST * _likelihood(gained) else None
    return judges[-1](other)


def _likelihood(share: float) -> float:
    """Return the log-likelihood that taking away a share of the squared residual is worth, per two equations."""
    return -float(np.log(max(1.0 - share, 1e-300)))


def _taken(lacking: State, state: State, unit: State, rows: Sequence[EstimationRow]) -> float:
    """Return the share of the squared residual in some rows that a state takes away where both were fitted."""
    before, after = (
        sum((one.rms(row) / max(unit.rms(row), 1e-300)) ** 2 for row in rows if row in one.triangles.rows)
        for one in (lacking, state)
    )
    return 1.0 - after / before if before > 0 else 0.0


def _together(robot: Robot, effects: Sequence[FoundEffect]) -> list[Rival]:
    """Return what effects of one kind at several joints are together the same as."""
    rivals = []
    for name in dict.fromkeys(effect.effect for effect in effects):
        kind = effect_classes()[name]
        alike = [e for e in effects if e.effect == name and e.joint is not None]
        places = {robot.joint_names.index(e.joint or ""): e.parameters for e in alike}
        rivals += [
            Rival(twin.effect, robot.joint_names[twin.joint], name, alike[0].gain, dict(twin.values), kind.record)
            for twin in kind.same_together(robot, places)
        ]
    return rivals
