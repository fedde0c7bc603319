"""One effect in the place of two.

A search that adds the best effect step by step can end with two that together imitate one: shapes and the columns that
come from the model's own torques are only right once the right effect is in. Two effects are named only if no single
one with fewer parameters does as well on data that did not fit it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations

from elid_cli.diagnosis.evidence.held_out import held_out_gain, held_out_share
from elid_cli.diagnosis.evidence.quarters import left_out, survival
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import left_out_error, touched
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.screening import screen, sensible
from elid_cli.diagnosis.search.steps import Found, Step
from elid_cli.model.effects.effect import Effect

AS_WELL = 0.02
"""Part by which the left-out error of one may be larger for it to do as well as two."""
TRIED = 3
"""Candidates of the screening that are fitted in full."""


def with_one_for_two(found: Found, declared: int, library: Mapping[str, type[Effect]]) -> Found:
    """Return the outcome with every pair of effects replaced by a single one that does as well.

    Parameters
    ----------
    found
        What the search found.
    declared
        How many of the state's effects, the first ones, are not named.
    library
        Effects to try.
    """
    while (better := _replaced(found, declared, library)) is not None:
        found = better
    return found


def _replaced(found: Found, declared: int, library: Mapping[str, type[Effect]]) -> Found | None:
    """Return the outcome with one pair replaced, or None where no single effect does as well."""
    for one, two in _pairs(found):
        lacking = refreshed(without(without(found.after, declared + two), declared + one))
        size = sum(found.steps[k].candidate.size for k in (one, two))
        other = _single(found.after, lacking, (declared + one, declared + two), _smaller(library, size))
        if other is None:
            continue
        state, candidate = other
        # what was found before the pair stays before, the single effect comes last
        steps = [step for k, step in enumerate(found.steps) if k not in (one, two)]
        pair = tuple(found.steps[k].candidate for k in (one, two))
        rivals = tuple(c for c in pair if c.key != candidate.key)
        return replace(found, after=state, steps=(*steps, Step(candidate, rivals)))
    return None


def _pairs(found: Found) -> Iterator[tuple[int, int]]:
    """Yield numbers of steps whose effects act in the same rows; what acts for a moment is another matter."""
    for (k, one), (m, other) in combinations(enumerate(found.steps), 2):
        effects = one.candidate.effect, other.candidate.effect
        if any(effect.local or effect.in_deflection or effect.quasi_static for effect in effects):
            continue
        if one.candidate.columns.rows.keys() & other.candidate.columns.rows.keys():
            yield k, m


def _smaller(library: Mapping[str, type[Effect]], size: int) -> dict[str, type[Effect]]:
    """Return the effects of the library that have fewer parameters than a number, and are none of a moment."""
    return {
        name: kind
        for name, kind in library.items()
        if not kind.local and len(kind.amplitudes) + sum(not p.fixed for p in kind.shapes) < size
    }


def _single(
    both: State, lacking: State, numbers: tuple[int, int], library: Mapping[str, type[Effect]]
) -> tuple[State, Candidate] | None:
    """Return the state with one effect in the place of two that does as well, and that effect."""
    rows = touched(lacking, both, [row for number in numbers for row in both.columns[number].rows])
    joints = {both.effects[number].joint for number in numbers}
    able = [c for c in screen(lacking, library, joints=joints) if c.supported and c.columns.rows.keys() & set(rows)]
    for candidate in sorted(able, key=lambda c: -c.gain.whole)[:TRIED]:
        state = refreshed(fit(lacking.log, (*lacking.effects, candidate.effect), lacking.scene, but=lacking.but))
        last = len(state.effects) - 1
        effect = state.effects[last]
        if not sensible(effect, state.scene, state.named(last)) or not state.impossible <= both.impossible:
            continue
        # with rows that the one makes worse, through parameters that they share with those that it acts on
        judges = [*rows, *(row for row in touched(state, both, ()) if row not in rows)]
        if left_out_error(state, both, judges) > (1 + AS_WELL) * left_out_error(both, both, judges):
            continue
        if held_out_share(both, state, judges) < -AS_WELL or held_out_gain(state, last) < effect.least_gain:
            continue
        if survival(state, last, left_out(state)).survives:
            return state, candidate
    return None
