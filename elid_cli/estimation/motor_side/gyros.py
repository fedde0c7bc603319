"""Gyroscopes on links whose positions nobody logged: what they measure of the links' motion, and how they are mounted.

A gyroscope on the link behind joint k measures g = M ω_k(q, q') of d seconds before, and a bias. M, (3, 3), is its
mounting rotation with its scale errors: unknown, near the rotation that the motors' slow motion tells (Kabsch 1976).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.operators import filtered
from elid_cli.model.link_rates import AXES, LinkRates
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import GYRO, Recording

UNKNOWNS = AXES * AXES + AXES + 1
"""Of every gyroscope: M row by row, the bias, the delay."""
MOUNTING_SPREAD = 0.05
"""Prior standard deviation of every element of M: scale errors and misalignment of small sensors, with a margin."""
BIAS_SPREAD, DELAY_SPREAD = 0.3, 5e-3
"""Prior standard deviations of a bias, rad/s, and of a delay, s."""
SLOW = 1.0
"""Frequency, Hz, below which links are taken to turn as their motors do, for the mounting."""
UNLIKE = 0.4
"""Part of a gyroscope's slow rates that a rotation of its link's must leave at most."""
STRANGE = (
    "it does not turn as its link does: the joint it is mapped to, an axis, a sign, the unit or the clock is wrong"
)
APART = 0.3
"""Least part of a joint's own turning that must be apart from that of the other elastic joints to be seen."""


@dataclass(frozen=True)
class Gyros:
    """Angular velocities of some links, each in its sensor's own axes."""

    joints: tuple[int, ...]
    """The joints that move these links, of those that move at all, m."""
    rates: Array
    """rad/s, (N, 3 m)."""
    noise: Array
    """Standard deviations of their white noise, (3 m,)."""
    mounting: Array
    """First estimate of every M, (m, 3, 3)."""

    def part(self, part: slice) -> Gyros:
        """Return some of the samples."""
        return replace(self, rates=self.rates[part])


def gyros_of(robot: Robot, recording: Recording, moving: Sequence[int]) -> Gyros:
    """Return the gyroscopes of a log on links that move.

    One on a link that is carried through resting joints is one on the link of the nearest moving joint before them.
    """
    joints, columns = [], []
    for k in np.flatnonzero(recording.turning).tolist():
        carrying = [j for j in robot.ancestors[k] if j in moving]
        if carrying:
            joints.append(list(moving).index(carrying[-1]))
            columns += [recording.gyro[axis][:, k] for axis in GYRO]
    rates = np.stack(columns, axis=1) if columns else np.zeros((recording.samples, 0))
    return Gyros(tuple(joints), rates, np.zeros(len(columns)), np.tile(np.eye(AXES), (len(joints), 1, 1)))


def mounting_prior(mounting: Array) -> tuple[Array, Array]:
    """Return mean and standard deviation of the gyroscopes' unknowns, (13 m,), of first mountings (m, 3, 3)."""
    many = len(mounting)
    mean = np.concatenate([mounting.reshape(many, AXES * AXES), np.zeros((many, AXES + 1))], axis=1)
    spread = [MOUNTING_SPREAD] * (AXES * AXES) + [BIAS_SPREAD] * AXES + [DELAY_SPREAD]
    return mean.ravel(), np.tile(spread, many)


def mounted(gyros: Gyros, robot: Robot, theta: Array, dt: float) -> tuple[Gyros, dict[int, str]]:
    """Return gyroscopes with the rotations that the motors' slow motion tells (Kabsch 1976, Acta Cryst. A32).

    Those that do not turn as their links do are left out: the second is why, by their place among the given ones.

    Parameters
    ----------
    gyros
        What was measured.
    robot
        The joints that move.
    theta
        Motors' positions at the joints, (N, n).
    dt
        Sample time, s.
    """
    if not gyros.joints:
        return gyros, {}
    slow, _ = filtered(theta, dt, SLOW)
    turning = LinkRates(robot, gyros.joints).rates(slow, np.gradient(slow, dt, axis=0))
    measured, reach = filtered(gyros.rates, dt, SLOW)
    inner = slice(reach, len(theta) - reach) if 4 * reach < len(theta) else slice(None)
    found, refused = [], {}
    for number in range(len(gyros.joints)):
        pair = turning[inner, number], _axes(measured, number)[inner]
        model, rates = (values - values.mean(axis=0) for values in pair)
        left, _, right = np.linalg.svd(rates.T @ model)
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        found.append(turn)
        if not np.linalg.norm(rates - model @ turn.T) < UNLIKE * np.linalg.norm(rates):
            ratio = float(np.linalg.norm(rates) / max(float(np.linalg.norm(model)), 1e-300))
            refused[number] = f"{STRANGE}; it turns {ratio:.2g} times as fast"
    used = [number for number in range(len(gyros.joints)) if number not in refused]
    columns = [AXES * number + axis for number in used for axis in range(AXES)]
    joints = tuple(gyros.joints[number] for number in used)
    mounting = np.array([found[number] for number in used]).reshape(-1, AXES, AXES)
    return Gyros(joints, gyros.rates[:, columns], gyros.noise[columns], mounting), refused


def _axes(values: Array, number: int) -> Array:
    return values[:, AXES * number : AXES * (number + 1)]


def watched(turning: LinkRates, elastic: NDArray[np.bool_], q: Array) -> NDArray[np.bool_]:
    """Return which elastic joints' own turning gyroscopes tell from that of the others, (n,).

    Parameters
    ----------
    turning
        The links that carry them.
    elastic
        Which joints are elastic, (n,).
    q
        Positions at some instants, (N, n).
    """
    seen = np.zeros(len(elastic), dtype=bool)
    if not turning.joints:
        return seen
    axes = turning.slopes(q, np.zeros_like(q))[1][1].reshape(len(q), -1, len(elastic))
    for k in np.flatnonzero(elastic):
        others = [j for j in np.flatnonzero(elastic).tolist() if j != k]
        own = axes[:, :, k, None]
        left = own - axes[:, :, others] @ (np.linalg.pinv(axes[:, :, others]) @ own) if others else own
        size = float(np.linalg.norm(own))
        seen[k] = size > 0 and float(np.linalg.norm(left)) > APART * size
    return seen
