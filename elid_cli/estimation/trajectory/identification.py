"""A trajectory fit as an identification: base parameters, torque offsets, and what is held at the file's values."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.result import FittedEffect, Identification, Nuisance, Verdict, records
from elid_cli.estimation.trajectory.acting import acting, can_act, declared, scene_along
from elid_cli.estimation.trajectory.differing import Differing, as_last, differing
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fit_trajectory
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.estimation.validation.prediction import validate
from elid_cli.estimation.validation.verdicts import HELD, REFUSED, WEAK
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.model.effects.shifts import Shifts, corrected
from elid_cli.model.regressor import Regressor
from elid_cli.model.rollout import Linearised
from elid_cli.model.runs import Run, runs_of
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

CONSTANT = 1e-9
"""Relative change of a torque that counts as none."""
SHOWN = 3.0
"""Standard errors beyond which a delay is told."""
SLOW = 0.1
"""Part of the usual speed below which friction is not looked at for the start."""


def by_trajectory(found: Identification, signals: Signals, *, delays: bool = True) -> Identification:
    """Return the identification by the simulated motion, started from the log's torques.

    Parameters
    ----------
    found
        What least squares say of the same log.
    signals
        The log, with its recording.
    delays
        Whether a delay between commands and motion is an unknown.

    Raises
    ------
    UsageError
        A robot that this fit does not know: elastic joints, joints with a gear ratio, effects that the motion alone
        does not determine.
    LogError
        The log holds no commands.
    RobotError
        Parameters of bodies are unknown.
    """
    robot = found.robot
    if why := unsuited(robot):
        raise UsageError(f"--fit trajectory: {why}", hint="leave --fit out: the torque is fitted")
    recording = signals.recording
    if recording is None or "q_des" not in recording.commands:
        raise LogError("--fit trajectory: the log holds no commands q_des",
                       hint="leave --fit out: the torque is fitted")  # fmt: skip
    runs = commanded_runs(recording, robot)
    effects, amplitudes = declared_along(robot, runs[0])
    fit = fit_trajectory(robot, runs, started_from(robot, signals), effects, amplitudes, late=delays)
    return identification_of(found, as_last(fit, differing(fit)), signals)


def unsuited(robot: Robot) -> str:
    """Return why the trajectory fit does not know a robot, as a clause; empty where it does."""
    for joint in robot.joints:
        if joint.elastic:
            return f"{joint.name} is elastic"
        if joint.gear_ratio is not None:
            return f"{joint.name} has a gear_ratio: this fit finds the reflected inertia Ja"
    for spec in robot.effects:
        kind, _ = resolve(robot, spec)
        if not can_act(kind) and kind.nuisance not in ("offset", "delay"):
            return f"it does not hold the effect {spec.effect} that the robot file declares"
    return ""


def commanded_runs(recording: Recording, robot: Robot) -> list[Run]:
    """Return the stretches of a log that its commands drive.

    Raises
    ------
    LogError
        The log has none that is long enough.
    """
    runs = runs_of(recording, robot, None, np.zeros(robot.n), commanded=True)
    if not runs:
        raise LogError("no stretch of the log is long enough to be simulated under its commands")
    return runs


def declared_along(robot: Robot, run: Run) -> tuple[list[Effect], list[float]]:
    """Return the effects that a robot declares and a motion can hold, with their amplitudes."""
    if not robot.effects:
        return [], []
    item = Tracked.of(run)
    local = item.equations(Linearised(robot, without=PARAMETERS))
    scene = scene_along(robot, item.x, item.v, local, run.dt, robot.reference(), len(item.x))
    known = [own for spec in robot.effects if (own := declared(robot, spec, scene)) is not None]
    return [effect for effect, _ in known], [float(a) for _, amplitudes in known for a in amplitudes]


def _offset() -> str:
    """Return the name of the effect that a torque offset is."""
    return effect_that(nuisance="offset").name


def _delay() -> str:
    """Return the name of the effect that a delay of the drives is."""
    return effect_that(nuisance="delay").name


def started_from(robot: Robot, signals: Signals) -> Array:
    """Return drive parameters to start from, (n, 4): least squares joint by joint, the bodies as the file says."""
    motion = signals.motion
    q, dq, ddq = motion.theta, motion.dtheta, motion.ddtheta
    local = Linearised(robot, without=PARAMETERS).about(q[:, None], dq[:, None])
    left = signals.tau - local.force[:, 0] - np.einsum("nij,nj->ni", local.mass[:, 0], ddq)
    values = np.empty((robot.n, len(KINDS)))
    for k in range(robot.n):
        speed = dq[:, k]
        usual = max(float(np.sqrt(np.mean(speed**2))), 1e-9)
        use = (np.abs(speed) > SLOW * usual) & np.isfinite(left[:, k])
        columns = np.stack([ddq[:, k], np.sign(speed), speed, np.ones_like(speed)], axis=1)[use]
        values[k] = np.linalg.lstsq(columns, left[use, k], rcond=None)[0]
    typical = np.maximum(np.median(values[:, :3], axis=0), 1e-4)
    values[:, :3] = np.maximum(values[:, :3], 0.2 * typical)
    return values


def identification_of(found: Identification, fit: TrajectoryFit, signals: Signals) -> Identification:
    """Return a trajectory fit as an identification.

    Parameters
    ----------
    found
        What least squares say of the same log.
    fit
        The fit.
    signals
        The log.
    """
    robot = found.robot
    base, names = found.base, list(found.base.parameters)
    places = np.array([[names.index(StandardParameter(kind, k)) for kind in PARAMETERS] for k in range(robot.n)])
    covariance = np.zeros((len(names), len(names)))
    kept = np.flatnonzero(np.arange(fit.unknowns.drives) % len(KINDS) < len(PARAMETERS))
    covariance[np.ix_(places.ravel(), places.ravel())] = fit.covariance[np.ix_(kept, kept)]
    standard = _standard(robot, places, fit.values)
    estimate = base.transform @ standard
    spread = base.transform @ covariance @ base.transform.T
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    verdicts, reasons = _verdicts(found, estimate, deviation)
    refused = np.array([verdict == "refused" for verdict in verdicts])
    nuisances, effects = channel_faults(robot, fit), fitted_effects(robot, fit)
    apart = [difference_words(item) for item in differing(fit)]
    note = (
        f"--fit trajectory: {fit.steps} steps; simulated positions are off by {1e3 * fit.rms.mean():.3g} mrad (rms) on "
        f"average, {1e3 * fit.rms_before.mean():.3g} with the values of least squares; the motion is "
        f"{', '.join(f'{1e3 * d:.2g}' for d in fit.delays)} ms later than the commands; bodies are held at the file's"
    )
    return replace(
        found,
        parameters=records(
            base, np.where(refused, np.nan, estimate), np.where(refused, np.nan, deviation),
            base.values(robot.reference()), verdicts, reasons,
        ),
        error=torque_errors(fit, signals, found),
        covariance=np.where(refused[:, None] | refused[None], np.nan, spread),
        standard=standard,
        delays=np.zeros(robot.n),
        nuisances=nuisances,
        effects=effects,
        estimator="trajectory",
        warnings=(),
        notes=(*found.notes, note, *apart),
        settings={**found.settings, "estimator": "trajectory", "trajectory": _settings(robot, fit)},
    )  # fmt: skip


def _standard(robot: Robot, places: Array, values: Array) -> Array:
    standard = np.nan_to_num(robot.reference())
    standard[places] = values[:, : len(PARAMETERS)]
    return standard


def _verdicts(found: Identification, estimate: Array, deviation: Array) -> tuple[tuple[Verdict, ...], dict[str, str]]:
    verdicts: list[Verdict] = []
    reasons: dict[str, str] = {}
    for item, value, error in zip(found.parameters, estimate, deviation, strict=True):
        if error == 0:
            verdicts.append("refused")
            reasons[item.leader] = f"{HELD} (--fit trajectory)"
        elif error > REFUSED * abs(value):
            verdicts.append("refused")
            reasons[item.leader] = f"standard deviation {error:.2g} against a value of {value:.2g}"
        elif error > WEAK * abs(value):
            verdicts.append("weak")
            reasons[item.leader] = f"known to {error / abs(value):.0%} only"
        else:
            verdicts.append("supported")
    return tuple(verdicts), reasons


def difference_words(item: Differing) -> str:
    """Return what recordings do not agree on, in a sentence."""
    values = ", ".join(f"{value:.3g}" for value in item.values)
    change = f"; it changed before recording {item.changed_at + 1}" if item.changed_at is not None else ""
    return f"the recordings do not agree on {item.name} of {item.joint}: {values} {item.unit}{change}"


def channel_faults(robot: Robot, fit: TrajectoryFit) -> tuple[Nuisance, ...]:
    """Return the torque offset of every joint, and the delay of all: the mean of the recordings'."""
    values, errors = fit.unknowns.joint_values(settled(fit)), fit.unknowns.joint_values(fit.deviation)
    late, unsure = float(fit.delays.mean()), float(np.sqrt(np.mean(fit.deviation[fit.unknowns.delays] ** 2)))
    scatter = float(np.std(fit.delays, ddof=1)) if len(fit.delays) > 1 else 0.0
    names, unsure = robot.joint_names, math.hypot(unsure, scatter)
    shown = names if abs(late) > SHOWN * unsure else ()
    return (
        *(Nuisance(_offset(), name, {"offset": float(values[k, 3])}, {"offset": float(errors[k, 3])})
          for k, name in enumerate(names)),
        *(Nuisance(_delay(), name, {"delay": late}, {"delay": unsure}) for name in shown),
    )  # fmt: skip


