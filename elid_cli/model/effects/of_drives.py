"""What a robot declares of its drives beyond the gains that a log tells."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.drives import Stepped, filter_weights
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.declared import resolve
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import told_by
from elid_cli.signals.late_velocity import delay_of
from elid_cli.signals.signals import Signals

SAME_TIME = 1.3
"""Times by which a drive's period may be off the sample time of a log that holds its torques."""
TUNED: tuple[Literal["kp", "kd"], ...] = ("kp", "kd")
"""Gains of a drive's loop that may be off alone."""
LOOPS = ("kp", "kd", "integral", "filter", "hold", "step")
"""What of a drive is in its loop, or in the steps of a simulator, and not in the torque that a log tells."""
OFTEN, STEPS = 20, 40
"""Most times per sample that a drive computes its torque, and that a simulator steps, which are simulated."""
BETWEEN, FEW, EXACTLY = 20, 5, 2e-3
"""Most samples that are a loop's period, or few of which are several of them, and part by which they may be off it."""
WHOLE = 0.05
"""Part by which a sample may be off a whole number of simulated steps, or of loops that are several in a sample."""


def declared_gains(robot: Robot) -> Array:
    """Return what the torques that a log tells are over those that act, (n,).

    Raises
    ------
    RobotError
        A declared gain leaves no torque.
    """
    gains = 1.0 + _declared(robot, "gain")
    for joint in np.flatnonzero(gains <= 0).tolist():
        raise RobotError(
            f"{robot.name}: {effect_that(of_drive='gain').name} of {robot.joint_names[joint]} leaves no torque",
            hint="it is the share by which the logged torque is too large, above -1",
        )
    return gains


def declared_loop_gains(robot: Robot) -> Array:
    """Return the kp, and the kd, that a log tells over the one that acts, of every joint's drive, (2, n).

    Raises
    ------
    RobotError
        A declared gain leaves none.
    """
    found = np.ones((2, robot.n))
    for own, which in zip(found, TUNED, strict=True):
        own += _declared(robot, which)
        for joint in np.flatnonzero(own <= 0).tolist():
            raise RobotError(
                f"{robot.name}: {effect_that(of_drive=which).name} of {robot.joint_names[joint]} leaves no gain",
                hint=f"it is the share by which the logged {which} is too large, above -1",
            )
    return found


def declared_integrals(robot: Robot) -> Array:
    """Return the integral over the proportional gain of every joint's drive, 1/s, (n,)."""
    return np.maximum(_declared(robot, "integral"), 0.0)


def declared_filters(robot: Robot) -> Array:
    """Return the time constant of the filter of velocity of every joint's drive, s, (n,)."""
    return np.maximum(_declared(robot, "filter"), 0.0)


def open_filters(robot: Robot) -> tuple[int, ...]:
    """Return the joints whose drives filter the velocity by what a robot declares without a time."""
    kinds = [(*resolve(robot, spec), spec) for spec in robot.effects]
    return tuple(joint for kind, joint, spec in kinds
                 if kind.of_drive == "filter" and kind.amplitudes[0].name not in spec.parameters)  # fmt: skip


def declared_loops(robot: Robot) -> Array:
    """Return the time for which every joint's drive holds its torque, s, (n,); 0 of one that acts all the time."""
    return np.maximum(_declared(robot, "hold"), 0.0)


def holding(robot: Robot, dt: float) -> Array:
    """Return how often in a sample of a log, s, drives compute the torque that they hold, (n,); 0: all the time.

    0, too, for loops of a very small period, and of one of which no few are a few samples.
    """
    return np.array([_often(dt / period) if period > 0 else 0.0 for period in declared_loops(robot).tolist()])


def _often(often: float) -> float:
    """Return how often in a sample a loop is simulated; 0: not at all."""
    parts = {Fraction(round(below * often), below) for below in range(1, BETWEEN + 1)}
    exact = [one for one in parts if one and (one.numerator == 1 or one.denominator <= FEW)
             and abs(float(one) - often) <= EXACTLY * often]  # fmt: skip
    near = min(exact, key=lambda one: one.denominator, default=None)
    if near is None and (whole := round(often)):
        rough = 1.0 / SAME_TIME < often < SAME_TIME if whole == 1 else abs(often - whole) < WHOLE * whole
        near = Fraction(whole) if rough else None
    return float(near) if near and near.numerator <= OFTEN else 0.0


