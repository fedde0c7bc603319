"""Identification: base parameters from a log, how sure they are, and how well they predict torque not used.

The default estimator is least squares on sum and motor rows (the spring eliminated, no homogeneous rows), filtered in
parallel, every row group weighted by its own residual, with delay and offset of the torque channels and the shapes of
declared effects estimated along.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.base import BaseParameters, find_base
from elid_cli.covariance import residuals, sandwich
from elid_cli.effects import (
    SHAPE_SPREAD,
    FittedEffects,
    amplitude_prior,
    declared_effects,
    extra_of,
    fit_declared,
    scene_of,
    shape_columns,
)
from elid_cli.heldout import held_out, joint_errors, with_floor
from elid_cli.identification import (
    EstimateOptions,
    FittedEffect,
    Identification,
    JointError,
    Nuisance,
    Verdict,
)
from elid_cli.model import Model
from elid_cli.nuisance import DELAY, delay_columns, offset_columns, significant
from elid_cli.observation import Observation, observe
from elid_cli.reduction import Extra, Triangles, folds_of, reduce
from elid_cli.robot import Robot
from elid_cli.signals import Signals
from elid_cli.solve import Solution, reweighted, solve
from elid_cli.verdicts import classes_in_log, judge, shortfall, suspicious, torque_scale

__all__ = [
    "EstimateOptions",
    "Fit",
    "FittedEffect",
    "Identification",
    "JointError",
    "Nuisance",
    "Verdict",
    "fit_log",
    "held_out",
    "identify",
    "joint_errors",
    "masked_as_needed",
    "with_floor",
]

Array = NDArray[np.float64]

STICKING = 2.5
"""Residual rms at reversals over that elsewhere, above which a joint's reversals are left out."""
EFFECT_ROUNDS = 2
"""Rounds of fitting shapes and everything else in turn."""


@dataclass(frozen=True)
class Fit:
    """The default estimator's fit to a log, before it is judged."""

    model: Model
    base: BaseParameters
    signals: Signals
    observation: Observation
    nuisances: tuple[Extra, ...]
    effects: FittedEffects | None
    triangles: Triangles
    solution: Solution
    covariance: Array
    """Covariance of the basis of `solution`, shapes of effects accounted for, (r, r)."""

    @property
    def extras(self) -> tuple[Extra, ...]:
        """All columns beyond the standard parameters: nuisances, then effects."""
        return (*self.nuisances, *(self.effects.extras if self.effects else ()))

    @property
    def transform(self) -> Array:
        """Base parameters = transform @ solution, (b, p + e)."""
        return np.concatenate([self.base.transform, np.zeros((self.base.count, self.triangles.extras))], axis=1)

    def amplitudes(self) -> list[Array]:
        """Return the fitted amplitudes of every declared effect, each (d,)."""
        return _amplitudes(self.solution, self.base, self.nuisances, self.effects)


def identify(robot: Robot, signals: Signals, options: EstimateOptions | None = None) -> Identification:
    """Estimate the base parameters of a robot from one log (or several, joined).

    Raises
    ------
    DataError
        If the log excites no parameter at all.
    """
    options = options or EstimateOptions()
    if options.estimator == "paper":
        from elid_cli.paper import identify_paper

        return identify_paper(robot, signals, options)
    model = Model(robot)
    fit = fit_log(model, find_base(model), signals, options)
    return assemble(fit, options)


def fit_log(model: Model, base: BaseParameters, signals: Signals, options: EstimateOptions) -> Fit:
    """Fit a log by the default estimator."""
    observation = observe(model, signals)
    if options.mask is not None:
        observation = observation if options.mask else observation.unmasked(np.ones(model.robot.n, dtype=bool))
    else:
        start = _start_effects(model, base, observation, signals)
        observation = masked_as_needed(observation, base, options, start.extras if start else ())
    fold = folds_of(observation, options.folds)
    nuisances: list[Extra] = []
    if options.delays:
        nuisances += delay_columns(observation)
    if options.offsets:
        nuisances += offset_columns(observation)
    effects = _start_effects(model, base, observation, signals)
    for last in (False, True):
        effects, triangles, solution = _fit_effects(model, base, observation, signals, nuisances, effects, fold)
        if last or not nuisances:
            break
        nuisances = significant(observation, solution, nuisances, signals, effects.extras if effects else ())
    covariance = _covariance(base, observation, signals, nuisances, effects, triangles, solution)
    return Fit(model, base, signals, observation, tuple(nuisances), effects, triangles, solution, covariance)


