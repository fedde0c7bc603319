"""What effects are worth where identification fits: at its own cut-off.

A search looks at faster changes than identification fits, for many effects show there. One that helps there alone, and
makes what identification predicts worse, would spoil the parameters: the quarters judge it once more, all filtered as
identification filters the log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from elid_cli.diagnosis.evidence.quarters import Survival, left_out, survival
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State, agreed, fit, scene_in
from elid_cli.diagnosis.search.candidate import FOLDS_LOST
from elid_cli.diagnosis.search.steps import Found, dropped
from elid_cli.errors import DataError
from elid_cli.estimation.cutoff import at_best_cutoff
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.stretches import search_folds
from elid_cli.signals.signals import Signals

SLIGHT = 0.005
"""Part of the squared error of all quarters together that is lost from which an effect makes the prediction worse,
though no quarter alone can tell."""
HELPS = 0.05
"""The same that it must take away where one quarter is worse for it: at that cut-off little of it may show, and all
quarters have spoken for it at the search's."""


def helpful_there(found: Found, declared: int, usual: Callable[[], Signals]) -> tuple[Found, tuple[Survival, ...]]:
    """Return the outcome without effects that make what identification predicts worse, and what they were worth.

    Parameters
    ----------
    found
        What the search found.
    declared
        How many of the state's effects, the first ones, are not named.
    usual
        Returns the log as identification takes it.
    """
    if not found.steps:
        return found, ()
    raw = _as_identified(found.after.log, usual())
    if raw is None:
        return found, ()
    gone: list[Survival] = []
    while found.steps:
        try:
            state = _there(found.after, raw)
        except DataError:  # too short for that cut-off
            break
        fits = left_out(state)
        told = [survival(state, declared + k, fits) for k in range(len(found.steps))]
        failing = [k for k, item in enumerate(told) if _refuted(item)]
        if not failing:
            break
        worst = min(failing, key=lambda k: told[k].whole)
        after, steps = dropped(found.after, found.steps, declared, worst)
        found = replace(found, after=after, steps=tuple(steps))
        gone.append(replace(told[worst], cutoff=raw.filter.cutoff))
    return found, tuple(gone)


def _refuted(told: Survival) -> bool:
    """Whether quarters speak against an effect: several, one that it takes little of the others' error for, or all."""
    lost = sum(told.lost)
    return lost > FOLDS_LOST or told.whole < (HELPS if lost else -SLIGHT)


def _as_identified(log: Log, usual: Signals) -> Signals | None:
    """Return signals at the cut-off that identification chooses, or None where it is no lower than the search's."""
    cutoff = at_best_cutoff(log.model, log.base, usual, EstimateOptions())[0].filter.cutoff
    if cutoff >= log.signals.filter.cutoff or len(usual.motion.t) != len(log.signals.motion.t):
        return None
    return usual if cutoff == usual.filter.cutoff else usual.refiltered(cutoff)


def _there(state: State, raw: Signals) -> State:
    """Return a state fitted to the same log at another cut-off, with its effects in the shapes that they have."""
    log = replace(state.log, raw=raw).shifted(state.log.shifts)
    log = replace(log, fold=search_folds(log.observation.instants, others=log.others))
    return agreed(fit(log, state.effects, scene_in(log, state), but=state.but))
