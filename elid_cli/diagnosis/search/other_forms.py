"""Other forms of an effect that was found: friction that fades by another law, a coupling with another joint.

Which form is right is a matter of a few units of log-likelihood at times, and then the log cannot say: friction that
falls from standstill and friction that rises towards it from what a lower Coulomb friction leaves are the same curve
within the noise. What the forms make of the other parameters differs by far more than the standard errors of any.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.result import OtherForm
from elid_cli.diagnosis.search.acceptance import left_behind
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.forward import with_refined_shapes
from elid_cli.diagnosis.search.refitted_forms import fits_as_well, in_form, refitted
from elid_cli.diagnosis.search.screening import form_of, refined, score, sensible
from elid_cli.diagnosis.search.steps import Found

ALIKE = 6.0
"""Log-likelihood by which another form may explain a log worse and still be told …"""
PART = 0.04
"""… or by this part of what the effect gains: motion near standstill, where forms differ, is the least well known."""
NEAR = 0.25
"""Part of what the effect gains up to which forms of friction are fitted, which may fit better than they score."""
USUAL = 2.0
"""Log-likelihood up to which a more usual form is named instead."""
MOVED = 2.0
"""Standard errors by which it must move a parameter for that to be told."""


def with_usual_forms(found: Found, declared: int) -> Found:
    """Return the outcome with effects in a more usual form where that explains the log as well.

    Parameters
    ----------
    found
        The outcome of a search.
    declared
        How many of the state's effects, the first ones, are not named.
    """
    state, steps = found.after, list(found.steps)
    for number in _chosen(found, declared):
        if not type(state.effects[number]).usual_first:
            continue
        own, others = _forms(state, number)
        if own is None:
            continue
        chosen = _usual(state, number, own, others)
        if chosen is not None:
            form, other = chosen
            state = with_refined_shapes(other, declared)
            step = steps[number - declared]
            steps[number - declared] = replace(step, candidate=replace(form, choice=step.candidate.choice))
    return found if state is found.after else replace(found, after=state, steps=tuple(steps))


def other_forms(found: Found, declared: int) -> dict[int, tuple[OtherForm, ...]]:
    """Return, by the number of the effect, the other forms that explain the log about as well, the nearest first."""
    state, told = found.after, dict[int, tuple[OtherForm, ...]]()
    for number in _chosen(found, declared):
        own, others = _forms(state, number)
        if own is None:
            continue
        alike = max(ALIKE, PART * own.gain.likelihood)
        near = [(form, *at) for form in others if (at := _near(state, number, own, form, alike)) is not None]
        forms = [
            _told(state, other, number, behind)
            for _, other, behind in sorted(near, key=lambda item: item[2])
            if sensible(other.effects[number], other.scene, other.named(number))
        ]
        if forms:
            told[number] = tuple(forms)
    return told


def _usual(state: State, number: int, own: Candidate, others: Sequence[Candidate]) -> tuple[Candidate, State] | None:
    """Return the most usual form that explains the log as well as an effect's own, with the model in it; None: none."""
    order = _order(state, number)
    place = order.index(form_of(own.effect))
    usual = [c for c in others if order.index(form_of(c.effect)) < place]
    for form in sorted(usual, key=lambda c: order.index(form_of(c.effect))):
        if _behind(own, form) < USUAL:
            other = in_form(state, number, form.effect)
            if sensible(other.effects[number], other.scene, other.named(number)):
                return form, other
            continue
        fitted = _fitted(state, number, own, form)
        if fitted is not None and fits_as_well(state, fitted, number, USUAL):
            return form, fitted
    return None


def _near(state: State, number: int, own: Candidate, form: Candidate, alike: float) -> tuple[State, float] | None:
    """Return the model in another form, and how far it is behind, where that is less than `alike`, fitted or scored."""
    scored = _behind(own, form)
    fitted = _fitted(state, number, own, form)
    if fitted is not None and (behind := left_behind(state, fitted)) < alike:
        return fitted, min(scored, behind)
    return (in_form(state, number, form.effect), scored) if scored < alike else None


def _fitted(state: State, number: int, own: Candidate, form: Candidate) -> State | None:
    """Return the model in another form of a friction as it fits best, where that may be worth it."""
    if not type(form.effect).usual_first or _behind(own, form) > max(ALIKE, NEAR * own.gain.likelihood):
        return None
    return refitted(state, number, form.effect)


def _chosen(found: Found, declared: int) -> Iterator[int]:
    """Yield the numbers of the effects whose form was a choice, and is not one of a curve of several terms.

    None of a model that a collocation fitted: the fits of other forms would not be comparable.
    """
    effects = found.after.effects if found.after.known is None and not found.partial else ()
    places = [(e.name, e.joint) for e in effects]
    for number in range(declared, min(declared + len(found.steps), len(effects))):
        alone = places.count(places[number]) == 1 and number not in found.terms
        if alone and len(form_of(effects[number])) > 0:
            yield number


def _order(state: State, number: int) -> list[tuple[float, ...]]:
    """Return the forms of an effect in the order of its grid."""
    kind, joint = type(state.effects[number]), state.effects[number].joint
    return list(dict.fromkeys(form_of(kind(joint, shape)) for shape in kind.grid(state.scene, joint)))


def _forms(state: State, number: int) -> tuple[Candidate | None, list[Candidate]]:
    """Return an effect as it is and in its other forms, each in its best shape, as the model without it scores them."""
    lacking, effect = without(state, number), state.effects[number]
    own = score(lacking, effect, 1, 1)
    if own is None:
        return None, []
    kind, mine = type(effect), form_of(effect)
    tried: dict[tuple[float, ...], list[Candidate]] = {}
    for shape in kind.grid(lacking.scene, effect.joint):
        candidate = score(lacking, kind(effect.joint, shape), 1, 1)
        if candidate is not None:
            tried.setdefault(form_of(candidate.effect), []).append(candidate)
    best = {form: max(candidates, key=lambda c: c.rank) for form, candidates in tried.items()}
    others = [refined(lacking, candidate) for form, candidate in best.items() if form != mine]
    return refined(lacking, own), [c for c in others if c.plausible]


def _behind(own: Candidate, other: Candidate) -> float:
    """Return by how much log-likelihood a form explains the log worse than the one that was found."""
    best = max(own, other, key=lambda c: c.gain.whole)
    return (own.gain.whole - other.gain.whole) * best.gain.share


def _told(state: State, other: State, number: int, behind: float) -> OtherForm:
    """Return what is said of a form, from the models with the effect as it was found and in that form."""
    return OtherForm(other.named(number), behind, *moved_between(state, other))


def moved_between(state: State, other: State) -> tuple[Array, tuple[tuple[str, float], ...]]:
    """Return by how much base parameters differ from one model of a log to another, (b,), and clearly moved ones.

    The latter by name, the most moved first, with their values in the other model.
    """
    base = state.log.base
    before, errors, known = state.base_values(base)
    after, _, still = other.base_values(base)
    change = np.where(known & still, after - before, 0.0)
    sizes = np.abs(change) / np.maximum(errors, 1e-300)
    order = [k for k in np.argsort(-sizes) if sizes[k] > MOVED]
    return change, tuple((str(base.names[k]), float(after[k])) for k in order)
