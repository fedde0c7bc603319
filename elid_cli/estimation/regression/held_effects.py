"""Standard errors beside effects that a fit holds as they were found, with amplitudes and shapes that have errors.

What is held counts as known in the normal matrix, and the parameters beside it seem as sure as if it were. They are
as unsure as they would be with it known exactly, and move by what its own errors make of them. Where both come from one
log that is the covariance of the fit to all unknowns together: its effects' part, and the rest given the effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.data import Solved
from elid_cli.estimation.regression.covariance import sandwich
from elid_cli.estimation.regression.effect_shapes import SHAPE_SPREAD, shape_columns
from elid_cli.estimation.regression.least_squares import solve
from elid_cli.estimation.regression.long_run import at_least
from elid_cli.estimation.regression.rotor_shares import rotor_columns, rotor_prior
from elid_cli.estimation.regression.standard_errors import few, with_prior
from elid_cli.estimation.regression.triangles import to_triangles
from elid_cli.model.effects.declared import Declared
from elid_cli.robot.robot import EffectSpec

Place = tuple[str, str | None, int]
"""An effect: its name, its joint, and which of several that have both."""


@dataclass(frozen=True)
class HeldErrors:
    """How well effects are known that a fit holds."""

    covariance: Array
    """Of amplitudes, and of the logarithms (values where 0) of shapes that were fitted, (e, e)."""
    places: Mapping[Place, NDArray[np.intp]]
    """Where every effect's amplitudes, then its free shapes, stand in it; -1: exactly known."""


def places_of(specs: Sequence[EffectSpec]) -> list[Place]:
    """Return the places of effects, in their order."""
    keys = [(spec.effect, spec.joint) for spec in specs]
    return [(*key, keys[:number].count(key)) for number, key in enumerate(keys)]


def beside_held(fit: Solved, covariance: Array, held: HeldErrors) -> Array:
    """Return the covariance of a fit's basis, (r, r), that knows how well the effects are known that it holds.

    `covariance` is the one that takes them for known; it stands where the rest is not determined beside them.
    """
    if fit.effects is None:
        return covariance
    amplitudes, width, basis = fit.amplitudes(), fit.triangles.width, fit.solution.basis
    shapes = shape_columns(fit.effects, fit.signals, amplitudes)
    told = rotor_columns(fit.effects, fit.signals, amplitudes)
    rotors = [extra for extra, _ in told.values()]
    extras = [*fit.extras, *shapes, *rotors]
    fixed = np.concatenate([fit.first_amplitude + _held(fit.effects.effects), width + np.arange(len(shapes))])
    own = np.concatenate([basis[~np.isin(basis, fixed)], width + len(shapes) + np.arange(len(rotors))])
    known = np.maximum(rotor_prior(fit.effects.scene, told)[1], 1.0 / SHAPE_SPREAD)
    precision = np.concatenate([np.zeros(len(shapes)), known])
    triangles = with_prior(to_triangles(fit.observation, extras), replace(fit.triangles, prior=None), precision)
    alone = solve(triangles, fit.solution.weights, basis=own.astype(np.intp))
    if len(alone.basis) < len(own):
        return covariance
    # the residual is the fit's, effects and all: what they are counts as known, not that there are none
    whole = replace(alone, values=np.append(fit.solution.values, np.zeros(len(precision))))
    given, system = sandwich(fit.observation, whole, extras), triangles.stacked(fit.solution.weights)
    number = _numbers(fit.effects.effects, held)[fixed - fit.first_amplitude]
    spread = np.where(np.minimum.outer(number, number) < 0, 0.0, held.covariance[np.ix_(number, number)])
    # of the columns in the order that they have here: those of the rest, then those that are held
    order = {int(column): k for k, column in enumerate([*alone.basis, *fixed])}
    slopes = -alone.inverse @ ((system[:, alone.basis] @ alone.inverse).T @ system[:, fixed])
    moved = np.concatenate([slopes, np.eye(len(fixed))])
    found = moved @ spread @ moved.T
    found[: len(given), : len(given)] += given * few(fit.data.facts, fit.triangles, len(basis)) ** 2
    kept = [order[int(column)] for column in basis]
    # where the log says more than what they are held to, the fit has its own values of them, and errors
    return at_least(found[np.ix_(kept, kept)], np.diag(covariance))


def _held(items: Sequence[Declared]) -> NDArray[np.intp]:
    """Return which of all amplitudes are held near what is known of them."""
    return np.flatnonzero(np.concatenate([np.isfinite(item.spread) & (item.spread > 0) for item in items]))


def _numbers(items: Sequence[Declared], held: HeldErrors) -> NDArray[np.intp]:
    """Return where all amplitudes, then all free shapes, stand in the covariance of what is held; -1 where nowhere."""
    amplitudes, shapes = list[int](), list[int]()
    for item, place in zip(items, places_of([item.spec for item in items]), strict=True):
        width = len(item.effect.amplitudes)
        numbers = held.places.get(place, np.full(width + len(item.free), -1)).tolist()
        amplitudes += numbers[:width]
        shapes += numbers[width:]
    return np.array([*amplitudes, *shapes], dtype=np.intp)
