"""Other forms of effects that were found: friction that fades by another law, as near to the motion as the one taken.

What the forms make of Coulomb and viscous friction differs by far more than the standard errors of any of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.refits import in_place
from elid_cli.diagnosis.by_motion.rivals import clearly_more
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.diagnosis.result import OtherForm
from elid_cli.estimation.regression.other_shapes import REACH
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.found_effects import scene_of_fit
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.robot.parameter import StandardParameter

MOVED = 2.0
"""Standard errors by which a form must move a parameter that is told of."""
SURE = 4.0
"""Standard errors of their mean by which blocks of time must be farther off for a form not to be told of."""


@dataclass(frozen=True)
class Forms:
    """The other forms of a fit's effects."""

    told: Mapping[int, tuple[OtherForm, ...]]
    """By the number of the effect among those that were named, the nearest first."""
    shifts: tuple[Array, ...]
    """What each makes of the drive parameters, (n * 4,) each, over the standard errors that an interval reaches."""


def other_forms(fit: TrajectoryFit, named: Sequence[Named]) -> Forms:
    """Return the forms of named effects, the last of a fit's, with which the motion is about as near.

    Parameters
    ----------
    fit
        The fit with the effects of `named`, after those that the robot declares.
    named
        What the search took, with other forms of it.
    """
    told, shifts = dict[int, tuple[OtherForm, ...]](), list[Array]()
    declared, drives = len(fit.effects) - len(named), fit.unknowns.drives
    for k, item in enumerate(named):
        found = list[tuple[float, OtherForm]]()
        for form in item.forms:
            trial = in_place(fit, {declared + k: form.effect})
            if trial is None or _is_ruled_out(trial, fit, form.effect.joint):
                continue
            values = _values(trial, declared + k)
            if type(form.effect).plausible(scene_of_fit(trial), form.effect.joint, values):
                behind = _behind(trial, fit, form.effect.joint)
                found.append((behind, OtherForm(values, behind, np.zeros(0), _moved(fit, trial))))
                shifts.append((trial.z - fit.z)[:drives] / REACH)
        if found:
            told[k] = tuple(form for _, form in sorted(found, key=lambda pair: pair[0]))
    return Forms(told, tuple(shifts))


def _errors(fit: TrajectoryFit, joint: int) -> Array:
    """Return a joint's squared error in every block of time, (B,)."""
    found: Array = fit.equations.lighter[:, joint]
    return found


def _is_ruled_out(other: TrajectoryFit, fit: TrajectoryFit, joint: int) -> bool:
    """Whether another form is farther off in every block, clearly so by how much the blocks differ."""
    its, mine = _errors(other, joint), _errors(fit, joint)
    apart = its / np.maximum(mine, 1e-300) - 1.0
    blocks = len(apart)
    sure = blocks > 1 and apart.mean() > SURE * apart.std(ddof=1) / np.sqrt(blocks)
    return clearly_more(its, mine) or bool(sure and (apart > 0).all())


def _behind(other: TrajectoryFit, fit: TrajectoryFit, joint: int) -> float:
    """Return by how much log-likelihood another form is less near, of blocks of time as the only independent errors."""
    its, mine = _errors(other, joint), _errors(fit, joint)
    return float(0.5 * np.sum(np.log(np.maximum(its, 1e-300) / np.maximum(mine, 1e-300))))


def _values(fit: TrajectoryFit, place: int) -> Mapping[str, float]:
    effect = fit.effects[place]
    return effect.named(scene_of_fit(fit), fit.z[fit.unknowns.amplitudes_of(place)])


def _moved(fit: TrajectoryFit, other: TrajectoryFit) -> tuple[tuple[str, float], ...]:
    """Return the drive parameters that another form moves clearly, the most first, with their values in it."""
    drives = fit.unknowns.drives
    places = [(len(KINDS) * joint + k, StandardParameter(kind, joint))
              for joint in range(fit.unknowns.robot.n) for k, kind in enumerate(PARAMETERS)]  # fmt: skip
    errors = np.sqrt(np.maximum(np.diag(fit.covariance)[:drives], 0.0))
    sizes = np.abs((other.z - fit.z)[:drives]) / np.maximum(errors, 1e-300)
    order = sorted(places, key=lambda pair: -sizes[pair[0]])
    return tuple((str(name), float(other.z[k])) for k, name in order if sizes[k] > MOVED and errors[k] > 0)
