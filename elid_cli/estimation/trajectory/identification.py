"""A trajectory fit as an identification: base parameters, torque offsets, and what is held at the file's values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.result import Identification, JointError, Nuisance, Verdict, records
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fit_trajectory
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.estimation.validation.prediction import validate
from elid_cli.estimation.validation.verdicts import HELD, REFUSED, WEAK
from elid_cli.model.effects import effect_that
from elid_cli.model.regressor import Regressor
from elid_cli.model.rollout import Linearised
from elid_cli.model.runs import runs_of
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import Signals

SLOW = 0.1
"""Part of the usual speed below which friction is not looked at for the start."""


def by_trajectory(found: Identification, signals: Signals) -> Identification:
    """Return the identification by the simulated motion, started from the log's torques.

    Parameters
    ----------
    found
        What least squares say of the same log.
    signals
        The log, with its recording.

    Raises
    ------
    UsageError
        A robot that this fit does not know: elastic joints, joints with a gear ratio, effects.
    LogError
        The log holds no commands.
    RobotError
        Parameters of bodies are unknown.
    """
    robot, recording = _suited(found.robot), signals.recording
    if recording is None or "q_des" not in recording.commands:
        raise LogError("--fit trajectory: the log holds no commands q_des",
                       hint="leave --fit out: the torque is fitted")  # fmt: skip
    runs = runs_of(recording, robot, None, np.zeros(robot.n), commanded=True)
    if not runs:
        raise LogError("--fit trajectory: no stretch of the log is long enough to be simulated")
    fit = fit_trajectory(robot, runs, _start(robot, signals))
    return _told(found, robot, fit, signals)


def _suited(robot: Robot) -> Robot:
    for joint in robot.joints:
        why = (
            "is elastic" if joint.elastic
            else "has a gear_ratio: this fit finds the reflected inertia Ja" if joint.gear_ratio is not None
            else ""
        )  # fmt: skip
        if why:
            raise UsageError(f"--fit trajectory: {joint.name} {why}", hint="leave --fit out: the torque is fitted")
    lost = [spec.effect for spec in robot.effects if spec.effect != _offset()]
    if lost:
        raise UsageError(f"--fit trajectory does not hold the effect {lost[0]} that the robot file declares")
    return robot


def _offset() -> str:
    """Return the name of the effect that a torque offset is."""
    return effect_that(nuisance="offset").name


def _start(robot: Robot, signals: Signals) -> Array:
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


def _told(found: Identification, robot: Robot, fit: TrajectoryFit, signals: Signals) -> Identification:
    base, names = found.base, list(found.base.parameters)
    places = np.array([[names.index(StandardParameter(kind, k)) for kind in PARAMETERS] for k in range(robot.n)])
    covariance = np.zeros((len(names), len(names)))
    for chain, own in zip(fit.chains.joints, fit.covariance, strict=True):
        at = places[chain].ravel()
        kept = np.flatnonzero(np.arange(len(own)) % len(KINDS) < len(PARAMETERS))
        covariance[np.ix_(at, at)] = own[np.ix_(kept, kept)]
    standard = _standard(robot, places, fit.values)
    estimate = base.transform @ standard
    spread = base.transform @ covariance @ base.transform.T
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    verdicts, reasons = _verdicts(found, estimate, deviation)
    refused = np.array([verdict == "refused" for verdict in verdicts])
    errors = fit.deviation()
    offsets = tuple(
        Nuisance(_offset(), joint.name, {"offset": float(fit.values[k, 3])}, {"offset": float(errors[k, 3])})
        for k, joint in enumerate(robot.joints)
    )
    note = (
        f"--fit trajectory: {fit.steps} steps; simulated positions are off by {1e3 * fit.rms.mean():.3g} mrad (rms) on "
        f"average, {1e3 * fit.rms_before.mean():.3g} with the values of least squares; bodies are held at the file's"
    )
    return replace(
        found,
        parameters=records(
            base, np.where(refused, np.nan, estimate), np.where(refused, np.nan, deviation),
            base.values(robot.reference()), verdicts, reasons,
        ),
        error=_held_out(robot, places, fit, signals, found),
        covariance=np.where(refused[:, None] | refused[None], np.nan, spread),
        standard=standard,
        delays=np.zeros(robot.n),
        nuisances=offsets,
        estimator="trajectory",
        notes=(*found.notes, note),
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


def _held_out(
    robot: Robot, places: Array, fit: TrajectoryFit, signals: Signals, found: Identification
) -> dict[str, JointError]:
    """Return torque errors of every block of time, predicted with the values that were found without it."""
    model = Regressor(robot)
    observation = observe(model, signals)
    sources = np.array([segment.source for segment in signals.segments], dtype=np.intp)[observation.stretch]
    squares: dict[str, float] = dict.fromkeys(robot.joint_names, 0.0)
    counts: dict[str, int] = dict.fromkeys(robot.joint_names, 0)
    torques: dict[str, float] = dict.fromkeys(robot.joint_names, 0.0)
    for values, (source, first, last) in zip(fit.left_out, fit.spans, strict=True):
        inside = (sources == source) & (observation.t >= first) & (observation.t <= last)
        joints = tuple(
            replace(joint, parameters={**joint.parameters, **dict(zip(PARAMETERS, row[:3].tolist(), strict=True))})
            for joint, row in zip(robot.joints, values, strict=True)
        )
        offsets = tuple(EffectSpec(_offset(), joint.name, {"offset": float(row[3])})
                        for joint, row in zip(robot.joints, values, strict=True))  # fmt: skip
        judged = validate(replace(robot, joints=joints, effects=offsets), signals, inside, observation=observation)
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


def _settings(robot: Robot, fit: TrajectoryFit) -> dict[str, object]:
    """Return what JSON says of the fit: errors of the positions, rad (m), and every unknown with its errors."""
    names, errors = (*PARAMETERS, "offset"), fit.deviation()
    return {
        "steps": fit.steps,
        "position_rms": dict(zip(robot.joint_names, fit.rms.tolist(), strict=True)),
        "position_rms_before": dict(zip(robot.joint_names, fit.rms_before.tolist(), strict=True)),
        "joint_parameters": {
            joint: {
                name: {"estimate": float(fit.values[k, c]), "std_error": float(errors[k, c]),
                       "between_recordings": float(fit.between[k, c])}
                for c, name in enumerate(names)
            }
            for k, joint in enumerate(robot.joint_names)
        },
    }  # fmt: skip
