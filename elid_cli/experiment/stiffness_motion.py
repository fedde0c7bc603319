"""A motion that shows a stiffness from the motor side: a multisine past the antiresonance on a slow wide motion.

Stiffness, link and rotor part where the link swings against the held motor, at sqrt(K / Jl) / 2π; below, they are one
inertia. The multisine's lines lie between 1 Hz and 1.3 times that, evenly on a logarithmic scale, each of the same
acceleration, which a torque of even size per line would make of link and rotor together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError, UsageError, did_you_mean
from elid_cli.experiment.reference import ReferenceOptions, SplineReference, limits_of, random_reference
from elid_cli.model.antiresonance import PAST, PER_PERIOD, expected_antiresonance, moved_inertias
from elid_cli.robot.ranges import range_of
from elid_cli.robot.robot import Robot

LOWEST = 1.0
"""Lowest frequency of the multisine, Hz."""
ACCELERATION = (2.0, 4.0, 6.0)
"""Least, wanted and most rms acceleration of the multisine, rad/s² (m/s²)."""
LINES = 40
"""Lines of the multisine, of all joints together."""
WAY_POINTS = 1.6
"""Time between the slow motion's way-points, s."""
EDGE = 0.5
"""Time in which the multisine rises and falls, s."""
ROOM = 0.97
"""Share of each limit that is used."""


@dataclass(frozen=True)
class Shown:
    """One joint whose stiffness is to be shown."""

    joint: int
    antiresonance: float
    """Highest to expect, Hz."""
    told: bool
    """Whether the user told it; else it follows from the robot file's K and inertias."""
    inertia: float
    """Of link and rotor together, kg·m² (kg)."""
    acceleration: float
    """Rms of the multisine, rad/s² (m/s²)."""

    @property
    def torque(self) -> float:
        """Rms of the multisine's torque, N·m (N)."""
        return self.acceleration * self.inertia


