"""Torque of a drive from what it was told: kp (q_des - q) + kd (dq_des - dq) + tau_ff, for logs that hold no torque.

A command acts for its whole sample: with one that changes at a sample's instant, the drive's mean torque about that
instant is that of the mean of the command before and the command after.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.mapping.language import COMMANDS, GAINS
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import held_mean, rate_of

UNTOLD = (
    "no dq_des is logged: no commanded velocity is assumed, which nothing shows (--map dq_des=rate: the rate of "
    "q_des, as of small servos)"
)
DIFFERENT = 0.01
"""Relative difference of a gain in log and robot file that is worth a word."""


def gains_of(
    signals: Mapping[str, Array], given: Mapping[str, Array], robot: Robot, samples: int
) -> tuple[dict[str, Array], list[str]]:
    """Return the gains that are known, each (N, n) with NaN where not, and notes.

    Parameters
    ----------
    signals
        The log's signals, ``kp`` and ``kd`` among them where it holds them, (N, n).
    given
        Gains that the user gave, (n,), which win.
    robot
        Its `control` stands for what neither has.
    samples
        N.
    """
    found, notes = {}, []
    for gain in GAINS:
        described = np.array([robot.control.get(gain, {}).get(name, np.nan) for name in robot.joint_names])
        if gain in given:
            found[gain] = np.broadcast_to(given[gain], (samples, robot.n))
            continue
        logged = signals.get(gain)
        if logged is None:
            if np.isfinite(described).any():
                notes.append(f"{gain} is the robot file's")
                found[gain] = np.broadcast_to(described, (samples, robot.n))
            continue
        usual = np.nanmedian(np.where(np.isfinite(logged).any(axis=0), logged, 0.0), axis=0)
        other = np.abs(usual - described) > DIFFERENT * np.abs(usual)
        if other.any():
            j = int(np.argmax(other))
            notes.append(
                f"{gain} of {robot.joint_names[j]} is {usual[j]:g} in the log and {described[j]:g} in the robot file: "
                "the log's is used"
            )
        found[gain] = np.where(np.isnan(logged), described, logged)
    return found, notes


def commanded_torque(
    signals: Mapping[str, Array],
    gains: Mapping[str, Array],
    segments: Sequence[tuple[int, int]],
    dt: float,
    robot: Robot,
) -> tuple[Array, list[str]]:
    """Return the torque that the drives made of their commands, (N, n), NaN where it is not known, and notes.

    Parameters
    ----------
    signals
        ``q`` or ``theta``, ``q_des``, and where logged ``dq`` or ``dtheta``, ``dq_des``, ``tau_ff``, each (N, n).
    gains
        ``kp`` and ``kd``, (N, n).
    segments
        Segments, (start, stop).
    dt
        Sample time, s.
    robot
        Its torque limits cut the torque.
    """
    q, dq = _first(signals, "q", "theta"), _first(signals, "dq", "dtheta")
    motors = at_motors(signals, robot)
    if motors.any():
        theta, rate = _first(signals, "theta", "q"), signals.get("dtheta", np.full_like(q, np.nan))
        q, dq = np.where(motors, theta, q), np.where(motors, rate, dq)
    told = {name: held_mean(signals[name], segments) for name in COMMANDS if name in signals and name not in GAINS}
    notes = []
    slow = np.isnan(dq).all(axis=0)
    if slow.any():
        dq = dq.copy()
        for start, stop in segments:
            dq[start:stop, slow] = rate_of(q[start:stop, slow], dt)
        notes.append("no velocity is logged: differences of the positions are used for the drives")
    tau = gains["kp"] * (told["q_des"] - q) + gains["kd"] * (_known(told.get("dq_des"), q) - dq)
    tau += _known(told.get("tau_ff"), q)
    off = ~np.any(np.abs(np.nan_to_num(tau)) > 0, axis=0) & np.isfinite(tau).any(axis=0)
    if off.any():
        tau[:, off] = np.nan
        who = " ".join(name for name, here in zip(robot.joint_names, off, strict=True) if here)
        notes.append(f"the drive of {who} is off, kp and kd are 0 throughout: its torque counts as not recorded")
    bounds = robot.torque_limits
    cut = np.count_nonzero(np.abs(tau) > bounds, axis=0)
    for j in np.flatnonzero(cut).tolist():
        share = 100 * cut[j] / len(tau)
        notes.append(
            f"{robot.joint_names[j]}: the computed torque is above the robot file's limit of {bounds[j]:g} "
            f"{robot.joints[j].units[1]} in {share:.2g} % of the samples, and is cut there (elid diagnose looks "
            "whether the drive has that limit)"
        )
    return np.clip(tau, -bounds, bounds), notes


def at_motors(signals: Mapping[str, Array], robot: Robot) -> NDArray[np.bool_]:
    """Return the joints whose drives have the motor's position, (n,): where both sides are logged, and may differ.

    An encoder at the motor closes the loop of nearly every drive, and the simulated motion is that of such loops.
    """
    q, theta = signals.get("q"), signals.get("theta")
    if q is None or theta is None:
        return np.zeros(robot.n, dtype=bool)
    logged = np.isfinite(theta).any(axis=0) & np.isfinite(q).any(axis=0)
    differ = [not np.array_equal(theta[:, j], q[:, j], equal_nan=True) for j in range(robot.n)]
    return np.asarray(logged & np.array(differ) & np.array([j.transmission != "rigid" for j in robot.joints]))


def _first(signals: Mapping[str, Array], one: str, other: str) -> Array:
    """Return a signal, joints that lack it from another one."""
    found = [signals[name] for name in (one, other) if name in signals]
    if not found:
        return np.full_like(signals["q"], np.nan)
    return found[0] if len(found) == 1 else np.where(np.isnan(found[0]), found[1], found[0])


def _known(values: Array | None, like: Array) -> Array:
    """Return a command, joints that were told nothing at 0."""
    if values is None:
        return np.zeros_like(like)
    return np.where(np.isnan(values).all(axis=0), 0.0, values)
