"""Channels that stand still while the joint moves: a cable off, a recorder that repeats, a torque at its limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.memory import let_go
from elid_cli.robot.robot import Robot

MOVES = {True: 0.2, False: 0.02}
"""rad (revolute) or m (prismatic): a joint whose one side moves this far moves on the other too."""
GLANCE = 1000
"""Samples (evenly taken) that rule out most channels."""
HOLD = 0.1
"""s; the shortest stretch that counts as frozen …"""
FEWEST = 20
"""… and the fewest samples in it."""
SUDDEN = 10.0
"""Times the usual step by which a frozen signal jumps when it comes back."""
SEEN = 50_000
"""Samples that are looked at for limits and usual steps."""
AT_LIMIT = 0.01
"""Share of samples at exactly the largest torque that is no coincidence."""
LEVELS = 50
"""Different torques that a signal needs for its largest one to mean something."""


def drop_stuck(filled: Mapping[str, Array], robot: Robot, drop: Mapping[str, NDArray[np.bool_]]) -> list[str]:
    """Mark (in `drop`, per signal and joint) the channels that never change while the joint moves; say which."""
    said = []
    moved = {signal: _ranges(filled[signal]) for signal in ("q", "theta", "tau")}
    for j, joint in enumerate(robot.joints):
        far = MOVES[joint.revolute]
        unit = "rad" if joint.revolute else "m"
        for signal, other in (("q", "theta"), ("theta", "q")):
            if moved[signal][j] == 0 and moved[other][j] > far:
                drop[signal][j] = True
                said.append(
                    f"{signal} of {joint.name} never changes while {other} moves {moved[other][j]:.3g} {unit}: "
                    "taken as not recorded"
                )
        if moved["tau"][j] == 0 and max(moved["q"][j], moved["theta"][j]) > far:
            drop["tau"][j] = True
            value = float(filled["tau"][0, j])
            said.append(f"tau of {joint.name} is {value:.4g} throughout while it moves: taken as not recorded")
    return said


def _ranges(values: Array) -> Array:
    """Return max - min of every column, NaN where it has none; exact only where it is zero or nearly so."""
    glance = values[:: max(1, values.shape[0] // GLANCE)].copy()
    let_go(values)
    span = np.asarray(glance.max(axis=0) - glance.min(axis=0))
    for j in np.flatnonzero(span == 0):
        span[j] = values[:, j].max() - values[:, j].min()
    return span


def frozen(q: Array, theta: Array, dt: float, robot: Robot) -> Iterator[str]:
    """Name stretches in which one side repeats a value although the joint moves, of one contiguous stretch."""
    length = max(FEWEST, round(HOLD / dt))
    if q.shape[0] < 2 * length:
        return
    for j, joint in enumerate(robot.joints):
        for signal, own in (("q", q[:, j]), ("theta", theta[:, j])):
            if np.isnan(own[0]):
                continue
            found = [run for run in _held(own, length) if _jumps(own, run)]
            let_go(own)
            if found:
                start, stop = max(found, key=lambda run: run[1] - run[0])
                more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
                yield (
                    f"{joint.name}: {signal} stays at {own[start]:.4g} for {(stop - start) * dt:.3g} s from "
                    f"t = {start * dt:.4g} s{more} and then jumps: the sensor or the recorder hung; leave that part out"
                )


def _held(column: Array, length: int) -> list[tuple[int, int]]:
    """Return the stretches of at least `length` equal samples."""
    half = max(1, length // 2)
    glance = column[::half]
    candidates = np.flatnonzero(glance[1:] == glance[:-1])
    runs: list[tuple[int, int]] = []
    for k in candidates:
        start = int(k) * half
        if runs and start < runs[-1][1]:
            continue
        changes = np.flatnonzero(column[max(0, start - half) : start] != column[start])
        begin = max(0, start - half) + int(changes[-1]) + 1 if changes.size else max(0, start - half)
        after = np.flatnonzero(column[start:] != column[start])
        stop = start + int(after[0]) if after.size else column.size
        if stop - begin >= length:
            runs.append((begin, stop))
    return runs


def _jumps(own: Array, run: tuple[int, int]) -> bool:
    """Whether a signal that held its value then jumps to where the joint has moved meanwhile."""
    stop = run[1]
    if stop >= own.size:
        return False
    steps = np.abs(np.diff(own[:SEEN]))
    usual = float(np.percentile(steps, 95))
    jump = abs(float(own[stop] - own[stop - 1]))
    return jump > max(0.01, SUDDEN * usual)


def limited(tau: Array, robot: Robot) -> Iterator[str]:
    """Name joints whose torque sits at its own largest value for long."""
    values = tau[:: max(1, tau.shape[0] // SEEN)].copy()
    let_go(tau)
    for j, name in enumerate(robot.joint_names):
        column = values[:, j]
        if np.isnan(column[0]):
            continue
        top, bottom = column.max(), column.min()
        for limit, away in ((top, top - column), (bottom, column - bottom)):
            count = int(np.count_nonzero(away == 0))
            near = int(np.count_nonzero((away > 0) & (away < 0.02 * (top - bottom))))
            if count > max(FEWEST, AT_LIMIT * column.size) and count > near and np.unique(column).size > LEVELS:
                share = 100 * count / column.size
                yield (
                    f"{name}: tau is exactly {limit:.5g} in {share:.2g} % of the samples: it is limited there. "
                    "If the log holds the command and not the torque, the parameters of this joint are wrong"
                )
