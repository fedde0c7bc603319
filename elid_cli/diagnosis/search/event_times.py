"""The instant of a change that falls where the search does not look.

The search sees the training stretches only. Where a change (the start of a payload) lies within a held-out stretch, any
instant there fits them equally well, and what is named or refuted by the held-out data hangs on one that was never
looked for. There, and there only, the instant is taken from the held-out stretch; everything else stays as fitted.
"""

from __future__ import annotations

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
"""Distance from a held-out stretch, s, up to which an instant counts as within it."""
TRIED, CLOSER = 21, 9
"""Instants that are tried in a stretch, and then around the best of them."""


def retimed(found: Found, declared: int) -> Found:
    """Return the outcome of a search with the instants of changes within held-out stretches taken from these."""
    state = found.after
    gaps = spans(state.log.observation.t, state.log.fold < 0)
    changed = False
    for number in range(declared, len(state.effects)):
        effect = state.effects[number]
        place = next((k for k, p in enumerate(effect.shapes) if p.name == INSTANT and effect.local), None)
        gap = None if place is None else _around(gaps, float(effect.shape[place]))
        if place is None or gap is None:
            continue
        state = _best(state, number, place, (gap[0] - BESIDE, gap[1] + BESIDE))
        changed = True
    return replace(found, after=refreshed(state)) if changed else found


def _best(state: State, number: int, place: int, between: tuple[float, float]) -> State:
    """Return the state with an effect's change at the instant within a span, s, that fits best, to one sample."""
    tried, (first, last) = TRIED, between
    while True:
        instants = np.linspace(first, last, tried)
        state = min((state, *(_moved(state, number, place, float(t)) for t in instants)), key=cost)
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
    left = residuals(state.log.observation, state.solution.values, state.extras)
    total = 0.0
    for group in state.log.observation.groups:
        values = left[group.row][group.use]
        total += float(values @ values) / max(state.floor.rms.get(group.row, 0.0), 1e-9) ** 2
    return total
