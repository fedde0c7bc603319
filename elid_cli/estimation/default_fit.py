"""The default fit: least squares on sum and motor rows (the spring eliminated, no homogeneous rows).

Rows are filtered in parallel and every row group is weighted by its own residual; delay and offset of the torque
channels and the shapes of declared effects are estimated along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.covariance import lasting_weights, residuals
from elid_cli.estimation.regression.effect_columns import FittedEffects, extra_of, scene_of
from elid_cli.estimation.regression.effect_shapes import fit_declared
from elid_cli.estimation.regression.least_squares import Solution, reweighted
from elid_cli.estimation.regression.nuisances import (
    DELAY,
    OFFSET,
    delay_columns,
    of_sampling,
    offset_columns,
    reading_columns,
    significant,
)
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.other_shapes import check_shape_ambiguity, triangles_with_effects
from elid_cli.estimation.regression.standard_errors import amplitudes_of, covariance_of
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles, folds_of, to_triangles
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.validation.cross_validation import held_out
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.effects.declared import declared_effects
from elid_cli.model.regressor import Regressor
from elid_cli.signals.signals import Signals

STICKING = 2.5
"""Residual rms at reversals over that elsewhere, above which a joint's reversals are left out."""
READING_ROUNDS = 2
"""Rounds of fitting a stiffness and the gain of its torque sensor in turn."""


@dataclass(frozen=True)
class DefaultFit:
    """The default estimator's fit to a log, before it is judged."""

    model: Regressor
    base: BaseParameters
    signals: Signals
    observation: Observation
    nuisances: tuple[ExtraColumns, ...]
    effects: FittedEffects | None
    triangles: Triangles
    solution: Solution
    covariance: Array
    """Covariance of the basis of `solution`, shapes of effects accounted for, (r, r)."""

    @property
    def extras(self) -> tuple[ExtraColumns, ...]:
        """All columns beyond the standard parameters: nuisances, then effects."""
        return (*self.nuisances, *(self.effects.extras if self.effects else ()))

    @property
    def transform(self) -> Array:
        """Base parameters = transform @ solution, (b, p + e)."""
        return np.concatenate([self.base.transform, np.zeros((self.base.count, self.triangles.extras))], axis=1)

    def nuisance(self, number: int) -> tuple[float, float]:
        """Return a nuisance's coefficient and its standard deviation; NaN where the log does not determine it."""
        column = len(self.base.parameters) + number
        where = np.flatnonzero(self.solution.basis == column)
        if not len(where) or not self.solution.determined(column):
            return float("nan"), float("nan")
        return float(self.solution.values[column]), float(np.sqrt(max(self.covariance[where[0], where[0]], 0.0)))

    def amplitudes(self) -> list[Array]:
        """Return the fitted amplitudes of every declared effect, each (d,)."""
        return amplitudes_of(self.solution, self.base, self.nuisances, self.effects)


def fit_log(model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions) -> DefaultFit:
    """Fit a log by the default estimator."""
    observation = observe(model, signals)
    if options.mask is False:
        observation = observation.unmasked(np.ones(model.robot.n, dtype=bool))
    fold = folds_of(observation, options.folds)
    delays, offsets = delay_columns(observation), offset_columns(observation)
    if options.mask is None:
        start = _start_effects(model, base, observation, signals)
        observation = masked_as_needed(observation, base, [*delays, *offsets], start.extras if start else (), fold)
    nuisances = [*(delays if options.delays else ()), *(offsets if options.offsets else ())]
    effects = _start_effects(model, base, observation, signals)
    if options.offsets and len(observation.independent) < len(observation.groups):
        nuisances += _reading_columns(model, base, observation, nuisances, effects)
    for last in (False, True):
        if effects:
            steps = (_Step.REFINE, _Step.REFINE) if last else (_Step.SCAN, _Step.RESCAN, _Step.REFINE)
            effects = _shaped(model, base, observation, signals, nuisances, effects, steps)
        triangles = triangles_with_effects(observation, nuisances, effects, fold)
        solution = reweighted(triangles, base.count + triangles.extras)
        if last or not nuisances:
            break
        nuisances = significant(observation, solution, nuisances, signals, effects.extras if effects else ())
        nuisances = _borne_out(model, base, observation, nuisances, effects, fold)
    covariance = covariance_of(base, observation, signals, nuisances, effects, triangles, solution)
    if effects:
        effects, covariance = check_shape_ambiguity(observation, signals, nuisances, effects, solution, covariance)
    return DefaultFit(model, base, signals, observation, tuple(nuisances), effects, triangles, solution, covariance)


