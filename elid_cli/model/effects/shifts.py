"""Channels put right: those that were sampled at other instants than the rest, and torque that was only asked for.

A skewed link encoder or a late torque is first found through its first-order column and then corrected exactly, by
interpolation, so that no higher-order remainder is left for another effect to explain. A motor that delivers less
than was logged is put right as well: a prediction is then of what it delivered, and never made of what was logged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Channel, Effect
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.command_torque import at_limit
from elid_cli.signals.motion import STATES
from elid_cli.signals.signals import Signals
from elid_cli.signals.time_shift import shifted

LONGEST = 0.05
"""s; a channel that seems later than this is not moved."""


@dataclass(frozen=True)
class Shifts:
    """By how much channels are late, s, (n,) each."""

    link: Array
    """Age of the link encoder's reading beyond the motor encoder's."""
    torque: Array
    """How much later than logged the torque acts."""
    position: Array
    """Age of both encoders' readings beyond the other channels'."""

    @classmethod
    def none(cls, n: int) -> Shifts:
        """Return no shift for n joints."""
        return cls(np.zeros(n), np.zeros(n), np.zeros(n))

    def of(self, channel: Channel, joint: int) -> float:
        """Return how late a channel is, s."""
        return float(self._late(channel)[joint])

    def moved(self, channel: Channel, joint: int, value: float) -> Shifts:
        """Return the shifts with one of them set to `value` (s)."""
        late = self._late(channel).copy()
        late[joint] = value
        changed: dict[str, Array] = {channel: late}
        return replace(self, **changed)

    def plus(self, other: Shifts) -> Shifts:
        """Return the shifts with others added to them."""
        return Shifts(self.link + other.link, self.torque + other.torque, self.position + other.position)

    @property
    def largest(self) -> float:
        """The largest of them, s."""
        return float(np.max(np.abs([self.link, self.torque, self.position]), initial=0.0))

    @property
    def possible(self) -> bool:
        """Whether none is longer than a log's channels can be late."""
        return self.largest <= LONGEST

    def whole(self, kind: type[Effect], joint: int, values: Mapping[str, float]) -> dict[str, float]:
        """Return an effect's named parameters with what its channel has been moved by already."""
        found = dict(values)
        if kind.corrects is not None and found:
            found[kind.amplitudes[0].name] += self.of(kind.corrects, joint)
        return found

    def _late(self, channel: Channel) -> Array:
        return np.asarray(getattr(self, channel))

    def __bool__(self) -> bool:
        return bool(np.any(self.link) or np.any(self.torque) or np.any(self.position))


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


def delayed_joints(robot: Robot) -> tuple[int, ...]:
    """Return the joints of whose drives the robot declares a delay, in order."""
    named = {spec.joint for spec in robot.effects if _moved_by(spec) == "torque"}
    return tuple(k for k, name in enumerate(robot.joint_names) if name in named)


def unshifted_robot(robot: Robot) -> Robot:
    """Return the robot without the effects that are shifts in time."""
    return replace(robot, effects=tuple(spec for spec in robot.effects if _moved_by(spec) is None))


def unvalued(robot: Robot) -> Robot:
    """Return the robot whose late positions have no values: its channels are moved by these; itself without any."""
    rest = tuple(
        EffectSpec(spec.effect, spec.joint, {}) if _moved_by(spec) in ("link", "position") else spec
        for spec in robot.effects
    )
    any_late = any(_moved_by(spec) in ("link", "position") for spec in robot.effects)
    return replace(robot, effects=rest) if any_late else robot


def free_of_delays(robot: Robot) -> Robot:
    """Return the robot without the delays of its drives that it declares: a fit that finds them begins at none."""
    kept = tuple(spec for spec in robot.effects if _moved_by(spec) != "torque")
    return robot if len(kept) == len(robot.effects) else replace(robot, effects=kept)


def _moved_by(spec: EffectSpec) -> Channel | None:
    """Return the channel that a declared effect moves; None of one that is not known."""
    kind = effect_classes().get(spec.effect)
    return None if kind is None else kind.corrects


def corrected(signals: Signals, shifts: Shifts) -> Signals:
    """Return the signals with late channels moved to where they belong, segment by segment.

    Parameters
    ----------
    signals
        As logged.
    shifts
        By how much channels are late. Of torques that were computed from commands the commands are: the drive has the
        positions in them at once.
    """
    if not shifts:
        return signals
    motion, tau = signals.motion, signals.tau.copy()
    commanded = None if signals.command_torque is None else signals.command_torque.copy()
    late = STATES if np.any(shifts.position) else STATES[:3]
    moved = {name: getattr(motion, name).copy() for name in late}
    for segment in signals.segments:
        part = slice(segment.start, segment.stop)
        for k in range(signals.n):
            for name, channel in moved.items() if not signals.still[k] else ():
                age = float(shifts.position[k] + (shifts.link[k] if name in STATES[:3] else 0.0))
                if age:
                    channel[part, k] = shifted(channel[part, k], age / signals.dt)
            if shifts.torque[k]:
                acting = _later(signals.delayed[part, k], float(shifts.torque[k]) / signals.dt)
                tau[part, k] = acting if commanded is None else tau[part, k] + (acting - commanded[part, k])
                if commanded is not None:
                    commanded[part, k] = acting
    tau = tau if commanded is None else _cut(signals.tau, tau)
    return replace(signals, motion=motion.changed(**moved), tau=tau, command_torque=commanded)


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


def _cut(logged: Array, moved: Array) -> Array:
    """Return torques (N, n) cut where those that were logged are: a drive that was at its limit is there still."""
    most = np.nan_to_num(np.abs(logged)).max(axis=0)
    return np.where(at_limit(logged).any(axis=0), np.clip(moved, -most, most), moved)


def _later(values: Array, samples: float) -> Array:
    """Return values that act `samples` later than logged; NaN where an instant needed was not logged."""
    known = np.isfinite(values)
    if not known.any():
        return values
    filled = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    moved = shifted(filled, -samples)
    spread = np.convolve(~known, np.ones(3), mode="same") > 0
    return np.where(spread & ~known, np.nan, moved)
