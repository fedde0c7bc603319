"""What explains a log as well as an effect that was found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Required, TypedDict

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.effect_errors import standard_errors
from elid_cli.diagnosis.evidence.held_out import held_out_share
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.result import FoundEffect, Rival
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.encoder_skew import Skew
from elid_cli.diagnosis.search.other_forms import moved_between
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.diagnosis.search.steps import NEAR, NEAR_SHARE, TWIN_SHARE, Step, are_twins
from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.model.effects import effect_classes, effect_that
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
    for number, (step, effect) in enumerate(zip(steps, effects, strict=True), start=declared):
        own = state.effects[number]
        for twin in type(own).same_here(state.scene, own.joint, effect.parameters):
            kind = effect_classes()[twin.effect]
            place = (twin.effect, None if kind.whole_robot else robot.joint_names[twin.joint])
            if place not in named:
                rivals[place] = Rival(
                    *place, effect.effect, effect.gain, dict(twin.values), kind.record, at=effect.joint
                )
        for candidate in step.rivals:
            joint = state.joint_of(candidate.effect)
            key = (candidate.effect.name, joint)
            if key in named or key in rivals:
                continue
            twins = are_twins(step.candidate, candidate)
            there = _in_its_place(state, number, candidate, twins=twins)
            if there is not None:
                rivals[key] = Rival(*key, effect.effect, separate=candidate.effect.record, at=effect.joint, **there)
    for rival in _together(robot, effects):
        rivals.setdefault((rival.effect, rival.joint), rival)
    return tuple(rivals.values())


class _InPlace(TypedDict, total=False):
    """What a rival is in the place of the named effect (`Rival`)."""

    gain: Required[float]
    behind: Required[float]
    parameters: Required[Mapping[str, float]]
    std_error: Mapping[str, float]
    change: Array
    further: Array
    moved: tuple[tuple[str, float], ...]


def _in_its_place(state: State, number: int, rival: Candidate, *, twins: bool) -> _InPlace | None:
    """Return what a rival is from a fit with it in the place of effect `number`; None where it does not explain that.

    It came as near as that beside what was known when the effect was found. What it explained then may have been
    another effect's, which is in the model now: it must come as near again, `twins` as near as twins do.
    """
    lacking = without(state, number)
    log, scene = lacking.log, lacking.scene
    if turns_model(type(rival.effect)):  # begun where it was found: the first step from nothing may lead elsewhere
        log = log.posed(log.pose.moved(rival.effect, np.array(list(rival.values.values()))))
        scene = scene_of(log.model, log.signals, lacking.standard)
    other = refreshed(fit(log, (*lacking.effects, rival.effect), scene, but=lacking.but))
    last = len(other.effects) - 1
    gain, behind, worth = _explained(lacking, state, other, number), _behind(state, other), _behind(state, lacking)
    near = behind < max(NEAR, NEAR_SHARE * worth) or (twins and behind < (1.0 - TWIN_SHARE) * worth)
    if gain is None or not (near and behind < (1.0 - MOST) * max(worth, 0.0)):
        return None
    told, values = _InPlace(gain=gain, behind=behind, parameters=rival.values), other.named(last)
    if not sensible(other.effects[last], other.scene, values):
        return told
    change, moved = moved_between(state, other)
    (_, own, known), (_, there, still) = (one.base_values(state.log.base) for one in (state, other))
    further = np.where(known & still, np.sqrt(np.maximum(there**2 - own**2, 0.0)), 0.0)
    errors = standard_errors(other, last)
    return told | _InPlace(
        gain=gain, behind=told["behind"], parameters=values, std_error=errors, change=change, further=further,
        moved=moved,
    )  # fmt: skip


def _behind(state: State, other: State) -> float:
    """Return by how much log-likelihood another model explains the log worse, independent equations alone counted."""
    counts = {row: float(np.count_nonzero(state.log.training.group(row).use)) for row in state.triangles.rows}
    ratios = {row: max(other.rms(row), 1e-300) / max(state.rms(row), 1e-300) for row in counts}
    worse = sum(count * float(np.log(ratios[row])) for row, count in counts.items())
    return state.projected.independent * worse


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