def with_delays(fit: DefaultFit, options: EstimateOptions) -> DefaultFit:
    """Return the fit with a delay of every torque channel that it could not tell from none.

    A sharper estimator may: without them, rotor inertias and viscous friction would be bent by what is left of one. Not
    those that were too long for a delay of sampling, nor those that the robot file declares.
    """
    had = {next(iter(extra.rows)).joint for extra in fit.nuisances if extra.name == DELAY}
    names = fit.model.robot.joint_names
    had |= {names.index(spec.joint) for spec in fit.model.robot.effects if spec.effect == DELAY and spec.joint in names}
    missing = [e for e in delay_columns(fit.observation) if next(iter(e.rows)).joint not in had]
    while missing and options.delays:
        nuisances = (*fit.nuisances, *missing)
        triangles = triangles_with_effects(
            fit.observation, nuisances, fit.effects, folds_of(fit.observation, options.folds)
        )
        solution = reweighted(triangles, fit.base.count + triangles.extras)
        covariance = covariance_of(fit.base, fit.observation, fit.signals, nuisances, fit.effects, triangles, solution)
        grown = replace(fit, nuisances=nuisances, triangles=triangles, solution=solution, covariance=covariance)
        found = np.array([grown.nuisance(k) for k in range(len(fit.nuisances), len(nuisances))])
        short = of_sampling(found[:, 0], found[:, 1], fit.signals.dt)
        if short.all():
            return grown
        missing = [extra for extra, may in zip(missing, short, strict=True) if may]
    return fit


def fit_part(fit: DefaultFit, signals: Signals) -> DefaultFit:
    """Fit a part of a log with what a fit to all of it decided: the reversals that count and the nuisances.

    Of robots without declared effects and torque sensors.
    """
    model, base = fit.model, fit.base
    observation = observe(model, signals).unmasked(fit.observation.gliding)
    kept = {(extra.name, row.joint) for extra in fit.nuisances for row in extra.rows}
    columns = [*delay_columns(observation), *offset_columns(observation)]
    nuisances = [extra for extra in columns if (extra.name, next(iter(extra.rows)).joint) in kept]
    triangles = to_triangles(observation, nuisances)
    solution = reweighted(triangles, base.count + triangles.extras)
    covariance = covariance_of(base, observation, signals, nuisances, None, triangles, solution)
    return DefaultFit(model, base, signals, observation, tuple(nuisances), None, triangles, solution, covariance)


def _borne_out(
    model: Regressor,
    base: BaseParameters,
    observation: Observation,
    nuisances: list[ExtraColumns],
    effects: FittedEffects | None,
    fold: NDArray[np.intp],
) -> list[ExtraColumns]:
    """Return the nuisances without torque offsets that predict left-out torque no better than none.

    Noise in accelerations pulls a mass towards 0, and an offset then takes up its weight: significant, and wrong.
    """
    for extra in [e for e in nuisances if e.name == OFFSET]:
        name = model.robot.joint_names[next(iter(extra.rows)).joint]
        fewer = [e for e in nuisances if e is not extra]
        errors = []
        for chosen in (nuisances, fewer):
            triangles = triangles_with_effects(observation, chosen, effects, fold)
            solution = reweighted(triangles, base.count + triangles.extras)
            found = held_out(model.robot, triangles, solution).get(name)
            errors.append(0.0 if found is None else found.rms)
        if errors[1] < errors[0]:
            nuisances = fewer
    return nuisances


def reshaped(fit: DefaultFit, effects: FittedEffects, options: EstimateOptions) -> DefaultFit:
    """Return the fit with effects in other shapes, their columns and everything linear fitted anew."""
    extras = tuple(extra_of(item.effect, effects.scene, fit.signals) for item in effects.effects)
    effects = replace(effects, extras=extras, others=())
    triangles = triangles_with_effects(
        fit.observation, fit.nuisances, effects, folds_of(fit.observation, options.folds)
    )
    solution = reweighted(triangles, fit.base.count + triangles.extras)
    return replace(fit, effects=effects, triangles=triangles, solution=solution)


