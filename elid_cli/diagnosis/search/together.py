"""Effects that are worth their parameters together only.

Where one joint lacks two effects, either alone may leave its rows worse than before: friction that is missing holds the
spring's curve wrong, and the curve the friction. Each is refused then, though both together explain the joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.acceptance import improves, predicted_better, touched
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.diagnosis.search.steps import Step

LEAST_GAIN = 0.5
"""Part of the left-out error of their rows that two such effects must take away together: most of what is missing …"""
EACH = 0.2
"""… and that each must take away beside the other."""
TRIED = 4
"""Refused candidates that are tried with one another."""


def worth_together(state: State, refused: Sequence[Step]) -> tuple[State, list[Step]] | None:
    """Return the state with the two refused candidates that help most together, and their steps; None where none do.

    Parameters
    ----------
    state
        The model in which each of them was tried alone.
    refused
        Steps to candidates that were not worth their parameters in it, the best first.
    """
    best: tuple[float, State, tuple[Step, Step]] | None = None
    able = [step for step in refused if not step.candidate.effect.local and step.candidate.effect.corrects is None]
    for steps in combinations(able[:TRIED], 2):
        pair = steps[0].candidate, steps[1].candidate
        if not pair[0].columns.rows.keys() & pair[1].columns.rows.keys():
            continue
        grown = refreshed(fit(state.log, (*state.effects, *(c.effect for c in pair)), state.scene))
        gain = _gain(state, grown, pair)
        if gain is not None and (best is None or gain > best[0]):
            best = gain, grown, steps
    return None if best is None else (best[1], list(best[2]))


def _gain(state: State, grown: State, pair: tuple[Candidate, Candidate]) -> float | None:
    """Return the part of the left-out error that two effects take away together; None where either is not needed."""
    first = len(state.effects)
    able = all(sensible(grown.effects[k], grown.scene, grown.named(k)) for k in (first, first + 1))
    if not able or not grown.impossible <= state.impossible:
        return None
    own = {row: None for candidate in pair for row in candidate.columns.rows}
    rows = touched(state, grown, own)
    gain = predicted_better(state, grown, rows)
    if gain is None or gain < LEAST_GAIN or not any(improves(state, grown, row) for row in rows):
        return None
    for candidate in pair:
        single = refreshed(fit(state.log, (*state.effects, candidate.effect), state.scene))
        if (predicted_better(single, grown, rows) or 0.0) < EACH:
            return None
    return gain