def _start_effects(
    model: Model, base: BaseParameters, observation: Observation, signals: Signals
) -> FittedEffects | None:
    """Return the robot file's effects at the shapes it gives, or None where it declares none."""
    if not model.robot.effects:
        return None
    rough = reweighted(reduce(observation), base.count)
    scene = scene_of(model, signals, rough.values[: model.parameters])
    effects = declared_effects(model.robot, scene)
    extras = tuple(extra_of(item.effect, scene, signals) for item in effects)
    return FittedEffects(effects, extras, scene)


def _fit_effects(
    model: Model,
    base: BaseParameters,
    observation: Observation,
    signals: Signals,
    nuisances: Sequence[Extra],
    effects: FittedEffects | None,
    fold: NDArray[np.intp],
) -> tuple[FittedEffects | None, Triangles, Solution]:
    """Return effects with refined shapes, the triangles with their columns, and the solution."""
    for _ in range(EFFECT_ROUNDS if effects else 0):
        assert effects is not None
        triangles = _reduced(observation, nuisances, effects)
        solution = reweighted(triangles, base.count + triangles.extras)
        scene = scene_of(model, signals, solution.values[: model.parameters])
        effects = fit_declared(observation, signals, scene, effects.effects, solution.weights, nuisances)
    triangles = _reduced(observation, nuisances, effects, fold)
    return effects, triangles, reweighted(triangles, base.count + triangles.extras)


def _reduced(
    observation: Observation,
    nuisances: Sequence[Extra],
    effects: FittedEffects | None,
    fold: NDArray[np.intp] | None = None,
) -> Triangles:
    """Return triangles with the columns of nuisances and effects, and what is known of the effects' amplitudes."""
    if effects is None:
        return reduce(observation, nuisances, fold)
    triangles = reduce(observation, (*nuisances, *effects.extras), fold)
    first = triangles.parameters + sum(extra.width for extra in nuisances)
    return replace(triangles, prior=amplitude_prior(effects.effects, first, triangles.width))


def _amplitudes(
    solution: Solution, base: BaseParameters, nuisances: Sequence[Extra], effects: FittedEffects | None
) -> list[Array]:
    place = len(base.parameters) + sum(extra.width for extra in nuisances)
    found = []
    for extra in effects.extras if effects else ():
        found.append(solution.values[place : place + extra.width])
        place += extra.width
    return found


def _covariance(
    base: BaseParameters,
    observation: Observation,
    signals: Signals,
    nuisances: Sequence[Extra],
    effects: FittedEffects | None,
    triangles: Triangles,
    solution: Solution,
) -> Array:
    """Return the covariance of the solution's basis; shapes that were fitted count as parameters with their prior."""
    extras = [*nuisances, *(effects.extras if effects else ())]
    if effects is None:
        return sandwich(observation, solution, extras)
    shapes = shape_columns(effects, signals, _amplitudes(solution, base, nuisances, effects))
    if not shapes:
        return sandwich(observation, solution, extras)
    extended = reduce(observation, [*extras, *shapes])
    prior = np.zeros((len(shapes), extended.width + 1))
    prior[np.arange(len(shapes)), triangles.width + np.arange(len(shapes))] = 1.0 / SHAPE_SPREAD
    if triangles.prior is not None:
        known = np.insert(triangles.prior, [triangles.width], np.zeros((1, len(shapes))), axis=1)
        prior = np.concatenate([prior, known])
    extended = replace(extended, prior=prior)
    basis = np.concatenate([solution.basis, triangles.width + np.arange(len(shapes))]).astype(np.intp)
    wider = solve(extended, solution.weights, basis=basis)
    whole = sandwich(observation, wider, [*extras, *shapes])
    place = {int(column): k for k, column in enumerate(wider.basis)}
    kept = [place.get(int(column), -1) for column in solution.basis]
    if min(kept) < 0:
        return sandwich(observation, solution, extras)
    covariance: Array = whole[np.ix_(kept, kept)]
    return covariance


