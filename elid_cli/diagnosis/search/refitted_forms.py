"""Forms of an effect compared as they fit, by least squares as all results are, on the data that did not fit them too.

The search scores a form by columns that are whitened. Whitening makes the most of what varies quickest, and next to a
reversal that is what splines and filter round off, not the law of the friction: the shape that scores best there may
be far from the one that fits best, and another law than the true one ahead of it.
"""

from __future__ import annotations

from elid_cli.diagnosis.evidence.held_out import held_out_share
from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.acceptance import left_behind
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.estimation.regression.effect_shapes import fit_declared
from elid_cli.model.effects.declared import Declared
from elid_cli.model.effects.effect import Effect
from elid_cli.robot.robot import EffectSpec


def in_form(state: State, number: int, effect: Effect) -> State:
    """Return the model with an effect in another form."""
    effects = [*state.effects[:number], effect, *state.effects[number + 1 :]]
    return refreshed(fit(state.log, effects, state.scene, but=state.but))


def refitted(state: State, number: int, effect: Effect) -> State | None:
    """Return the model with an effect in another form, all shapes as they fit best; None where that is not sensible."""
    effects = [*state.effects[:number], effect, *state.effects[number + 1 :]]
    items = [Declared(EffectSpec(e.name, None), e) for e in effects]
    log, weights = state.log, state.solution.weights
    found = fit_declared(log.training, log.signals, state.scene, items, weights, state.nuisances, scan=False)
    other = refreshed(fit(log, [item.effect for item in found.effects], state.scene, but=state.but))
    return other if sensible(other.effects[number], other.scene, other.named(number)) else None


def fits_as_well(state: State, other: State, number: int, alike: float) -> bool:
    """Whether another form fits as well, to some log-likelihood, and predicts held-out stretches better."""
    rows = [row for row in state.columns[number].rows if row in state.triangles.rows]
    return left_behind(state, other) < alike and held_out_share(state, other, rows) > 0
