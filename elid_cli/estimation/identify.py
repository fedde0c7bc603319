"""Identification: base parameters from a log, how sure they are, and how well they predict torque not used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.cutoff import fit_best
from elid_cli.estimation.default_fit import DefaultFit, fit_log, masked_as_needed, reshaped, with_delays
from elid_cli.estimation.regression.nuisances import DELAY, SIGNIFICANT
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.other_shapes import sentences
from elid_cli.estimation.regression.standard_errors import freedom
from elid_cli.estimation.result import (
    EstimateOptions,
    FittedEffect,
    Identification,
    JointError,
    Nuisance,
    Verdict,
)
from elid_cli.estimation.sanity import physics_warnings
from elid_cli.estimation.stiffness.link_equation import (
    link_stiffness,
    two_ways,
    with_both_regressions,
    with_link_stiffness,
)
from elid_cli.estimation.stiffness.noise import deflections_noise, unsupported_stiffness, with_pull
from elid_cli.estimation.validation.cross_validation import held_out, joint_errors, with_floor
from elid_cli.estimation.validation.verdicts import classes_in_log, judge, shortfall, suspicious, torque_scale
from elid_cli.model.base_parameters import find_base
from elid_cli.model.effects.declared import as_observed
from elid_cli.model.effects.tilt import LEVEL, STEEPEST, TILT, declared_tilt, levelled, tilted, untilted
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

__all__ = [
    "DefaultFit",
    "EstimateOptions",
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


WORSE = 1.25
"""Ratio of held-out errors above which the collocation's answer is not kept.

Under noise the default's bias predicts noisy motion a little better than the truth does: up to 1.04 was seen where the
collocation was five times closer to it.
"""

NO_WORSE = 1.1
"""The same for an answer that lies further from the default estimate than its standard errors allow."""

_LEVELLING = 8
"""Most fits until a declared tilt of the base and the fit agree."""


def identify(robot: Robot, signals: Signals, options: EstimateOptions | None = None) -> Identification:
    """Estimate the base parameters of a robot from one log (or several, joined).

    Raises
    ------
    DataError
        If the log excites no parameter at all.
    """
    options = options or EstimateOptions()
    if options.estimator == "paper":
        from elid_cli.estimation.classical import identify_paper

        return identify_paper(robot, signals, options)
    whole, robot = robot, as_observed(robot, signals.missing_link)
    fit, tilt = _levelled_fit(robot, signals, options)
    refused = unsupported_stiffness(fit)
    pulled = with_pull(fit.model, fit.triangles, fit.solution, fit.covariance, deflections_noise(fit))
    fit = replace(fit, covariance=pulled)
    found = missing_link_named(_as_described(assemble(fit, options, refused), robot, tilt), whole)
    if options.guards:
        found = replace(found, warnings=(*found.warnings, *physics_warnings(fit, found)))
    if options.accurate:
        return _as_described(_accurate(fit, found, options, refused), robot, tilt)
    return found


def _levelled_fit(robot: Robot, signals: Signals, options: EstimateOptions) -> tuple[DefaultFit, Array]:
    """Return the fit with gravity turned by the tilt that a declared effect stands for, and the tilt (2,), rad."""
    tilt = declared_tilt(robot)
    level = levelled(robot)
    model = Regressor(level)
    fit = fit_best(model, find_base(model), signals, options)
    for _ in range(_LEVELLING):
        declared = zip(fit.effects.effects if fit.effects else (), fit.amplitudes(), strict=True)
        more = next((values for item, values in declared if item.spec.effect == TILT), np.zeros(2))
        if np.abs(more).max() < LEVEL:
            break
        tilt = np.clip(tilt + more, -STEEPEST, STEEPEST)
        model = Regressor(replace(level, gravity=tilted(robot, tilt).gravity))
        fit = fit_log(model, find_base(model), signals, options)
    return fit, tilt


def _as_described(found: Identification, robot: Robot, tilt: Array) -> Identification:
    """Return the identification as one of the level robot with its whole tilt as an effect."""
    if not np.any(tilt):
        return found
    effects = tuple(replace(e, parameters=untilted({}, tilt)) if e.effect == TILT else e for e in found.effects)
    return replace(found, robot=robot, effects=effects)


def missing_link_named(found: Identification, robot: Robot) -> Identification:
    """Return the identification with the stiffnesses named that a log without link positions cannot show."""
    lost = [
        (f"K{k}", before.name)
        for k, (before, now) in enumerate(zip(robot.joints, found.robot.joints, strict=True), start=1)
        if before.elastic and not now.elastic
    ]
    if not lost:
        return found
    why = "has no link position in this log: its transmission counts as rigid"
    reasons = {name: f"{joint} {why}" for name, joint in lost}
    return replace(
        found,
        this_log={**found.this_log, **dict.fromkeys(reasons, "not excited")},
        reasons={**found.reasons, **reasons},
        notes=(*found.notes, *(f"{name} cannot be identified: {reason}" for name, reason in reasons.items())),
    )


def _accurate(
    fit: DefaultFit, found: Identification, options: EstimateOptions, refused: Mapping[str, str]
) -> Identification:
    """Return the collocation's answer where it is accepted, else the default one with the reason."""
    from elid_cli.estimation.collocation.estimator import Refusal, collocate

    if len(fit.observation.independent) < len(fit.observation.groups):
        note = "--accurate: the default estimate stands: the collocation does not use the joint torque sensors"
        return replace(found, notes=(*found.notes, note))
    told = len(fit.nuisances)
    fit = with_delays(fit, options)
    answer = collocate(fit)
    if isinstance(answer, Refusal):
        note = f"--accurate: the default estimate stands: {answer.reason}"
        return replace(found, notes=(*found.notes, note))
    solution = replace(fit.solution, values=answer.values)
    # held-out stretches are judged with the columns of the shapes that were found
    own = fit if answer.effects is None else reshaped(fit, answer.effects, options)
    effects = replace(own.effects, others=answer.others) if own.effects else None
    better = replace(own, effects=effects, solution=solution, covariance=answer.covariance)
    note = f"--accurate: spline collocation, {answer.steps} steps, knots every {answer.knots * 1e3:.0f} ms"
    if answer.widened > 1.05:
        note += f", standard errors widened by {answer.widened:.2g}"
    result = assemble(better, options, refused, before=own)
    worst, label = _worsening(found, result)
    if worst > (NO_WORSE if answer.far else WORSE):
        moved = f"{answer.far} and " if answer.far else ""
        note = (
            f"--accurate: the default estimate stands: {moved}held-out torque of {label} is predicted "
            f"{worst:.3g} times as badly"
        )
        return replace(found, notes=(*found.notes, note))
    every = [(n, *better.nuisance(k)) for k, n in enumerate(result.nuisances)]
    firm = [n for k, (n, value, deviation) in enumerate(every) if k < told or abs(value) > SIGNIFICANT * deviation]
    return replace(
        result, nuisances=tuple(firm), estimator="accurate", notes=(*result.notes, note), warnings=found.warnings
    )


