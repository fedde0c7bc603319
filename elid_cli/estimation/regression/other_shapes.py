"""Other shapes of declared effects that explain a log about as well, and what they mean for the standard errors.

The cost over the shapes of a friction curve has several valleys. Which is the lowest, noise decides at times: the
difference of two costs is a sum over instants whose scatter the residual's colour makes far larger than if they were
independent (Vuong 1989, Econometrica 57). Valleys within that scatter cannot be told apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.data import Solved
from elid_cli.estimation.regression.covariance import long_run, residuals
from elid_cli.estimation.regression.effect_columns import FittedEffects, extra_of, triangles_with_effects
from elid_cli.estimation.regression.least_squares import solve
from elid_cli.model.effects.effect import Effect
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

AS_WELL = 6.0
"""Cost above that of the shapes found up to which others explain a log as well, whatever the scatter …"""
SCATTER = 2.0
"""… and standard deviations of the difference up to which they do."""
REACH = 2.0
"""Standard errors to the answer with shapes that explain the log as well."""
FREQUENCY = "frequency"
"""Name of shapes that are frequencies, Hz."""
APART = 0.6
"""Distance of shapes' logarithms from which on they lie in different valleys."""


def check_shape_ambiguity(fit: Solved, effects: FittedEffects, covariance: Array) -> tuple[FittedEffects, Array]:
    """Return the effects with those other shapes that explain the log as well, and a covariance (r, r) that knows it.

    An interval of 95 % then reaches to the answer with each of them.
    """
    kept, best, wider = [], _squares(fit), covariance.copy()
    for other in effects.others:
        if not _acts(other, fit, covariance):
            continue
        moved = replace(fit, effects=_with(effects, other, fit.signals))
        triangles = triangles_with_effects(fit.observation, fit.nuisances, moved.effects)
        moved = replace(moved, solution=solve(triangles, fit.solution.weights, basis=fit.solution.basis))
        if explains_as_well(_squares(moved) - best, fit.observation.segment):
            kept.append(other)
            apart = (moved.solution.values - fit.solution.values)[fit.solution.basis] / REACH
            wider += np.outer(apart, apart)
    return replace(effects, others=tuple(kept)), wider


def explains_as_well(more: Array, segment: NDArray[np.intp]) -> bool:
    """Whether a cost that is so much larger at every instant (M,) may be so by chance."""
    scatter = np.sqrt(float(long_run((more - more.mean())[:, None], segment)[0, 0]))
    return bool(more.sum() < max(AS_WELL, SCATTER * scatter))


def in_other_valleys(effects: FittedEffects, candidates: Iterable[Mapping[int, Effect]]) -> FittedEffects:
    """Return effects with those candidates as other shapes that are apart from the effects' own."""
    kept = [other for other in candidates if any(_apart(e, effects.effects[k].effect) for k, e in other.items())]
    return replace(effects, others=tuple(kept))


def own_shapes(effects: FittedEffects) -> list[Mapping[int, Effect]]:
    """Return the effects' own shapes, those that are searched together in one mapping from their places."""
    found: dict[tuple[int, str], dict[int, Effect]] = {}
    for place, item in enumerate(effects.effects):
        if item.free:
            found.setdefault(item.searched_with, {})[place] = item.effect
    return list(found.values())


def sentences(effects: FittedEffects, robot: Robot) -> list[str]:
    """Return a sentence for each of the other shapes that explain the log as well."""
    said = []
    for other in effects.others:
        first = next(iter(other.values()))
        joint = robot.joints[first.joint]
        shapes = [f"{effect.name} {_shape(effect, slides=not joint.revolute)}" for effect in other.values()]
        where = "" if first.whole_robot else f"{joint.name}: "
        said.append(f"{where}{' with '.join(shapes)} would explain this log as well; the standard errors include it")
    return said


def beyond_filter(effects: FittedEffects, robot: Robot, cutoff: float) -> list[str]:
    """Return a warning of every effect whose frequency came out above the filter's cut-off, Hz."""
    said = []
    for effect in (item.effect for item in effects.effects):
        shape = {parameter.name: value for parameter, value in zip(effect.shapes, effect.shape, strict=True)}
        if shape.get(FREQUENCY, 0.0) > cutoff:
            where = "" if effect.whole_robot else f"{robot.joints[effect.joint].name}: "
            said.append(
                f"{where}{effect.name} came out at {shape[FREQUENCY]:.3g} Hz, and the filter passes {cutoff:.3g} Hz: "
                f"it stands for something slower, and with it other values may be biased (a higher --cutoff tells)"
            )
    return said


def _shape(effect: Effect, *, slides: bool) -> str:
    return ", ".join(
        f"{shape.name} {value:.3g} {shape.unit_at(slides=slides)}".rstrip()
        for shape, value in zip(effect.shapes, effect.shape, strict=True)
    )


def _apart(one: Effect, other: Effect) -> bool:
    return any(
        np.abs(np.log(a / b)) > APART if a > 0 and b > 0 else a != b
        for a, b, shape in zip(one.shape, other.shape, one.shapes, strict=True)
        if not getattr(shape, "fixed", False)
    )


def _with(effects: FittedEffects, other: Mapping[int, Effect], signals: Signals) -> FittedEffects:
    extras = list(effects.extras)
    for place, effect in other.items():
        extras[place] = extra_of(effect, effects.scene, signals)
    return replace(effects, extras=tuple(extras))


def _squares(fit: Solved) -> Array:
    """Return the weighted squared residual of every instant, summed over the rows, (M,)."""
    observation, weights = fit.observation, fit.solution.weights
    left = residuals(observation, fit.solution.values, fit.extras)
    total = np.zeros(observation.instants)
    for group in observation.groups:
        total += np.where(group.use, weights.get(group.row, 0.0) * left[group.row], 0.0) ** 2
    return total


def _acts(other: Mapping[int, Effect], fit: Solved, covariance: Array) -> bool:
    """Whether what would have other shapes acts at all: of a single effect, whether an amplitude differs from 0."""
    if len(other) > 1:
        return True
    (place,) = other
    solution, own = fit.solution, fit.amplitude_places[place]
    mine = np.flatnonzero((solution.basis >= own.start) & (solution.basis < own.stop))
    deviations = np.sqrt(np.maximum(np.diag(covariance)[mine], 0.0))
    return bool(np.any(np.abs(solution.values[solution.basis[mine]]) > 2.0 * deviations))
