"""Effects that did as well in a linear step, each tried in the place of the one that was taken.

A linear step is of the motion without the effect, and forgives shapes that are not quite right. What is left once the
motion follows decides: an effect that leaves clearly more in every block of time cannot be what the robot has.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.candidates import Candidate
from elid_cli.diagnosis.by_motion.held_out import MORE
from elid_cli.diagnosis.by_motion.refits import in_place
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects.effect import Effect

USUAL = 1.02
"""Times the squared error up to which the usual form of an effect is named instead of another."""


def clearly_more(error: Array, other: Array) -> bool:
    """Whether a squared error (B,) is clearly more than another one, and more in every block of time."""
    return bool(error.sum() > MORE * other.sum() and (error > other).all())


def _is_clearly_better(item: Named, rival: Candidate, mine: Array, its: Array) -> bool:
    return clearly_more(mine, its)


def _is_better_form(item: Named, form: Candidate, mine: Array, its: Array) -> bool:
    """Whether an effect in another form is nearer in every block of time, or the usual form is about as near."""
    usual = _is_usual(form.effect) and not _is_usual(item.effect) and its.sum() < USUAL * mine.sum()
    return bool(usual or (mine > its).all())


def _is_usual(effect: Effect) -> bool:
    """Whether an effect is in its usual form, if it has one: the one that is meant where none is said."""
    fixed = [(value, p.default) for value, p in zip(effect.shape, effect.shapes, strict=True) if p.fixed]
    return effect.usual_first and all(value == default for value, default in fixed)


def with_rivals(
    fit: TrajectoryFit,
    named: Sequence[Named],
    declared: int,
    is_better: Callable[[Named, Candidate, Array, Array], bool] = _is_clearly_better,
) -> tuple[TrajectoryFit, list[Named], bool]:
    """Return the fit and its effects with the rivals that do as well, and whether a rival took an effect's place.

    Parameters
    ----------
    fit
        The fit with the effects of `named`, after as many that are `declared`.
    named
        What the search took, with rivals by screening.
    declared
        Number of effects that the robot declares.
    is_better
        Whether a rival takes an effect's place, by their squared errors, (B,): first the effect's.
    """
    left = {k: list[Candidate]() for k in range(len(named))}
    better: dict[int, Candidate] = {}
    least: dict[int, float] = {}
    before = fit.equations.lighter
    for chosen in _turns(named):
        trial = in_place(fit, {declared + k: rival.effect for k, rival in chosen.items()})
        for k, rival in chosen.items():
            joint = rival.effect.joint
            mine, its = before[:, joint], None if trial is None else trial.equations.lighter[:, joint]
            if its is None or not clearly_more(its, mine):
                left[k].append(rival)
            if its is not None and is_better(named[k], rival, mine, its) and its.sum() < least.get(k, np.inf):
                better[k], least[k] = rival, float(its.sum())
    result = [replace(item, rivals=tuple(left[k])) for k, item in enumerate(named)]
    found = in_place(fit, {declared + k: rival.effect for k, rival in better.items()}) if better else None
    if found is None:
        return fit, result, False
    for k, rival in better.items():
        others = tuple(c for c in result[k].rivals if c is not rival)
        result[k] = Named(rival.effect, rival.gain, rival.helped, others)
    return found, result, True


def in_best_forms(
    fit: TrajectoryFit, named: Sequence[Named], new: Collection[tuple[str, int]], declared: int
) -> tuple[TrajectoryFit, list[Named]]:
    """Return the fit and its effects, of which new ones, by name and joint, are in the form that does best.

    A form costs nothing: one with which every block of time is nearer takes the place of another, and the usual one
    where it is about as near.
    """
    asked = {k for k, item in enumerate(named) if (item.effect.name, item.effect.joint) in new}
    forms = [replace(item, rivals=item.forms if k in asked else ()) for k, item in enumerate(named)]
    if not any(item.rivals for item in forms):
        return fit, list(named)
    found, better, _ = with_rivals(fit, forms, declared, _is_better_form)
    return found, [
        item if k not in asked
        else replace(item, forms=own.rivals) if own.effect is item.effect
        else _in_form(item, own, fit.z[fit.unknowns.amplitudes_of(declared + k)])
        for k, (item, own) in enumerate(zip(named, better, strict=True))
    ]  # fmt: skip


def _in_form(item: Named, own: Named, amplitudes: Array) -> Named:
    """Return an effect in another form of its own, with the one that it had among its forms."""
    before = Candidate(item.effect, item.gain, item.helped, amplitudes)
    return replace(item, effect=own.effect, gain=own.gain, helped=own.helped, forms=(before, *own.rivals))


def _turns(named: Sequence[Named]) -> Iterator[dict[int, Candidate]]:
    """Yield rivals by the number of what they replace: every one once, at most one of a joint at a time."""
    waiting = [(k, rival) for k, item in enumerate(named) for rival in item.rivals]
    while waiting:
        taken: dict[int, tuple[int, Candidate]] = {}
        for k, rival in waiting:
            taken.setdefault(rival.effect.joint, (k, rival))
        yield dict(taken.values())
        done = {id(rival) for _, rival in taken.values()}
        waiting = [(k, rival) for k, rival in waiting if id(rival) not in done]
