"""Effects that did as well in a linear step, each tried in the place of the one that was taken.

A linear step is of the motion without the effect, and forgives shapes that are not quite right. What is left once the
motion follows decides: an effect that leaves clearly more in every block of time cannot be what the robot has.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.candidates import Candidate
from elid_cli.diagnosis.by_motion.held_out import MORE
from elid_cli.diagnosis.by_motion.refits import in_place
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.estimation.trajectory.fit import TrajectoryFit


def with_rivals(fit: TrajectoryFit, named: Sequence[Named], declared: int) -> tuple[TrajectoryFit, list[Named], bool]:
    """Return the fit and its effects with the rivals that do as well, and whether a rival took an effect's place.

    Parameters
    ----------
    fit
        The fit with the effects of `named`, after as many that are `declared`.
    named
        What the search took, with rivals by screening.
    declared
        Number of effects that the robot declares.
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
            if its is not None and clearly_more(mine, its) and its.sum() < least.get(k, np.inf):
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
    """Return the fit and its effects, of which new ones, by name and joint, are in the form that does clearly best."""
    asked = {k for k, item in enumerate(named) if (item.effect.name, item.effect.joint) in new}
    forms = [replace(item, rivals=item.forms if k in asked else ()) for k, item in enumerate(named)]
    if not any(item.rivals for item in forms):
        return fit, list(named)
    found, better, swapped = with_rivals(fit, forms, declared)
    if not swapped:
        return fit, list(named)
    return found, [
        replace(item, effect=own.effect, gain=own.gain, helped=own.helped)
        for item, own in zip(named, better, strict=True)
    ]


def clearly_more(error: Array, other: Array) -> bool:
    """Whether a squared error (B,) is clearly more than another one, and more in every block of time."""
    return bool(error.sum() > MORE * other.sum() and (error > other).all())


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