def has_steps(robot: Robot) -> bool:
    """Return whether a robot declares that its logs are of a simulator that steps."""
    return any(resolve(robot, spec)[0].of_drive == "step" for spec in robot.effects)


def declared_steps(robot: Robot, dt: float) -> tuple[Stepped, float] | None:
    """Return how, and how long, s, the simulator steps that a robot declares its logs to be of.

    None where it declares none, or where a sample of the log, s, is no whole number of such steps.
    """
    step = float(_declared(robot, "step").max(initial=0.0))
    each = round(dt / step) if step > 0 else 0
    if not 1 <= each <= STEPS or abs(dt / step - each) > WHOLE * each:
        return None
    return "implicit" if _declared(robot, "step", 1).max() > 0.5 else "explicit", dt / each


def _declared(
    robot: Robot, which: Literal["gain", "kp", "kd", "integral", "filter", "hold", "step"], number: int = 0
) -> Array:
    """Return an amplitude of the declared effects of drives, the first one if no other is asked for, (n,)."""
    found = np.zeros(robot.n)
    for spec in robot.effects:
        kind, joint = resolve(robot, spec)
        if kind.of_drive == which:
            found[joint] = float(spec.parameters.get(kind.amplitudes[number].name, 0.0))
    return found


def with_loops(robot: Robot, signals: Signals) -> tuple[Robot, Signals]:
    """Return the robot without what it declares of its drives' loops, and the signals with the torques that hold it.

    That are gains of position, integral terms, filters of velocity, loops that hold, and a simulator's steps.
    """
    kept = tuple(spec for spec in robot.effects if resolve(robot, spec)[0].of_drive not in LOOPS)
    if signals.error_integrals is None or len(kept) == len(robot.effects):
        return robot, signals
    told = with_loop_gains(signals, declared_loop_gains(robot))
    told = with_filters(told, declared_filters(robot))
    told = with_steps(with_held_loops(told, holding(robot, signals.dt)), declared_steps(robot, signals.dt))
    return replace(robot, effects=kept), with_drives(told, declared_integrals(robot))


def as_acting(robot: Robot, signals: Signals) -> Signals:
    """Return the signals with the torques that act as the robot declares its drives, in place of what the log tells."""
    told = with_loop_gains(signals, declared_loop_gains(robot))
    told = with_filters(told, declared_filters(robot))
    told = with_steps(with_held_loops(told, holding(robot, signals.dt)), declared_steps(robot, signals.dt))
    return with_drives(told, declared_integrals(robot), declared_gains(robot))


def with_loop_gains(signals: Signals, gains: Array) -> Signals:
    """Return the signals with the torques of drives whose kp and kd are the logged ones over gains (2, n)."""
    recording = signals.recording
    if recording is None or not {"kp", "kd"} <= recording.commands.keys() or not np.any(gains != 1.0):
        return signals
    kp, kd = np.where(recording.commanded, 1.0 - 1.0 / gains, 0.0)
    tau, of_commands = signals.tau, signals.command_torque
    motion = signals.motion
    for share, gain, name, state in ((kp, "kp", "q_des", motion.theta), (kd, "kd", "dq_des", motion.dtheta)):
        asked, of_stairs = told_by(recording, gain, name)
        tau = tau - share * (asked - np.nan_to_num(recording.commands[gain]) * state)
        of_commands = None if of_commands is None else of_commands - share * of_stairs
    sums = None if signals.error_integrals is None else signals.error_integrals * (1.0 - kp)
    return replace(signals, tau=tau, command_torque=of_commands, error_integrals=sums)


