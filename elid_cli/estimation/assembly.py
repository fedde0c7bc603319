"""A fit judged: verdicts, classes, held-out error, stiffnesses by their other ways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.data import FitData, Solved, sum_row
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.judgement import JointError, Judgement
from elid_cli.estimation.regression.long_run import at_least
from elid_cli.estimation.regression.nuisances import of_sampling
from elid_cli.estimation.regression.other_shapes import beyond_filter, sentences
from elid_cli.estimation.regression.standard_errors import ROTOR_KNOWN, by_stretches, freedom, told_rotors
from elid_cli.estimation.result import EstimateOptions, FittedEffect, Identification, Nuisance, records
from elid_cli.estimation.stiffness.link_equation import with_both_regressions, with_link_stiffness
from elid_cli.estimation.stiffness.noise import stiffness_in_noise, taken_over, with_pull
from elid_cli.estimation.validation.column_noise import joined, pull_of
from elid_cli.estimation.validation.cross_validation import held_out
from elid_cli.estimation.validation.verdicts import Estimates, judge, shortfall, suspicious, torque_scale
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene, with_stiffness
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot

MOTOR = ("Jm", "Ja", "fs", "fv")
SLIGHT = 0.1
"""Part of its standard error below which what noise pulls a value by is left out."""
NO_MOTOR_TORQUE = "no motor torque in this log"


def judged(fit: DefaultFit, options: EstimateOptions) -> tuple[DefaultFit, dict[str, str], Identification]:
    """Return a fit whose standard errors know of the encoders' noise, what that noise refuses, and what it all says."""
    noise = fit.data.facts.deflection_noise
    refused = stiffness_in_noise(fit.model, fit.triangles, fit.solution, noise)
    robot = fit.model.robot
    for k, joint in enumerate(robot.joints):
        if joint.torque_at == "link":
            refused = {**refused, **dict.fromkeys(motor_parameters(robot, k), f"{joint.name} has {NO_MOTOR_TORQUE}")}
    fit = replace(fit, covariance=with_pull(fit.model, fit.triangles, fit.solution, fit.covariance, noise))
    return fit, refused, assemble(fit, options, refused)


def with_scatter(fit: DefaultFit, *said: Judgement | None) -> DefaultFit:
    """Return a fit whose errors are at least those of leaving stretches out, where its model does not suffice."""
    if not any(one is not None and one.insufficient for one in said):
        return fit
    return replace(fit, scatter=by_stretches(fit.triangles, fit.solution))


def with_pull_of_noise(fit: DefaultFit, said: Sequence[Judgement | None], instants: Sequence[int] = (1,)) -> DefaultFit:
    """Return a fit whose errors know by how much noise in the columns pulls its values, where that matters.

    The values stay, as the noise is known roughly only.

    Parameters
    ----------
    fit
        The fit.
    said, instants
        What is known of the noise in each of its logs, and how many instants each has.
    """
    columns = joined([() if one is None else one.columns for one in said], instants)
    own, facts = fit.transform[:, fit.solution.basis], fit.data.facts
    lost = own @ taken_over(fit.model, fit.triangles, fit.solution, facts.deflection_noise, columns)
    pull, deviation = np.column_stack([pull_of(fit, columns), lost]), fit.deviations(fit.covariance)
    return replace(fit, pull=pull) if bool(np.any(np.linalg.norm(pull, axis=1) > SLIGHT * deviation)) else fit


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
    own = fit.transform[:, fit.solution.basis]
    spread = own @ fit.covariance @ own.T
    if fit.scatter is not None:
        spread = at_least(spread, np.diag(own @ fit.scatter @ own.T))
    if fit.pull is not None:
        spread = spread + fit.pull @ fit.pull.T
    facts, robot = fit.data.facts, fit.model.robot
    errors = held_out(robot, fit.triangles, fit.solution, None if before is None else before.solution)
    left = freedom(facts, fit.triangles, len(fit.solution.basis))
    fresh = weighed(fit, spread, _of_delivered(fit, errors), refused or {}, left)
    nuisances, delays = _nuisances(fit)
    doubts = () if fit.data.samples is None else fit.signals.doubts
    beyond = beyond_filter(fit.effects, robot, fit.signals.filter.cutoff) if fit.effects else []
    lacking = shortfall(fit.base, fresh.rank, robot, facts)
    rotors = told_rotors(fit)
    fresh = replace(
        fresh,
        delays=delays,
        settings=_settings(fit.data, options),
        nuisances=nuisances,
        effects=_effects(fit),
        rotors=rotors,
        warnings=(*fresh.warnings, *doubts, *beyond),
        notes=(
            *((lacking,) if lacking else ()),
            *(sentences(fit.effects, robot) if fit.effects else ()),
            *_rotor_words(rotors, robot),
            *_without_offsets(fit),
        ),
        estimator=options.estimator,
    )
    found = with_both_regressions(fresh, lambda joint: fit.data.two_ways(fit.solution.values, joint, fit.extras))
    return _agreeing(with_link_stiffness(found, lambda joint: fit.data.link_stiffness(fit.base, joint)))


