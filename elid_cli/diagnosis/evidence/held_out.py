"""What an effect is worth on the stretches that the search never sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.diagnosis.search.steps import Found, dropped
from elid_cli.estimation.regression.triangles import Triangles, to_triangles
from elid_cli.model.regressor import EstimationRow


def held_out_triangles(state: State) -> Triangles:
    """Return the triangles of the held-out stretches with the state's columns."""
    log = state.log
    return to_triangles(log.observation.only(log.fold < 0), state.extras)


def held_out_gain(state: State, number: int) -> float:
    """Return the part of the held-out residual variance that effect `number` takes away in its rows."""
    lacking = without(state, number)
    return held_out_share(lacking, state, touched(lacking, state, state.columns[number].rows))


def held_out_share(lacking: State, state: State, rows: Sequence[EstimationRow]) -> float:
    """Return the part of the held-out residual variance in some rows that a state takes away from a lacking one."""
    outside, inside = held_out_triangles(lacking), held_out_triangles(state)
    # rows are compared in units of their noise floor, or the noisier row would hide what the quieter one shows
    weight = {r: max(state.floor.rms[r], 1e-4 * state.triangles.torque_rms(r)) ** -2 for r in rows}
    before = sum(weight[r] * t.squares(lacking.solution.values) for r in rows for t in outside.of(r))
    after = sum(weight[r] * t.squares(state.solution.values) for r in rows for t in inside.of(r))
    return 1.0 - after / before if before > 0 else 0.0


def still_helping(found: Found, declared: int, judged: State) -> Found:
    """Return the outcome without effects that held-out stretches are predicted no worse without.

    They were supported when they were judged, but what was found since can leave nothing of them. What acts for a
    moment need not show there, and what parameters absorb shows there too little.

    Parameters
    ----------
    found
        What was found.
    declared
        How many of its effects, the first ones, have no step.
    judged
        The model in which every effect was judged last: nothing is asked where it stands.
    """
    asking = found.after is not judged
    while asking:
        asked = [k for k, step in enumerate(found.steps) if not (step.candidate.effect.local or step.absorbed)]
        gains = {k: held_out_gain(found.after, declared + k) for k in asked}
        worst = min(asked, key=lambda k: gains[k], default=None)
        asking = worst is not None and gains[worst] <= 0
        if worst is not None and asking:
            gone = found.steps[worst].candidate
            state, steps = dropped(found.after, found.steps, declared, worst)
            found = replace(found, after=state, steps=tuple(steps), remaining=(gone, *found.remaining))
    return found