def _reading_columns(
    model: Regressor,
    base: BaseParameters,
    observation: Observation,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects | None,
) -> list[ExtraColumns]:
    """Return offset and gain columns of the joint torque sensors, the gains' at the stiffness of a first fit."""
    elastic = model.robot.elastic
    declared = {(item.spec.effect, item.effect.joint) for item in (effects.effects if effects else ())}
    known = [*nuisances, *(effects.extras if effects else ())]
    stiffness = np.zeros(len(elastic))
    for _ in range(READING_ROUNDS):
        extras = [*known, *reading_columns(observation, stiffness, declared)] if np.any(stiffness) else known
        triangles = to_triangles(observation, extras)
        values = reweighted(triangles, base.count + triangles.extras).values
        stiffness = np.array([values[model.index[f"K{k + 1}"]] if elastic[k] else 0.0 for k in range(len(elastic))])
    return reading_columns(observation, stiffness, declared)


def _start_effects(
    model: Regressor, base: BaseParameters, observation: Observation, signals: Signals
) -> FittedEffects | None:
    """Return the robot file's effects at the shapes it gives, or None where it declares none."""
    if not model.robot.effects:
        return None
    rough = reweighted(to_triangles(observation), base.count)
    scene = scene_of(model, signals, rough.values[: model.parameters])
    effects = declared_effects(model.robot, scene)
    extras = tuple(extra_of(item.effect, scene, signals) for item in effects)
    return FittedEffects(effects, extras, scene)


class _Step(Enum):
    """One fit of the shapes, between two of everything else."""

    SCAN = "all valleys of the cost about what the file gives"
    RESCAN = "the same with what the residual's colour leaves of the rows"
    REFINE = "the valley it is in"


def _shaped(
    model: Regressor,
    base: BaseParameters,
    observation: Observation,
    signals: Signals,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects,
    steps: Sequence[_Step],
) -> FittedEffects:
    """Return effects with refined shapes.

    Which valley of the cost is right is a matter of a few standard deviations, in which rows with a slow residual, as
    that of a stiff spring's torque, count for far less than their number, and what the file gives counts as it stands.
    """
    for step in steps:
        triangles = triangles_with_effects(observation, nuisances, effects)
        solution = reweighted(triangles, base.count + triangles.extras)
        scene = scene_of(model, signals, solution.values[: model.parameters])
        weights, items = solution.weights, effects.effects
        if step is not _Step.REFINE:
            items = tuple(replace(item, effect=item.start or item.effect) for item in items)
        if step is _Step.RESCAN:
            weights = lasting_weights(observation, solution, [*nuisances, *effects.extras])
        found = fit_declared(observation, signals, scene, items, weights, nuisances, scan=step is not _Step.REFINE)
        effects = replace(found, others=found.others if step is _Step.RESCAN else effects.others)
    return effects


def masked_as_needed(
    observation: Observation,
    base: BaseParameters,
    nuisances: Sequence[ExtraColumns],
    effects: Sequence[ExtraColumns],
    fold: NDArray[np.intp],
) -> Observation:
    """Return the observation with reversals counted for the joints whose residual there is no larger than elsewhere.

    A motor that sticks has no defined friction while it does; one that glides through zero tells most about its
    Coulomb friction just there. Joints with declared effects stay masked. Folds are those of later reductions, which
    then need not be made anew.
    """
    extras = [*nuisances, *effects]
    triangles = to_triangles(observation, extras, fold)
    values = reweighted(triangles, base.count + triangles.extras).values
    residual = residuals(observation, values, extras)
    glides = np.zeros(observation.robot.n, dtype=bool)
    shaped = {row.joint for extra in effects for row in extra.rows}
    for k in range(observation.robot.n):
        # a friction curve is bent by what happens at standstill more than it learns there
        if k in shaped:
            continue
        trace = residual.get(("sum", k))
        inside = observation.known[k] & observation.reversing[k]
        outside = observation.known[k] & ~observation.reversing[k]
        if trace is None or not inside.any() or not outside.any():
            continue
        glides[k] = np.sqrt(np.mean(trace[inside] ** 2)) < STICKING * np.sqrt(np.mean(trace[outside] ** 2))
    return observation.unmasked(glides)