def settled(fit: TrajectoryFit) -> Array:
    """Return the unknowns (U,) with effects that push a joint nowhere on the whole: the offset holds what is constant.

    An amplitude that only adds a constant torque, as the preload of a spring, cannot be told from the offset.
    """
    z, own = fit.z.copy(), fit.unknowns
    scene = scene_of_fit(fit)
    for place, effect in enumerate(own.effects):
        part = own.amplitudes_of(place)
        pushed = acting((effect,), scene).push[:, :, effect.joint]
        constant = np.ptp(pushed, axis=1) <= CONSTANT * np.maximum(np.abs(pushed).max(axis=1), 1e-300)
        for k in np.flatnonzero(constant & (np.abs(pushed[:, 0]) > 0)):
            rest = float((z[part] @ pushed).mean() - z[part.start + k] * pushed[k, 0])
            z[3 + effect.joint * len(KINDS)] += z[part.start + k] * pushed[k, 0] + rest
            z[part.start + k] = -rest / pushed[k, 0]
    return z


def scene_of_fit(fit: TrajectoryFit) -> Scene:
    """Return the scene of the first stretch's simulated motion."""
    item, robot = fit.tracked[0], fit.unknowns.robot
    local = item.equations(Linearised(robot, without=PARAMETERS))
    return scene_along(robot, item.x, item.v, local, item.run.dt, robot.reference(), len(item.x))