def weighed(
    fit: Solved,
    spread: Array,
    error: Mapping[str, JointError],
    refused: Mapping[str, str],
    freedom: float = np.inf,
    *,
    lenient: bool = False,
) -> Identification:
    """Return the base parameters of a fit with a verdict on each, as far as every estimator gives them alike.

    Parameters
    ----------
    fit
        The fit.
    spread
        Covariance of the base parameters, (b, b).
    error
        Error of each joint on data not used.
    refused, freedom
        See `verdicts.judge`.
    lenient
        Whether only what the log's rank leaves open is refused, however large the error of the rest.
    """
    base, solution, robot = fit.base, fit.solution, fit.model.robot
    known = solution.estimable(fit.transform)
    estimate = fit.transform @ solution.values
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    values = Estimates(base, estimate, deviation, torque_scale(base, fit.triangles), known)
    verdict, reasons = judge(values, robot, fit.data.facts, refused, freedom)
    if lenient:
        verdict = tuple("weak" if v == "refused" and known[k] else v for k, v in enumerate(verdict))
    unsaid = np.array([v == "refused" for v in verdict])
    reference = base.values(robot.reference())
    parameters, covariance = records(base, estimate, spread, unsaid, reference, verdict, reasons)
    return Identification(
        robot=robot,
        base=base,
        parameters=parameters,
        error=error,
        condition=solution.condition,
        rank_margin=solution.margin,
        rank=int(known.sum()),
        covariance=covariance,
        standard=fit.standard,
        delays=np.zeros(robot.n),
        warnings=suspicious(base, estimate, deviation, known),
        triangles=fit.triangles,
        with_nuisances=(fit.before or fit).triangles,
        weights=solution.weights,
    )


def _agreeing(found: Identification) -> Identification:
    """Return the identification without warnings of negative values that it does not print: another way gave these."""
    names = [str(item.leader) for item in found.parameters if item.estimate >= 0]
    warnings = tuple(w for w in found.warnings if w.partition(" = ")[0] not in names)
    return replace(found, warnings=warnings)


def _of_delivered(fit: DefaultFit, errors: Mapping[str, JointError]) -> dict[str, JointError]:
    """Return errors as shares of the torque that motors delivered where that is less than what was logged.

    A limit far below the torque would leave next to nothing to predict: of what was logged, the error would be small.
    """
    told = dict(errors)
    items = zip(fit.effects.effects, fit.effects.extras, fit.amplitudes(), strict=True) if fit.effects else ()
    for item, extra, values in items:
        name, row = fit.model.robot.joint_names[item.effect.joint], EstimationRow("sum", item.effect.joint)
        if item.effect.simulated == "motor" and name in told and row in extra.rows:
            group = fit.observation.group(row)
            acted = (group.target - values @ extra.rows[row])[group.use]
            told[name] = told[name].of_torque(float(np.sqrt(np.mean(acted**2))))
    return told


def _deviation(fit: DefaultFit, column: int) -> float:
    where = np.flatnonzero(fit.solution.basis == column)
    if not len(where):
        return float("nan")
    spreads = (fit.covariance,) if fit.scatter is None else (fit.covariance, fit.scatter)
    return float(np.sqrt(max(0.0, *(spread[where[0], where[0]] for spread in spreads))))


def _without_offsets(fit: DefaultFit) -> list[str]:
    """Return which parameters stand only if torque channels have no offset, as none would show beside them."""
    before, first = fit.before, fit.model.parameters
    if before is None:
        return []
    joints = [
        fit.model.robot.joint_names[sum_row(extra).joint]
        for number, extra in enumerate(before.nuisances)
        if extra.nuisance == "offset" and not before.solution.determined(first + number)
    ]
    lost = fit.solution.estimable(fit.transform) & ~before.solution.estimable(before.transform)
    names = [str(fit.base.names[k]) for k in np.flatnonzero(lost)]
    if not joints or not names:
        return []
    return [
        f"{' '.join(joints)}: this log cannot tell an offset of the torque, or friction that differs between the two "
        f"directions, from {', '.join(names)}: these are right if there is none"
    ]


def _nuisances(fit: DefaultFit) -> tuple[tuple[Nuisance, ...], Array]:
    robot, p = fit.model.robot, len(fit.base.parameters)
    moved = fit.data.facts.moved
    delays = moved + fit.late
    found = []
    for k, extra in enumerate(fit.nuisances):
        joint = sum_row(extra).joint
        kind = effect_classes()[extra.name].amplitudes[0].name
        value, error = float(fit.solution.values[p + k]), _deviation(fit, p + k)
        long = False
        if extra.nuisance == "delay":
            value = float(delays[joint])
            long = not of_sampling(delays[joint], np.array(error), fit.data.facts.dt)
        found.append(Nuisance(extra.name, robot.joints[joint].name, {kind: value}, {kind: error}, long=long))
    return tuple(found), delays


