"""The instant of a change, to a sample, also where the search does not look.

The search sees the training stretches only. Where a change (the start of a payload) lies within a held-out stretch, any
instant there fits them equally well, and what is named or refuted by the held-out data hangs on one that was never
looked for. The instant is taken from the whole log therefore, the held-out stretch too; everything else stays as
fitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.steps import Found
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.stretches import spans
from elid_cli.model.effects.effect import Effect

INSTANT = "start"
"""Name of the shape that is the instant of a change."""
BESIDE = 0.1
"""Distance from a held-out stretch, s, up to which an instant counts as within it, and is looked for around one."""
WALKS = 5
"""Most times that an instant is looked for again, around one that is far from where it was."""
TRIED, CLOSER = 21, 9
"""Instants that are tried in a stretch, and then around the best of them."""


def retimed(found: Found, declared: int) -> Found:
    """Return the outcome of a search with the instants of changes to a sample, by the whole log."""
    state = found.after
    for number in range(declared, len(state.effects)):
        state = timed(state, number)
    return found if state is found.after else replace(found, after=refreshed(state))


def timed(state: State, number: int) -> State:
    """Return the state with the instant of effect `number`, if it has one, to a sample.

    It is looked for near where it was found, or in the held-out stretch around that. Whether a change is worth its
    parameters is asked of it so as well: filters spread what happens at the edge of a held-out stretch over rows on
    both sides, and at a wrong instant these would speak against it, or for others.
    """
    effect = state.effects[number]
    place = next((k for k, p in enumerate(effect.shapes) if p.name == INSTANT and effect.local), None)
    if place is None:
        return state
    gaps = spans(state.log.observation.t, state.log.fold < 0)
    for _ in range(WALKS):
        found = float(state.effects[number].shape[place])
        first, last = _around(gaps, found) or (found, found)
        state = _best(state, number, place, (first - BESIDE, last + BESIDE))
        if abs(float(state.effects[number].shape[place]) - found) < BESIDE:
            break
    return state


def _best(state: State, number: int, place: int, between: tuple[float, float]) -> State:
    """Return the state with an effect's change at the instant within a span, s, that fits best, to one sample."""
    tried, (first, last) = TRIED, between
    while True:
        instants = np.linspace(first, last, tried)
        state = min((state, *(_moved(state, number, place, float(t)) for t in instants)), key=unlikely)
        step = float(instants[1] - instants[0])
        if step <= state.log.signals.dt:
            return state
        best = float(state.effects[number].shape[place])
        tried, first, last = CLOSER, best - step, best + step


def _around(gaps: tuple[tuple[float, float], ...], t: float) -> tuple[float, float] | None:
    return next((gap for gap in gaps if gap[0] - BESIDE <= t <= gap[1] + BESIDE), None)


def _moved(state: State, number: int, place: int, t: float) -> State:
    """Return the state fitted anew with an effect's change at another instant."""
    effects: list[Effect] = list(state.effects)
    shape = list(effects[number].shape)
    shape[place] = t
    effects[number] = type(effects[number])(effects[number].joint, shape)
    return fit(state.log, effects, state.scene)


def cost(state: State) -> float:
    """Return the squared residual of the whole log in units of the noise floor."""
    return sum(count * square / floor**2 for count, square, floor in _left(state))


def unlikely(state: State) -> float:
    """Return the negative log-likelihood of the whole log, of rows whose noise is what they leave, or the floor.

    While other effects are missing, some rows leave many times the noise: in units of the floor they would decide.
    """
    return sum(0.5 * count * float(np.log(max(square, floor**2))) for count, square, floor in _left(state))


def _left(state: State) -> Iterator[tuple[int, float, float]]:
    """Yield of every row the number of its instants, its mean squared residual and its noise floor."""
    left = residuals(state.log.observation, state.solution.values, state.extras)
    for group in state.log.observation.groups:
        values = left[group.row][group.use]
        if len(values):
            yield len(values), float(values @ values) / len(values), max(state.floor.rms.get(group.row, 0.0), 1e-9)