def fitted_effects(robot: Robot, fit: TrajectoryFit) -> tuple[FittedEffect, ...]:
    """Return the effects that a fit holds, with standard errors of their amplitudes at given shapes."""
    z, scene, found = settled(fit), None, []
    for place, effect in enumerate(fit.unknowns.effects):
        scene = scene_of_fit(fit) if scene is None else scene
        part = fit.unknowns.amplitudes_of(place)
        found.append(FittedEffect(effect.name, robot.joint_names[effect.joint], effect.named(scene, z[part]),
                                  _named_errors(effect, scene, z[part], fit.covariance[part, part])))  # fmt: skip
    return tuple(found)


def _named_errors(effect: Effect, scene: Scene, amplitudes: Array, covariance: Array) -> dict[str, float]:
    """Return standard errors of named parameters by first-order propagation."""
    centre = effect.named(scene, amplitudes)
    slopes = []
    for k in range(len(amplitudes)):
        step = 1e-4 * max(abs(float(amplitudes[k])), 1e-9)
        moved = effect.named(scene, amplitudes + step * np.eye(len(amplitudes))[k])
        slopes.append([(moved[name] - centre[name]) / step for name in centre])
    spread = np.sqrt(np.maximum(np.einsum("ka,kl,la->a", slopes, covariance, slopes), 0.0))
    return {name: float(s) for name, s in zip(centre, spread, strict=True) if s > 0}