def with_filters(signals: Signals, times: Array) -> Signals:
    """Return the signals with the torques of drives that damp by a filtered velocity, of time constants (n,), s.

    A torque that was computed from a logged velocity, late as the drive's own is, holds the filter already: what counts
    is what the logged one lacks of it.
    """
    recording = signals.recording
    if recording is None or "kd" not in recording.commands or not np.any(times):
        return signals
    from scipy.signal import lfilter  # most of a second

    tau, kd = signals.tau.copy(), np.nan_to_num(recording.commands["kd"])
    for joint in np.flatnonzero((times > 0) & recording.commanded).tolist():
        left = float(times[joint]) - _late(signals, joint)
        if left <= 0:
            continue
        _, _, whole, rise = filter_weights(np.array(left), signals.dt)
        for segment in signals.segments:
            here = slice(segment.start, segment.stop)
            speed = signals.motion.dtheta[here, joint]
            # the filter starts from the velocity that it would have had for long
            seen, _ = lfilter([rise, whole - rise], [1.0, whole - 1.0], speed, zi=[(1.0 - rise) * speed[0]])
            tau[here, joint] += kd[here, joint] * (speed - seen)
    return replace(signals, tau=tau)


def with_held_loops(signals: Signals, often: Array) -> Signals:
    """Return the signals with the torques of drives that compute them `often` times per sample, (n,), and hold them.

    About a sample's instant acts the mean of what was computed before it and at it. Of the commands that holds already.
    """
    recording = signals.recording
    if recording is None or not {"kp", "kd"} <= recording.commands.keys() or not np.any(often):
        return signals
    tau, (kp, kd) = signals.tau.copy(), (np.nan_to_num(recording.commands[name]) for name in ("kp", "kd"))
    motion = signals.motion
    for joint in np.flatnonzero((often > 0) & recording.commanded).tolist():
        back = kp[:, joint] * motion.theta[:, joint] + kd[:, joint] * motion.dtheta[:, joint]
        for segment in signals.segments:
            here = slice(segment.start + 1, segment.stop)
            tau[here, joint] += 0.5 / often[joint] * np.diff(back[segment.start : segment.stop])
    return replace(signals, tau=tau)


def with_steps(signals: Signals, steps: tuple[Stepped, float] | None) -> Signals:
    """Return the signals with the torques that act in a simulator's steps, of a kind and a length, s.

    The velocity that the drives damp is half a step late; where their damping is implicit, half a step early. Positions
    and commands act about a step's start: half a step before the time that a command is held for begins.
    """
    recording = signals.recording
    if recording is None or "kd" not in recording.commands or steps is None:
        return signals
    how, step = steps
    share = (0.5 if how == "explicit" else -0.5) * step / signals.dt
    tau, kd = signals.tau.copy(), np.nan_to_num(recording.commands["kd"])
    for joint in np.flatnonzero(recording.commanded).tolist():
        for segment in signals.segments:
            here = slice(segment.start, segment.stop)
            tau[here, joint] += share * kd[here, joint] * np.gradient(signals.motion.dtheta[here, joint])
    return replace(signals, tau=tau)


def _late(signals: Signals, joint: int) -> float:
    """Return by how much the velocity that a joint's torque was computed from is late, s; 0 where it does not show."""
    recording = signals.recording
    assert recording is not None
    rates = [part for part in (recording.dq, recording.dtheta) if part is not None]
    logged = [part[:, joint] for part in rates if np.isfinite(part[:, joint]).any()]
    longest = max(signals.segments, key=len)
    here = slice(longest.start, longest.stop)
    found = delay_of(recording.theta[here, joint], logged[0][here], signals.dt, joint) if logged else None
    return 0.0 if found is None else max(found.value, 0.0)


def with_drives(signals: Signals, integrals: Array, gains: Array | float = 1.0) -> Signals:
    """Return the signals with the torques of drives with integral terms, 1/s, and gains, (n,) each."""
    if signals.error_integrals is None or not (np.any(integrals) or np.any(gains != 1.0)):
        return signals
    error, asked = signals.error_integrals
    commanded = None if signals.command_torque is None else (signals.command_torque + integrals * asked) / gains
    return replace(
        signals, tau=(signals.tau + integrals * error) / gains, command_torque=commanded,
        error_integrals=signals.error_integrals / gains,
    )  # fmt: skip
