"""Channels put right: those that were sampled at other instants than the rest, and torque that was only asked for.

A skewed link encoder or a late torque is first found through its first-order column and then corrected exactly, by
interpolation, so that no higher-order remainder is left for another effect to explain. A motor that delivers less
than was logged is put right as well: a prediction is then of what it delivered, and never made of what was logged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Channel, Effect
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.signals import Signals
from elid_cli.signals.time_shift import shifted


@dataclass(frozen=True)
class Shifts:
    """By how much channels are late, s, (n,) each."""

    link: Array
    """Age of the link encoder's reading beyond the motor encoder's."""
    torque: Array
    """How much later than logged the torque acts."""

    @classmethod
    def none(cls, n: int) -> Shifts:
        """Return no shift for n joints."""
        return cls(np.zeros(n), np.zeros(n))

    def of(self, channel: Channel, joint: int) -> float:
        """Return how late a channel is, s."""
        return float((self.link if channel == "link" else self.torque)[joint])

    def moved(self, channel: Channel, joint: int, value: float) -> Shifts:
        """Return the shifts with one of them set to `value` (s)."""
        late = (self.link if channel == "link" else self.torque).copy()
        late[joint] = value
        return replace(self, link=late) if channel == "link" else replace(self, torque=late)

    def __bool__(self) -> bool:
        return bool(np.any(self.link) or np.any(self.torque))


def declared_shifts(robot: Robot) -> Shifts:
    """Return the shifts that a robot file declares among its effects; an effect without a value counts as 0.

    Raises
    ------
    RobotError
        An effect at a joint that the robot does not have.
    """
    shifts = Shifts.none(robot.n)
    for spec in robot.effects:
        if (channel := _moved_by(spec)) is None:
            continue
        if spec.joint not in robot.joint_names:
            raise RobotError(f"{robot.name}: effect {spec.effect} needs a joint of the robot, not {spec.joint!r}")
        joint = robot.joint_names.index(spec.joint)
        late = effect_classes()[spec.effect].amplitudes[0].name
        shifts = shifts.moved(channel, joint, float(spec.parameters.get(late, 0.0)))
    return shifts


def unshifted_robot(robot: Robot) -> Robot:
    """Return the robot without the effects that are shifts in time."""
    return replace(robot, effects=tuple(spec for spec in robot.effects if _moved_by(spec) is None))


def _moved_by(spec: EffectSpec) -> Channel | None:
    """Return the channel that a declared effect moves; None of one that is not known."""
    kind = effect_classes().get(spec.effect)
    return None if kind is None else kind.corrects


def corrected(signals: Signals, shifts: Shifts, *, commands: bool = False) -> Signals:
    """Return the signals with late channels moved to where they belong, segment by segment.

    Parameters
    ----------
    signals
        As logged.
    shifts
        By how much channels are late.
    commands
        Of torques that were computed from commands, whether the commands are late, while the drive has the positions
        in them at once; else the torque as a whole.
    """
    if not shifts:
        return signals
    motion, tau = signals.motion, signals.tau.copy()
    told = _told_later(signals, shifts) if commands else None
    link = [motion.q.copy(), motion.dq.copy(), motion.ddq.copy()]
    for segment in signals.segments:
        part = slice(segment.start, segment.stop)
        for k in range(signals.n):
            if shifts.link[k] and not signals.still[k]:
                for channel in link:
                    channel[part, k] = shifted(channel[part, k], float(shifts.link[k]) / signals.dt)
            if told is not None and np.isfinite(told[part, k]).all():
                tau[part, k] = told[part, k]
            elif shifts.torque[k]:
                tau[part, k] = _later(tau[part, k], float(shifts.torque[k]) / signals.dt)
    moved = Motion(motion.t, link[0], link[1], link[2], motion.theta, motion.dtheta, motion.ddtheta)
    return replace(signals, motion=moved, tau=tau)


def delivered(signals: Signals, drives: Sequence[tuple[Effect, Array]]) -> Signals:
    """Return the signals with the torque that motors delivered in place of what was asked of them.

    Parameters
    ----------
    signals
        As logged.
    drives
        Effects in motors (``simulated = "motor"``), with their amplitudes (d,).
    """
    if not drives:
        return signals
    tau = signals.tau.copy()
    for effect, linear in drives:
        tau[:, effect.joint] = effect.delivered(tau[:, effect.joint], linear)
    return replace(signals, tau=tau)


def _told_later(signals: Signals, shifts: Shifts) -> Array | None:
    """Return the torque of drives whose commands act later than logged, (N, n), NaN of those whose torque was logged.

    The positions in it are not late: the drive has them at once.
    """
    recording = signals.recording
    if recording is None or len(recording.t) != len(signals.tau):
        return None
    late = recording.commanded & (shifts.torque != 0)
    if not late.any():
        return None
    from elid_cli.logs.checks.commanded import commanded_torque

    values = {"q": recording.q, "theta": recording.theta, **recording.commands}
    values |= {name: v for name in ("dq", "dtheta") if (v := recording.signal(name)) is not None}
    bounds = [(segment.start, segment.stop) for segment in recording.segments]
    tau, _ = commanded_torque(values, recording.commands, bounds, recording.dt, late=shifts.torque)
    # a drive that was cut at its limit in this log is cut there still
    most = np.nanmax(np.abs(recording.tau), axis=0)
    cut = np.count_nonzero(np.abs(recording.tau) == most, axis=0) > 1
    return np.where(late, np.where(cut, np.clip(tau, -most, most), tau), np.nan)


def _later(values: Array, samples: float) -> Array:
    """Return values that act `samples` later than logged; NaN where an instant needed was not logged."""
    known = np.isfinite(values)
    if not known.any():
        return values
    filled = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    moved = shifted(filled, -samples)
    spread = np.convolve(~known, np.ones(3), mode="same") > 0
    return np.where(spread & ~known, np.nan, moved)