def masked_as_needed(
    observation: Observation, base: BaseParameters, options: EstimateOptions, effects: Sequence[Extra] = ()
) -> Observation:
    """Return the observation with reversals counted for the joints whose residual there is no larger than elsewhere.

    A motor that sticks has no defined friction while it does; one that glides through zero tells most about its
    Coulomb friction just there.
    """
    if options.mask is not None:
        return observation if options.mask else observation.unmasked(np.ones(observation.robot.n, dtype=bool))
    extras = [*delay_columns(observation), *offset_columns(observation), *effects]
    triangles = reduce(observation, extras)
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


def assemble(fit: Fit, options: EstimateOptions, refused: Mapping[str, str] | None = None) -> Identification:
    """Judge a fit: verdicts, classes, held-out error."""
    base, solution, robot = fit.base, fit.solution, fit.model.robot
    transform = fit.transform
    known = solution.estimable(transform)
    estimate = transform @ solution.values
    spread = transform[:, solution.basis] @ fit.covariance @ transform[:, solution.basis].T
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    scale = torque_scale(base, fit.triangles)
    verdict, reasons = judge(base, estimate, deviation, scale, known, robot, fit.signals, refused or {})
    unsaid = np.array([v == "refused" for v in verdict])
    nuisances, delays = _nuisances(fit)
    warnings = [*suspicious(base, estimate, deviation, known)]
    lacking = shortfall(base, solution, known, fit.signals)
    return Identification(
        robot=robot,
        base=base,
        estimate=np.where(unsaid, np.nan, estimate),
        std_error=np.where(unsaid, np.nan, deviation),
        reference=base.values(robot.reference()),
        verdict=verdict,
        this_log=classes_in_log(base, verdict, reasons),
        reasons=reasons,
        error=held_out(robot, fit.triangles, solution),
        condition=solution.condition,
        rank_margin=solution.margin,
        rank=int(known.sum()),
        covariance=np.where(unsaid[:, None] | unsaid[None], np.nan, spread),
        standard=solution.values[: len(base.parameters)],
        delays=delays,
        settings=_settings(fit.signals, fit.observation, options),
        nuisances=nuisances,
        effects=_effects(fit),
        warnings=tuple(warnings),
        notes=(lacking,) if lacking else (),
        estimator=options.estimator,
        triangles=fit.triangles,
        weights=solution.weights,
    )


def _deviation(fit: Fit, column: int) -> float:
    where = np.flatnonzero(fit.solution.basis == column)
    return float(np.sqrt(max(fit.covariance[where[0], where[0]], 0.0))) if len(where) else float("nan")


def _nuisances(fit: Fit) -> tuple[tuple[Nuisance, ...], Array]:
    robot, p = fit.model.robot, len(fit.base.parameters)
    delays = np.zeros(robot.n)
    found = []
    for k, extra in enumerate(fit.nuisances):
        joint = next(iter(extra.rows)).joint
        value = float(fit.solution.values[p + k])
        kind = "delay" if extra.name == DELAY else "offset"
        if extra.name == DELAY:
            delays[joint] = value
        found.append(Nuisance(extra.name, robot.joints[joint].name, {kind: value}, {kind: _deviation(fit, p + k)}))
    return tuple(found), delays


def _effects(fit: Fit) -> tuple[FittedEffect, ...]:
    if fit.effects is None:
        return ()
    place = fit.model.parameters + sum(extra.width for extra in fit.nuisances)
    found = []
    for item, values in zip(fit.effects.effects, fit.amplitudes(), strict=True):
        named = item.effect.named(fit.effects.scene, values)
        errors = {p.name: _deviation(fit, place + d) for d, p in enumerate(item.effect.amplitudes)}
        found.append(FittedEffect(item.spec.effect, item.spec.joint, named, errors))
        place += len(values)
    return tuple(found)


def _settings(signals: Signals, observation: Observation, options: EstimateOptions) -> dict[str, object]:
    return {
        "cutoff": signals.filter.cutoff,
        "rate": signals.rate,
        "instants": observation.instants,
        "knots": [None if not np.isfinite(k) else float(k) for k in signals.knots],
        "min_velocity": [float(v) for v in signals.min_velocity],
        "masked": [float(v) for v in observation.masked],
        "noise_q": [float(v) for v in signals.noise.q],
        "noise_theta": [float(v) for v in signals.noise.theta],
        "noise_tau": [float(v) for v in signals.noise.tau],
        "velocity_used": bool(signals.velocity_used.any()),
        "estimator": options.estimator,
        "folds": options.folds,
    }