@dataclass(frozen=True)
class Multisine:
    """Lines of one joint's acceleration that rise at the start and fall before the end."""

    frequency: Array
    """Hz, (lines,)."""
    phase: Array
    """rad, (lines,)."""
    amplitude: float
    """Of the acceleration, rad/s² (m/s²), of every line."""

    def evaluate(self, t: Array, duration: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration at times t, (N,) each."""
        turn = 2 * np.pi * self.frequency
        angle = np.outer(t, turn) + self.phase
        size = self.amplitude / turn**2
        wave = -np.sin(angle) @ size, -np.cos(angle) @ (size * turn), np.sin(angle) @ (size * turn**2)
        rise, up, bend = _edge(np.minimum(t, duration - t))
        up = np.where(t < duration / 2, up, -up)
        return (
            rise * wave[0],
            rise * wave[1] + up * wave[0],
            rise * wave[2] + 2 * up * wave[1] + bend * wave[0],
        )


@dataclass(frozen=True)
class StiffnessMotion:
    """A slow wide motion of all joints with a multisine on top of those whose stiffnesses are to be shown."""

    robot: Robot
    slow: SplineReference
    shown: tuple[Shown, ...]
    multisines: tuple[Multisine, ...]
    top: float
    """Highest frequency, Hz."""

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.slow.duration

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Return (q, q', q''), each of shape (N, n), at times t (s)."""
        q, dq, ddq = self.slow.evaluate(t)
        for shown, multisine in zip(self.shown, self.multisines, strict=True):
            for whole, part in zip((q, dq, ddq), multisine.evaluate(t, self.duration), strict=True):
                whole[:, shown.joint] += part
        return q, dq, ddq

    def sampled(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """Return (t, q, q', q'') at `rate` samples per second, both ends included."""
        t = np.arange(round(self.duration * rate) + 1) / rate
        return (t, *self.evaluate(t))

    @property
    def least_rate(self) -> float:
        """Samples per second that the motion needs."""
        return PER_PERIOD * self.top

    @cached_property
    def used(self) -> dict[str, Array]:
        """Share of every joint's limits, or of their defaults, that the motion uses, (n,) each."""
        q, dq, ddq = self.evaluate(np.arange(round(self.duration * self.least_rate) + 1) / self.least_rate)
        ranges = np.array([range_of(joint) for joint in self.robot.joints])
        speeds = np.array([limits_of(joint) for joint in self.robot.joints])
        return {
            "position": np.abs(q - ranges.mean(axis=1)).max(axis=0) / (0.5 * np.ptp(ranges, axis=1)),
            "velocity": np.abs(dq).max(axis=0) / speeds[:, 0],
            "acceleration": np.abs(ddq).max(axis=0) / speeds[:, 1],
        }


def stiffness_motion(robot: Robot, asked: Sequence[str], duration: float = 10.0, seed: int = 0) -> StiffnessMotion:
    """Return a motion that shows the stiffnesses of some joints.

    Parameters
    ----------
    robot
        Its limits bound the motion; its K, or what is told in `asked`, says up to which frequency.
    asked
        Names of joints, each with the highest antiresonance to expect, Hz, behind a colon where K is not known.
    duration
        Length, s.
    seed
        The same seed gives the same motion.

    Raises
    ------
    UsageError
        No such joint; a frequency that is none; K unknown and no frequency told.
    DataError
        The joint's limits leave no room for the multisine.

    """
    places = [_place(robot, words) for words in asked]
    twice = {robot.joint_names[k] for k, _ in places if [j for j, _ in places].count(k) > 1}
    if twice:
        raise UsageError(f"--show-stiffness: {sorted(twice)[0]!r} is there twice")
    options = ReferenceOptions(amplitude=0.5, speed=0.5, interval=WAY_POINTS)
    slow = random_reference(robot, duration, seed, options)
    inertia = moved_inertias(robot)
    expected = [told or _expected(robot, k) for k, told in places]
    top = PAST * max(expected)
    lines = np.exp(np.linspace(np.log(LOWEST), np.log(top), max(LINES, 12 * len(places))))
    lines[-1] = top  # exactly: the last line is there once, however exp and log round
    generator = np.random.default_rng([seed, 1])
    shown, multisines = [], []
    for number, ((k, told), hertz) in enumerate(zip(places, expected, strict=True)):
        own = np.unique(np.r_[lines[number :: len(places)], top])
        phase = 2 * np.pi * generator.random(len(own))
        rms, multisine = _fitting(robot, slow, k, Multisine(own, phase, float(np.sqrt(2 / len(own)))))
        shown.append(Shown(k, hertz, told is not None, float(inertia[k]), rms))
        multisines.append(multisine)
    return StiffnessMotion(robot, slow, tuple(shown), tuple(multisines), float(top))


def _place(robot: Robot, words: str) -> tuple[int, float | None]:
    """Return the number of a joint and the antiresonance to expect, Hz, None where it is not told."""
    name, _, hertz = (words, "", "") if words in robot.joint_names else words.rpartition(":")
    name = name or hertz
    if name not in robot.joint_names:
        raise UsageError(f"--show-stiffness: no joint {name!r}", hint=did_you_mean(name, robot.joint_names))
    if words == name:
        return robot.joint_names.index(name), None
    try:
        value = float(hertz)
    except ValueError:
        value = 0.0
    if not 0.5 <= value <= 1000.0:
        raise UsageError(f"--show-stiffness {words}: {hertz!r} is no frequency of a joint: 0.5 to 1000 Hz")
    return robot.joint_names.index(name), value


def _expected(robot: Robot, k: int) -> float:
    """Return the antiresonance that the robot file means, Hz."""
    expected = expected_antiresonance(robot, k)
    name = robot.joint_names[k]
    if not expected > 0:
        raise UsageError(
            f"--show-stiffness {name}: the robot file gives no stiffness (K) of this joint",
            hint=f"tell the highest antiresonance to expect, Hz: --show-stiffness {name}:15",
        )
    return expected


def _fitting(robot: Robot, slow: SplineReference, k: int, unit: Multisine) -> tuple[float, Multisine]:
    """Return the multisine of the size that is wanted, or as large as the joint's limits allow, and its rms."""
    t = np.arange(round(slow.duration * PER_PERIOD * unit.frequency[-1]) + 1) / (PER_PERIOD * unit.frequency[-1])
    joint = robot.joints[k]
    low, high = range_of(joint)
    limits = 0.5 * (high - low), *limits_of(joint)
    room = []
    moved = (slow.evaluate(t)[d][:, k] for d in range(3))
    for base, part, limit in zip(moved, unit.evaluate(t, slow.duration), limits, strict=True):
        base = base - 0.5 * (low + high) if limit is limits[0] else base
        room.append(float(np.min((ROOM * limit - np.abs(base)) / np.maximum(np.abs(part), 1e-12))))
    most = min(ACCELERATION[1], *room)
    if most < ACCELERATION[0]:
        raise _no_room(robot, k, most, int(np.argmin(room)))
    return most, Multisine(unit.frequency, unit.phase, unit.amplitude * most)


def _no_room(robot: Robot, k: int, most: float, tightest: int) -> DataError:
    """Return the refusal of a multisine of which a joint's limits allow `most`: whose limits they are, and the mend."""
    joint = robot.joints[k]
    unit, own = joint.units[0], joint.limits
    (low, high), (speed, acceleration) = range_of(joint), limits_of(joint)
    limits = (
        ("position", f"{low:.4g} to {high:.4g} {unit}", f"[{2 * low:.4g}, {2 * high:.4g}]", own.position),
        ("velocity", f"{speed:.4g} {unit}/s", f"{2 * speed:.4g}", own.velocity),
        ("acceleration", f"{acceleration:.4g} {unit}/s²", f"{2 * acceleration:.4g}", own.acceleration),
    )
    told = ", ".join(f"{key} {size}{' (default)' if given is None else ''}" for key, size, _, given in limits)
    ours = any(given is None for *_, given in limits)
    key, _, larger, given = limits[tightest]
    return DataError(
        f"the limits of {joint.name} leave room for a multisine of {max(most, 0.0):.2g} {unit}/s² only, "
        f"{ACCELERATION[0]:g} are needed",
        detail=f"{told}; {key} leaves least room"
        + ("; (default): elid's own, where the description gives none" if ours else ""),
        hint=f"if the joint can do more, {'say so' if given is None else 'change it'} {robot.place_to_say}, "
        f"such as limits: {{{key}: {larger}}}",
    )


def _edge(t: Array) -> tuple[Array, Array, Array]:
    """Return a rise from 0 to 1 over `EDGE` without a jerk at its ends, and two derivatives."""
    s = np.clip(t / EDGE, 0.0, 1.0)
    value = s**3 * (10 - 15 * s + 6 * s**2)
    slope = 30 * s**2 * (1 - s) ** 2 / EDGE
    bend = 60 * s * (1 - s) * (1 - 2 * s) / EDGE**2
    return value, slope, bend
