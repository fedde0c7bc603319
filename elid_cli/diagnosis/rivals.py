"""What explains a log as well as an effect that was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.effect_errors import standard_errors
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.result import FoundEffect, Rival
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.encoder_skew import Skew
from elid_cli.diagnosis.search.other_forms import moved_between
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.diagnosis.search.steps import Step
from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.model.effects.posed import turns_model
from elid_cli.robot.robot import Robot


def rivals_of_skews(robot: Robot, skews: Sequence[Skew]) -> tuple[Rival, ...]:
    """Return what the torques like as well as a skew that the positions show."""
    named = effect_that(corrects="link").name
    return tuple(
        Rival(name, robot.joint_names[skew.joint], named, skew.share, values, effect_classes()[name].record)
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
    for number, (step, effect) in enumerate(zip(steps, effects, strict=True), start=declared):
        own = state.effects[number]
        for twin in type(own).same_here(state.scene, own.joint, effect.parameters):
            kind = effect_classes()[twin.effect]
            place = (twin.effect, None if kind.whole_robot else robot.joint_names[twin.joint])
            if place not in named:
                rivals[place] = Rival(*place, effect.effect, effect.gain, dict(twin.values), kind.record)
        for candidate in step.rivals:
            joint = state.joint_of(candidate.effect)
            key = (candidate.effect.name, joint)
            if key in named or key in rivals:
                continue
            ratio = candidate.gain.likelihood / max(step.candidate.gain.likelihood, 1e-9)
            there = _in_its_place(state, number, candidate)
            rivals[key] = Rival(
                candidate.effect.name,
                joint,
                effect.effect,
                effect.gain * min(ratio, 1.0),
                there.values,
                candidate.effect.record,
                there.errors,
                _behind(step.candidate, candidate),
                change=there.change,
                further=there.further,
                moved=there.moved,
            )
    for rival in _together(robot, effects):
        rivals.setdefault((rival.effect, rival.joint), rival)
    return tuple(rivals.values())


def _behind(named: Candidate, rival: Candidate) -> float:
    """Return by how much log-likelihood a rival explains the log worse, independent instants alone counted.

    Both are counted as by the better of them, which leaves noise where the other leaves what it does not explain.
    """
    best = max(named, rival, key=lambda c: c.gain.whole)
    return (named.gain.whole - rival.gain.whole) * best.gain.share


class _InPlace(NamedTuple):
    """A rival's parameters, their standard errors, and what it makes of the base parameters."""

    values: Mapping[str, float]
    errors: Mapping[str, float]
    change: Array | None = None
    further: Array | None = None
    moved: tuple[tuple[str, float], ...] = ()


def _in_its_place(state: State, number: int, rival: Candidate) -> _InPlace:
    """Return what a rival is from a fit with it in the place of effect `number`."""
    lacking = without(state, number)
    log, scene = lacking.log, lacking.scene
    if turns_model(type(rival.effect)):  # begun where it was found: the first step from nothing may lead elsewhere
        log = log.posed(log.pose.moved(rival.effect, np.array(list(rival.values.values()))))
        scene = scene_of(log.model, log.signals, lacking.standard)
    other = refreshed(fit(log, (*lacking.effects, rival.effect), scene, but=lacking.but))
    last = len(other.effects) - 1
    values = other.named(last)
    if not sensible(other.effects[last], other.scene, values):
        return _InPlace(rival.values, {})
    change, moved = moved_between(state, other)
    (_, own, known), (_, there, still) = (one.base_values(state.log.base) for one in (state, other))
    further = np.where(known & still, np.sqrt(np.maximum(there**2 - own**2, 0.0)), 0.0)
    return _InPlace(values, standard_errors(other, last), change, further, moved)


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
