"""The output-error fit of a log with torque as an identification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError, in_words
from elid_cli.estimation.output_error.equations import MotionEquations
from elid_cli.estimation.output_error.fit import OutputErrorFit, fit_output_error
from elid_cli.estimation.output_error.simulated import Unknowns
from elid_cli.estimation.refined_robot import refined_robot, representative
from elid_cli.estimation.result import Identification, Nuisance
from elid_cli.estimation.trajectory.found_effects import delay_name, offset_name
from elid_cli.estimation.trajectory.held_out import by_simulated_motion, held_out_errors
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.shifts import Shifts, corrected
from elid_cli.model.runs import runs_of
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

NOISIEST = 5.6e-4
"""Noise of a position over the spread of its motion (65 dB) beyond which short windows do not tell the states."""
WORSE = 2.0
"""Times the error of least squares from which this fit is called the worse one."""
MOVED = 2.0
"""Standard errors from what least squares say beyond which a parameter may be biased by what is missing."""
SHOWN = 3.0
"""Standard errors beyond which a delay is told."""


def by_output_error(found: Identification, signals: Signals) -> Identification:
    """Return the identification by the motion that the logged torques make, started from least squares.

    Parameters
    ----------
    found
        What least squares say of the same log.
    signals
        The log, with its recording.

    Raises
    ------
    UsageError
        The robot declares effects that this fit does not hold, or has a joint whose torque is read behind the motor.
    LogError
        No torque or position of a joint, or positions too noisy for windows with states of their own.
    DataError
        No window can be simulated.
    """
    robot, recording = found.robot, signals.recording
    assert recording is not None
    _check(robot, recording, signals)
    own = Unknowns(MotionEquations(robot, found.base))
    runs = runs_of(recording, robot, None, np.zeros(robot.n), commanded=False)
    if not runs:
        raise LogError("no stretch of the log is long enough to be simulated under its torque")
    z = np.zeros(own.count)
    z[: own.base] = found.base.transform @ found.standard
    z[own.delay] = float(np.mean(found.delays))
    for item in found.nuisances:
        if effect_classes()[item.effect].nuisance == "offset":
            z[own.offsets.start + robot.joint_names.index(item.joint)] = item.parameters["offset"]
    return _identification(found, fit_output_error(own, runs, signals, own.possible(z)), signals)


def _check(robot: Robot, recording: Recording, signals: Signals) -> None:
    """Refuse what the fit does not know (`by_output_error`)."""
    hint = "leave --fit out: the torque is fitted"
    for spec in robot.effects:
        if resolve(robot, spec)[0].nuisance not in ("offset", "delay"):
            raise UsageError(f"--fit trajectory: on a log with torque it holds no effects, and {robot.name} declares "
                             f"{spec.effect}", hint=hint)  # fmt: skip
    sides = {"q": (recording.q, signals.noise.q, signals.motion.q),
             "theta": (recording.theta, signals.noise.theta, signals.motion.theta)}  # fmt: skip
    for k, joint in enumerate(robot.joints):
        if joint.torque_at == "link":
            raise UsageError(f"--fit trajectory: {joint.name} has no motor torque", hint=hint)
        if np.isnan(recording.tau[:, k]).all():
            raise LogError(f"--fit trajectory: the log holds no torque of {joint.name}")
        for name, (values, noise, motion) in sides.items():
            seen = not np.isnan(values[:, k]).all()
            if joint.elastic and not seen:
                raise LogError(f"--fit trajectory: {joint.name} is elastic and has no {name} in this log", hint=hint)
            spread = float(np.std(motion[:, k]))
            if seen and not signals.still[k] and noise[k] > NOISIEST * spread:
                level = 20 * np.log10(spread / noise[k])
                raise LogError(
                    f"--fit trajectory: {name} of {joint.name} is too noisy ({level:.0f} dB): a window's start is not "
                    "known well enough for its torque to tell the rest",
                    hint="--accurate estimates the whole trajectory and serves down to 40 dB",
                )


def _identification(found: Identification, fit: OutputErrorFit, signals: Signals) -> Identification:
    robot, base, own = found.robot, found.base, fit.unknowns
    part = slice(0, own.base)
    estimate, spread = fit.z[part], fit.covariance[part, part]
    late = np.full(robot.n, fit.z[own.delay])
    moved = corrected(signals, replace(Shifts.none(robot.n), torque=late))
    left = [_robot(found, fit, z) for z in fit.left_out]
    rms, before = fit.last.rms, fit.rms_before
    count = fit.windows.count
    note = (
        f"--fit trajectory: {fit.steps} steps; {count} windows of {fit.seconds:.2g} s simulated under the logged "
        f"torque, each from a state of its own; positions are off by {1e3 * rms.mean():.3g} mrad or mm (rms) on "
        f"average, {1e3 * before.mean():.3g} with the values of least squares"
    )
    if fit.windows.resting:
        note += f"; {fit.windows.resting} windows in which a motor rests are left out"
    error = held_out_errors(left, fit.spans, moved, found)
    worse = [
        name
        for name, one in error.items()
        if name in found.error and one.rms > WORSE * max(found.error[name].rms, 1e-12)
    ]
    if worse and found.model == "insufficient":
        note += (
            f"; the torque of {in_words(worse)} is predicted worse than by least squares: what the model lacks bends "
            "a motion that is simulated more than a torque (leave --fit out)"
        )
    told = by_simulated_motion(
        found, estimate, spread, found.reference,
        error=error,
        standard=representative(base, estimate, robot.reference()),
        delays=late,
        nuisances=_nuisances(robot, fit),
        notes=(note,),
        settings=_settings(robot, fit),
    )  # fmt: skip
    return _with_bias(told, found) if found.model == "insufficient" else told


def _with_bias(told: Identification, found: Identification) -> Identification:
    """Return the fit with those parameters marked that least squares see elsewhere: something is missing."""
    marked = [
        replace(item, bias_possible=own.bias_possible
                or abs(item.estimate - own.estimate) > MOVED * float(np.hypot(item.std_error, own.std_error)))
        for item, own in zip(told.parameters, found.parameters, strict=True)
    ]  # fmt: skip
    return replace(told, parameters=tuple(marked))


def _robot(found: Identification, fit: OutputErrorFit, z: Array) -> Robot:
    """Return the robot with unknowns (C,) and its offsets, its torques acting as logged."""
    own, base = fit.unknowns, found.base
    standard = representative(base, z[: own.base], found.robot.reference())
    specs = [EffectSpec(offset_name(), name, {"offset": float(value)})
             for name, value in zip(found.robot.joint_names, z[own.offsets], strict=True)]  # fmt: skip
    return refined_robot(found.robot, standard, specs)


def _nuisances(robot: Robot, fit: OutputErrorFit) -> tuple[Nuisance, ...]:
    """Return the torque offset of every joint, and the delay of all where it shows."""
    own, deviation = fit.unknowns, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    late, unsure = float(fit.z[own.delay]), float(deviation[own.delay])
    names: Sequence[str] = robot.joint_names if abs(late) > SHOWN * unsure else ()
    offsets = zip(robot.joint_names, fit.z[own.offsets].tolist(), deviation[own.offsets].tolist(), strict=True)
    return (
        *(Nuisance(offset_name(), name, {"offset": value}, {"offset": sd}) for name, value, sd in offsets),
        *(Nuisance(delay_name(), name, {"delay": late}, {"delay": unsure}) for name in names),
    )


def _settings(robot: Robot, fit: OutputErrorFit) -> dict[str, object]:
    """Return what JSON says of the fit: errors of the positions by joint, rad (m); the motors' of elastic joints."""
    own = fit.unknowns
    motors = own.equations.coordinates.motors

    def by_joint(values: Array) -> dict[str, float]:
        return dict(zip(robot.joint_names, values.tolist(), strict=True))

    rms, before = fit.last.rms, fit.rms_before
    return {
        "steps": fit.steps,
        "window": fit.seconds,
        "windows": fit.windows.count,
        "delays": [float(fit.z[own.delay])],
        "position_rms": by_joint(rms[: robot.n]),
        "position_rms_before": by_joint(before[: robot.n]),
        "motor_position_rms": by_joint(rms[motors]),
    }