def _worsening(before: Identification, after: Identification) -> tuple[float, str]:
    """Return the largest ratio of held-out errors after and before over all joints' rows, and the joint's name."""
    ratios = []
    for name, error in after.error.items():
        other = before.error[name]
        for now, then in ((error.rms, other.rms), (error.spring_rms, other.spring_rms)):
            if now is not None and then:
                ratios.append((now / then, name))
    return max(ratios, default=(0.0, ""))


def assemble(
    fit: DefaultFit,
    options: EstimateOptions,
    refused: Mapping[str, str] | None = None,
    before: DefaultFit | None = None,
) -> Identification:
    """Judge a fit: verdicts, classes, held-out error.

    `before` is the fit by triangles that `fit` was refined from: held-out stretches are then predicted by the
    triangles' fit to the others, moved by what the refinement changed.
    """
    base, solution, robot = fit.base, fit.solution, fit.model.robot
    transform = fit.transform
    known = solution.estimable(transform)
    estimate = transform @ solution.values
    spread = transform[:, solution.basis] @ fit.covariance @ transform[:, solution.basis].T
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    scale = torque_scale(base, fit.triangles)
    left = freedom(fit.observation, fit.signals, len(solution.basis))
    verdict, reasons = judge(base, estimate, deviation, scale, known, robot, fit.signals, refused or {}, left)
    unsaid = np.array([v == "refused" for v in verdict])
    nuisances, delays = _nuisances(fit)
    warnings = [*suspicious(base, estimate, deviation, known), *fit.signals.doubts]
    lacking = shortfall(base, solution, known, fit.signals)
    fresh = Identification(
        robot=robot,
        base=base,
        estimate=np.where(unsaid, np.nan, estimate),
        std_error=np.where(unsaid, np.nan, deviation),
        reference=base.values(robot.reference()),
        verdict=verdict,
        this_log=classes_in_log(base, verdict, reasons),
        reasons=reasons,
        error=held_out(robot, fit.triangles, solution, None if before is None else before.solution),
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
        notes=(*((lacking,) if lacking else ()), *(sentences(fit.effects, robot) if fit.effects else ())),
        estimator=options.estimator,
        triangles=fit.triangles,
        weights=solution.weights,
    )
    found = with_both_regressions(fresh, lambda joint: two_ways(fresh, fit.observation, joint))
    return with_link_stiffness(
        found, lambda joint: link_stiffness(base, fit.observation, fit.signals, robot.reference(), joint), base.classes
    )


def _deviation(fit: DefaultFit, column: int) -> float:
    where = np.flatnonzero(fit.solution.basis == column)
    return float(np.sqrt(max(fit.covariance[where[0], where[0]], 0.0))) if len(where) else float("nan")


def _nuisances(fit: DefaultFit) -> tuple[tuple[Nuisance, ...], Array]:
    robot, p = fit.model.robot, len(fit.base.parameters)
    delays = np.zeros(robot.n)
    found = []
    for k, extra in enumerate(fit.nuisances):
        joint = next(iter(extra.rows)).joint
        value = float(fit.solution.values[p + k])
        kind = extra.name.split("_")[-1]  # delay, offset, gain
        if extra.name == DELAY:
            delays[joint] = value
        found.append(Nuisance(extra.name, robot.joints[joint].name, {kind: value}, {kind: _deviation(fit, p + k)}))
    return tuple(found), delays


def _effects(fit: DefaultFit) -> tuple[FittedEffect, ...]:
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
