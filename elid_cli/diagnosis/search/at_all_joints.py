"""Effects that every joint has where one has it, and that look alike at joints which move together.

Of transmissions that yield the search names the one that explains most, and what others do as well goes into its value.
All of them together have values and standard errors that are right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.diagnosis.search.steps import Found, Step


def at_all_joints(found: Found, known: int) -> Found:
    """Return the outcome with such effects at all joints where they are possible; at most the first `known` are kept.

    Parameters
    ----------
    found
        What the search found.
    known
        Effects that were there before the search, or stay in any case.
    """
    state, first = found.after, len(found.after.effects)
    kinds = {type(effect) for effect in state.effects[known:] if effect.quasi_static}
    there = {(type(effect), effect.joint) for effect in state.effects}
    robot = state.log.model.robot
    more = [
        kind(k) for kind in kinds for k in range(robot.n) if kind.applies(robot, k) and (kind, k) not in there
    ]  # fmt: skip
    if not more:
        return found
    grown = refreshed(fit(state.log, (*state.effects, *more), state.scene, but=state.but))
    while (worst := _least_possible(grown, first)) is not None:
        fewer = [effect for k, effect in enumerate(grown.effects) if k != worst]
        grown = refreshed(fit(state.log, fewer, grown.scene, but=state.but))
    if len(grown.effects) == first or not all(_possible(grown, k) for k in range(known, first)):
        return found
    first_of = {type(step.candidate.effect): step.candidate for step in found.steps}
    steps = [
        Step(replace(first_of[type(effect)], effect=effect, values=grown.named(k)), ())
        for k, effect in enumerate(grown.effects[first:], first)
    ]
    return replace(found, after=grown, steps=(*found.steps, *steps))


def _possible(state: State, number: int) -> bool:
    return sensible(state.effects[number], state.scene, state.named(number))


def _least_possible(state: State, first: int) -> int | None:
    """Return which of the further effects is impossible, by the largest part of the torque; None where none is."""
    sizes = {}
    for k in range(first, len(state.effects)):
        if not _possible(state, k):
            rows = state.columns[k].rows.values()
            sizes[k] = sum(float(np.sum((state.coefficients(k) @ values) ** 2)) for values in rows)
    return max(sizes, key=lambda k: sizes[k], default=None)
