"""Whether friction turns at once with the direction of motion, or over the width that elid's own simulator has.

Dry friction turns at once. Simulators round it, so that it can be integrated: on their logs columns of effects that
jump with the direction fit worse near standstill than rounded ones.
"""

from __future__ import annotations

from dataclasses import replace

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.event_times import cost
from elid_cli.diagnosis.search.forward import with_refined_shapes
from elid_cli.diagnosis.search.steps import Found

CLEARLY = 0.98
"""Part of the squared residual to which rounded columns must bring it down."""


def with_rounding_that_fits(found: Found, declared: int) -> Found:
    """Return the outcome of a search with friction rounded as simulators do where the log clearly shows that."""
    state = found.after
    if not any(effect.place == "motor" and not effect.of_channel for effect in state.effects):
        return found
    rounded = _rounded(state)
    if not cost(rounded) < CLEARLY * cost(state):
        return found
    return replace(found, after=with_refined_shapes(refreshed(rounded), declared))


def _rounded(state: State) -> State:
    """Return a state fitted anew with its effects' columns rounded."""
    log = state.log
    signals, raw = (replace(one, rounded=True) for one in (log.signals, log.raw))
    scene = replace(state.scene, rounding=None, cache={})
    return fit(replace(log, signals=signals, raw=raw), state.effects, scene)