def _effects(fit: DefaultFit) -> tuple[FittedEffect, ...]:
    if fit.effects is None:
        return ()
    found = []
    for item, place in zip(fit.effects.effects, fit.amplitude_places, strict=True):
        scene, values = fit.effects.scene, fit.solution.values[place]
        named = item.effect.named(scene, values)
        found.append(
            FittedEffect(
                item.spec.effect, item.spec.joint, named, _named_errors(fit, item.effect, scene, values, place)
            )
        )
    return tuple(found)


def _named_errors(fit: DefaultFit, effect: Effect, scene: Scene, values: Array, place: slice) -> dict[str, float]:
    """Return standard errors of an effect's amplitudes as files name them, by first order; NaN where not estimated."""
    columns = range(place.start, place.stop)
    kept = [(k, int(w[0])) for k, c in enumerate(columns) if len(w := np.flatnonzero(fit.solution.basis == c))]
    if len(kept) < len(columns):
        return {p.name: _deviation(fit, place.start + d) for d, p in enumerate(effect.amplitudes)}
    spread = fit.covariance if fit.scatter is None else at_least(fit.covariance, np.diag(fit.scatter))
    named, places, slopes = effect.named(scene, values), [at for _, at in kept], []
    for k, _ in kept:
        step = 1e-4 * max(float(np.abs(values[k])), 1e-9)
        moved = effect.named(scene, values + step * np.eye(len(values))[k])
        slopes.append([(moved[name] - value) / step for name, value in named.items()])
    stiffness = float(scene.stiffness[effect.joint])
    if type(effect).unit(scene, effect.joint) == stiffness:  # angles come from torques by K, which has an error
        column = fit.model.names.index(StandardParameter("K", effect.joint))
        moved = effect.named(with_stiffness(scene, effect.joint, stiffness * (1.0 + 1e-4)), values)
        for at in np.flatnonzero(fit.solution.basis == column)[:1]:
            places.append(int(at))
            slopes.append([(moved[name] - value) / (1e-4 * stiffness) for name, value in named.items()])
    variance = np.einsum("ka,kl,la->a", np.array(slopes), spread[np.ix_(places, places)], np.array(slopes))
    amplitudes = {p.name for p in effect.amplitudes}
    return {
        name: float(np.sqrt(max(v, 0.0)))
        for name, v in zip(named, variance, strict=True)
        if name in amplitudes or v > 0
    }


def _settings(data: FitData, options: EstimateOptions) -> dict[str, object]:
    facts = data.facts
    return {
        "cutoff": facts.cutoff,
        "rate": facts.rate,
        "instants": facts.instants,
        "knots": [None if not np.isfinite(k) else float(k) for k in facts.knots],
        "min_velocity": [float(v) for v in facts.min_velocity],
        "masked": [float(v) for v in data.masked],
        "noise_q": [float(v) for v in facts.noise[0]],
        "noise_theta": [float(v) for v in facts.noise[1]],
        "noise_tau": [float(v) for v in facts.noise[2]],
        "velocity_used": facts.velocity_used,
        "estimator": options.estimator,
        "folds": options.folds,
    }


def _rotor_words(rotors: Mapping[int, tuple[float, float]], robot: Robot) -> list[str]:
    """Return a sentence for each rotor that friction or deflection under load tells."""
    said = []
    for joint, at_joint in rotors.items():
        name, ratio = robot.rotor_names[joint], robot.joints[joint].gear_ratio or 1.0
        if not at_joint[1] < ROTOR_KNOWN * at_joint[0]:
            continue  # the robot file's, about which the log says little
        inertia, error = (value / ratio**2 for value in at_joint)
        said.append(
            f"{name} is {inertia:.3g} ± {error:.1g} {'kg·m²' if robot.joints[joint].revolute else 'kg'} by what"
            " follows the load (friction or deflection); motion alone shows it in a sum"
        )
    return said


def with_unseen(found: Identification, robot: Robot) -> Identification:
    """Return the identification with the parameters named that a log cannot show for want of a signal."""
    reasons: dict[str, str] = {}
    notes: list[str] = []
    for k, (before, now) in enumerate(zip(robot.joints, found.robot.joints, strict=True)):
        if before.elastic and not now.elastic:
            side = "link" if now.torque_at == "motor" else "motor"
            why = f"{now.name} has no {side} position in this log: its transmission counts as rigid"
            reasons[StandardParameter("K", k)] = why
            notes.append(f"{StandardParameter('K', k)} cannot be identified: {why}")
        if now.torque_at == "link":
            reasons |= dict.fromkeys(motor_parameters(found.robot, k), f"{now.name} has {NO_MOTOR_TORQUE}")
    if any(joint.torque_at == "link" for joint in found.robot.joints):
        who = " ".join(joint.name for joint in found.robot.joints if joint.torque_at == "link")
        notes.append(f"{who}: no motor torque: the link side is identified from the joint torque sensors (tau_link)")
    return replace(found, hidden={**found.hidden, **reasons}, notes=(*found.notes, *notes)) if reasons else found


def motor_parameters(robot: Robot, joint: int) -> list[str]:
    """Return the names of a joint's parameters that only its motor's torque shows."""
    return [p for p in robot.parameter_names() if p.joint == joint and p.kind in MOTOR]
