"""Limits of a motor's torque: whether one is plausible is told by a fit that knows it.

A limit that cuts many of the largest torques bends the parameters of a fit without it so far that what this predicts
beyond the limit says nothing of what was delivered there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.screening import sensible

NET = 40.0
"""Net gain from which a limit that seems implausible is fitted: the torque beyond it explains what follows it."""


def judged_by_fit(state: State, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates with limits counted as plausible where they are so to a fit that knows them.

    Parameters
    ----------
    state
        The model in which they were tried.
    candidates
        What the screening found.
    """
    return [replace(c, plausible=True) if _fits(state, c) else c for c in candidates]


def _fits(state: State, candidate: Candidate) -> bool:
    if candidate.effect.of_drive != "limit" or candidate.plausible or candidate.net <= NET:
        return False
    grown = refreshed(fit(state.log, (*state.effects, candidate.effect), state.scene))
    last = len(grown.effects) - 1
    return sensible(grown.effects[last], grown.scene, grown.named(last)) and grown.impossible <= state.impossible