def robot_of(fit: TrajectoryFit, z: Array) -> Robot:
    """Return the robot with unknowns (U,), its offsets and effects, without delays."""
    robot, values = fit.unknowns.robot, fit.unknowns.joint_values(z)
    joints = tuple(
        replace(joint, parameters={**joint.parameters, **dict(zip(PARAMETERS, row[:3].tolist(), strict=True))})
        for joint, row in zip(robot.joints, values, strict=True)
    )
    scene = scene_of_fit(fit) if fit.unknowns.effects else None
    specs = [EffectSpec(_offset(), joint.name, {"offset": float(row[3])})
             for joint, row in zip(robot.joints, values, strict=True)]  # fmt: skip
    for place, effect in enumerate(fit.unknowns.effects):
        assert scene is not None
        named = effect.named(scene, z[fit.unknowns.amplitudes_of(place)])
        specs.append(EffectSpec(effect.name, robot.joint_names[effect.joint], named))
    return replace(robot, joints=joints, effects=tuple(specs))


def torque_errors(fit: TrajectoryFit, signals: Signals, found: Identification) -> dict[str, JointError]:
    """Return torque errors of every block of time, predicted with the values that were found without it.

    The torque is that of commands which act as late as the fit says.
    """
    robot = fit.unknowns.robot
    signals = with_late_commands(signals, fit.delays)
    model = Regressor(replace(robot, effects=()))
    observation = observe(model, signals)
    sources = np.array([segment.source for segment in signals.segments], dtype=np.intp)[observation.stretch]
    squares: dict[str, float] = dict.fromkeys(robot.joint_names, 0.0)
    counts: dict[str, int] = dict.fromkeys(robot.joint_names, 0)
    torques: dict[str, float] = dict.fromkeys(robot.joint_names, 0.0)
    for z, (source, first, last) in zip(fit.left_out, fit.spans, strict=True):
        inside = (sources == source) & (observation.t >= first) & (observation.t <= last)
        judged = validate(robot_of(fit, z), signals, inside, observation=observation)
        for name, error in judged.error.items():
            row = next(group for group in observation.groups if group.row.joint == robot.joint_names.index(name))
            count = int(np.count_nonzero(row.use & inside))
            squares[name] += error.rms**2 * count
            torques[name] += error.torque_rms**2 * count
            counts[name] += count
    result = {}
    for name in robot.joint_names:
        if counts[name]:
            rms, torque = np.sqrt(squares[name] / counts[name]), np.sqrt(torques[name] / counts[name])
            known = found.error.get(name)
            floor = known.floor if known is not None else None
            result[name] = JointError(float(rms), float(rms / torque), None, None, float(torque), floor)
    return result


def with_late_commands(signals: Signals, delays: Array) -> Signals:
    """Return the signals with torques of commands that act later than logged, s, (R,), by recording."""
    tau = signals.tau.copy()
    for source, late in enumerate(delays):
        own = corrected(signals, Shifts(np.zeros(signals.n), np.full(signals.n, late)), commands=True).tau
        for segment in signals.segments:
            if segment.source == source:
                tau[segment.start : segment.stop] = own[segment.start : segment.stop]
    return replace(signals, tau=tau)


def _settings(robot: Robot, fit: TrajectoryFit) -> dict[str, object]:
    """Return what JSON says of the fit: errors of the positions, rad (m), and every unknown with its errors."""
    names, errors = (*PARAMETERS, "offset"), fit.unknowns.joint_values(fit.deviation)
    between = fit.unknowns.joint_values(fit.between)
    return {
        "steps": fit.steps,
        "delays": fit.delays.tolist(),
        "position_rms": dict(zip(robot.joint_names, fit.rms.tolist(), strict=True)),
        "position_rms_before": dict(zip(robot.joint_names, fit.rms_before.tolist(), strict=True)),
        "joint_parameters": {
            joint: {
                name: {"estimate": float(fit.values[k, c]), "std_error": float(errors[k, c]),
                       "between_recordings": float(between[k, c])}
                for c, name in enumerate(names)
            }
            for k, joint in enumerate(robot.joint_names)
        },
    }  # fmt: skip
