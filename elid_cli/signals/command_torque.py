"""The part of a torque that commands make: what a delay between commands and motion moves.

A torque that was computed from commands, kp (q_des - q) + kd (dq_des - dq) + tau_ff, holds the measured position, which
the drive has at once. Where its commands act later than they were logged, only they do: moved as a whole, the torque
would give kp times the delay to viscous friction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.signals.recording import Recording


def command_torque(recording: Recording) -> tuple[Array, Array | None]:
    """Return the torques, and the part of them that commands make, (N, n) each, N·m (N); None: all were logged.

    That part is the torque at position and speed 0; a logged torque is one as a whole. Commands count for what their
    stairs amount to below the sample rate (`smoothed_stairs`); smooth ones are what they are.
    """
    computed = recording.commanded
    if not computed.any():
        return recording.tau, None
    commands = recording.commands
    part, finer = np.zeros((2, *recording.tau.shape))
    for gain, name in ((commands["kp"], "q_des"), (commands["kd"], "dq_des"), (1.0, "tau_ff")):
        if name in commands:
            stairs, held = _stairs(recording, name)
            part += gain * np.nan_to_num(stairs)
            finer += gain * np.nan_to_num(stairs - held)
    free = ~at_limit(recording.tau)
    return np.where(computed & free, recording.tau + finer, recording.tau), np.where(computed, part, recording.tau)


def told_by(recording: Recording, gain: str, name: str) -> tuple[Array, Array]:
    """Return the parts of what `command_torque` returns that a gain makes of a command, N·m (N), (N, n) each."""
    if name not in recording.commands:
        return np.zeros_like(recording.tau), np.zeros_like(recording.tau)
    asked, (stairs, held) = recording.commands[name], _stairs(recording, name)
    finer = np.where(at_limit(recording.tau), 0.0, stairs - held)
    return np.nan_to_num(recording.commands[gain] * (asked + finer)), np.nan_to_num(recording.commands[gain] * stairs)


def _stairs(recording: Recording, name: str) -> tuple[Array, Array]:
    """Return what a command's stairs amount to below the sample rate, and its mean over a sample, (N, n) each."""
    bounds = [(segment.start, segment.stop) for segment in recording.segments]
    held = held_mean(recording.commands[name], bounds)
    return recording.commands[name] if recording.changing else smoothed_stairs(held, bounds), held


def error_integrals(recording: Recording) -> Array | None:
    """Return the integrals of kp (q_des - q) and of kp q_des, (2, N, n), N·m·s (N·s); None of logged torques.

    They are from each file's start on; between stretches nothing is added.
    """
    if not recording.commanded.any():
        return None
    asked, done = integrals(recording, recording.theta, recording.commands["kp"])
    return np.array([asked - done, asked])


def integrals(recording: Recording, measured: Array, gain: Array | float = 1.0) -> Array:
    """Return the integrals of a gain times commanded and times measured positions from each file's start on, (2, N, n).

    Commands are held for their sample; between stretches nothing is added.
    """
    weight = np.broadcast_to(np.nan_to_num(gain), measured.shape)
    found, last, source = np.zeros((2, *measured.shape)), np.zeros((2, 1, measured.shape[1])), -1
    for segment in recording.segments:
        part = slice(segment.start, segment.stop)
        last = np.where(segment.source == source, last, 0.0)
        q, asked = np.nan_to_num(measured[part]), np.nan_to_num(recording.commands["q_des"][part][:-1])
        each = weight[part][:-1] * np.array([asked, 0.5 * (q[1:] + q[:-1])])
        found[:, part] = last
        found[:, segment.start + 1 : segment.stop] += recording.dt * np.cumsum(each, axis=1)
        source, last = segment.source, found[:, segment.stop - 1 : segment.stop]
    return found


def loop_gains(recording: Recording | None) -> tuple[Array, Array]:
    """Return the gains of position loops whose speeds are differences of the logged positions, (n,) each; else 0.

    N·m/rad and N·m·s/rad (N/m, N·s/m). By them the noise of the positions enters computed torques.
    """
    if recording is None or not recording.commanded.any():
        nothing = np.zeros(0 if recording is None else recording.n)
        return nothing, nothing
    differenced = recording.commanded.copy()
    for name in ("dq", "dtheta"):
        if (speeds := recording.signal(name)) is not None:
            differenced &= ~np.isfinite(speeds).any(axis=0)
    kp, kd = (np.nan_to_num(np.nanmedian(recording.commands[gain], axis=0)) for gain in ("kp", "kd"))
    return np.where(differenced, kp, 0.0), np.where(differenced, kd, 0.0)


def held_mean(command: Array, segments: Sequence[tuple[int, int]]) -> Array:
    """Return a held command's mean over the sample about each instant, (N, n)."""
    mean = command.copy()
    for start, stop in segments:
        mean[start + 1 : stop] += command[start : stop - 1]
        mean[start + 1 : stop] /= 2.0
    return mean


def rates_of(command: Array, segments: Sequence[tuple[int, int]], dt: float) -> Array:
    """Return the rates of commanded positions, (N, n)."""
    found = np.zeros_like(command)
    for start, stop in segments:
        found[start:stop] = rate_of(command[start:stop], dt)
    return found


def rate_of(values: Array, dt: float) -> Array:
    """Return the rate of samples (N, k) by central differences of fourth order.

    Those of second order are too small by (ω dt)² / 6: at 250 Hz and 2 Hz of motion kd times 0.04 % of friction.
    """
    rate: Array = np.gradient(values, dt, axis=0) if len(values) > 1 else np.zeros_like(values)
    if len(values) > 4:
        rate[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * dt)
    return rate


def smoothed_stairs(mean: Array, segments: Sequence[tuple[int, int]]) -> Array:
    """Return what is left of a held command's stairs where all above the sample rate is taken out, (N, n).

    Its mean over a sample (`held_mean`) is smaller at frequency f by (π f dt)² / 3; the means before and after make up
    for that to the fourth order.
    """
    stairs = mean.copy()
    for start, stop in segments:
        inner = slice(start + 2, max(stop - 1, start + 2))
        around = mean[inner.start - 1 : inner.stop - 1] + mean[inner.start + 1 : inner.stop + 1]
        stairs[inner] += (2.0 * mean[inner] - around) / 12.0
    return stairs


def at_limit(tau: Array) -> NDArray[np.bool_]:
    """Return where torques (N, n) are at their joint's largest, if that occurs more than once: drives at a limit."""
    size = np.nan_to_num(np.abs(tau))
    top: NDArray[np.bool_] = (size == size.max(axis=0)) & (size > 0)
    return np.asarray(top & (np.count_nonzero(top, axis=0) > 1), dtype=np.bool_)
