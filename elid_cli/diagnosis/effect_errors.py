"""Standard errors of the parameters of effects, their shapes and amplitudes together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.search.event_times import INSTANT
from elid_cli.estimation.regression.held_effects import HeldErrors, places_of
from elid_cli.model.effects.scene import with_stiffness
from elid_cli.robot.parameter import StandardParameter

RISE = 0.35
"""Time in which a jump rises behind a low-pass, over the inverse of its cut-off: motion and torque do not jump."""


def standard_errors(state: State, number: int) -> dict[str, float]:
    """Return standard errors of an effect's named parameters by first-order propagation of amplitudes and shapes.

    Both are unknowns together: an amplitude at a shape that is taken for known would seem several times too sure. An
    instant of a change is not known better than the filter passes jumps.
    """
    effect, centre, names = state.effects[number], state.coefficients(number), state.named(number)
    covariance, shapes = state.covariance_with_shapes
    slopes, index = list[list[float]](), list[int]()

    def add(moved_: Mapping[str, float], step: float, place: int) -> None:
        slopes.append([(moved_[name] - names[name]) / step for name in names])
        index.append(place)

    for k, column in enumerate(range(*state.place(number).indices(len(state.solution.values)))):
        where = np.flatnonzero(state.solution.basis == column)
        if len(where):  # the others are held at what the rest makes of them: 0
            step = 1e-4 * max(abs(float(centre[k])), 1e-9)
            add(state.renamed(number, centre + step * np.eye(len(centre))[k]), step, int(where[0]))
    stiffness = float(state.scene.stiffness[effect.joint])
    if type(effect).unit(state.scene, effect.joint) == stiffness:  # angles come from torques by K, which has an error
        column = state.log.model.names.index(StandardParameter("K", effect.joint))
        stiffer = with_stiffness(state.scene, effect.joint, stiffness * (1.0 + 1e-4))
        for where in np.flatnonzero(state.solution.basis == column)[:1]:
            now, then = (effect.named(scene, centre) for scene in (stiffer, state.scene))
            add({name: names[name] + now[name] - then[name] for name in names}, 1e-4 * stiffness, int(where))
    for k, value in enumerate(effect.shape):
        if (number, k) in shapes:
            shape = [v * (1.0 + 1e-4) if n == k else v for n, v in enumerate(effect.shape)]
            step = 1e-4 if value else 1.0
            add(type(effect)(effect.joint, shape).named(state.scene, centre), step, shapes[number, k])
    jacobian, inner = np.array(slopes).T, covariance[np.ix_(index, index)]
    spread = np.sqrt(np.maximum(np.einsum("ak,kl,al->a", jacobian, inner, jacobian), 0.0)) if index else np.zeros(0)
    found = {name: float(s) for name, s in zip(names, spread, strict=bool(index)) if s > 0}
    cutoff = state.log.signals.filter.cutoff
    if effect.local and INSTANT in found and np.isfinite(cutoff):
        found[INSTANT] = float(np.hypot(found[INSTANT], RISE / cutoff))
    return found


def held_errors(state: State) -> HeldErrors | None:
    """Return how well the effects of a model are known, for a fit that holds them; None where it has none."""
    if not state.effects:
        return None
    covariance, shapes = state.covariance_with_shapes
    places = {}
    for number, place in enumerate(places_of(state.specs)):
        columns = range(*state.place(number).indices(len(state.solution.values)))
        where = (np.flatnonzero(state.solution.basis == column) for column in columns)
        amplitudes = [int(found[0]) if len(found) else -1 for found in where]
        own = [at for (effect, _), at in shapes.items() if effect == number]
        places[place] = np.array([*amplitudes, *own], dtype=np.intp)
    return HeldErrors(covariance, places)
