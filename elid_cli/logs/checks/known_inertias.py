"""The scale of a log's time, told by the inertia of the bodies that the robot's file describes.

Where time runs ten times too slow, accelerations are a hundred times too small, and a model with a hundred times the
inertia fits as well. The rotors' inertia is not known, so each joint's own acceleration tells nothing: what its chain's
other accelerations and velocities do at it does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.logs.checks.known_masses import (
    FEWEST,
    OWN,
    Scale,
    Weighed,
    about,
    evenly,
)
from elid_cli.logs.checks.limits import WRONG
from elid_cli.logs.checks.torque_scale import SURE, WRONG_SCALE, slope_beside
from elid_cli.model.body_torques import ROUNDING, gravity_torques, inertial_torques
from elid_cli.robot.robot import Robot

INSTANTS = 600
"""Instants of a log that are looked at."""
ROWS = 8192
"""Samples in the middle of it by which a lag is chosen."""
WRONG_INERTIA = WRONG_SCALE**2
"""Factor between a torque and that of the described inertia that no wrong reference value explains."""
FOLLOWS = 0.5
"""Correlation of a torque and what the described inertia needs, beside all else, from which their ratio is judged."""
LAGS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Samples over which accelerations may be told."""
STEADY = 1.2
"""Ratio of accelerations told over a lag and over twice that, above which they are noise, or smoothed away."""
RUNS = "the time of the log runs"
"""What every doubt of a log's time says."""


def wrong_times(log: Weighed, theta: Array, *, signal: str = "tau") -> Iterator[str]:
    """Yield a sentence where torques hold the described weight, but another inertia than the described.

    Parameters
    ----------
    log
        Positions of links, torques and description.
    theta
        Positions of motors at the joint, (N, n).
    signal
        ``tau``, or ``tau_link`` where that is the only torque.
    """
    robot = log.robot
    moved = [s for s in inertia_scales(log.q, theta, log.tau, log.dt, robot) if math.isfinite(s.ratio)]
    if not any(_is_off(s) for s in moved):
        return
    weights = log.scales
    ranges = [_range(s) for s in weights]
    if any(high < 1 / WRONG_SCALE or low > WRONG_SCALE for low, high in ranges):
        return  # the torque itself is of another size
    held = any(low > 1 / WRONG_SCALE and high < WRONG_SCALE for low, high in ranges)
    off = [s for s in moved if _is_off(s)]
    names = [robot.joint_names[s.joint] for s in off]
    sizes = [s.ratio for s in off]
    usual = float(np.median(sizes))
    times = in_words([about(size) for size in sizes])
    said = f"{signal} of {in_words(names)} is {times} times what moves the described bodies"
    if all(_agrees(s, usual) for s in moved):
        pace = math.sqrt(usual)
        way = f"{pace:.2g} times too slow" if pace > 1 else f"{1 / pace:.2g} times too fast"
        weighed = "but holds their weight" if held else "and no weight shows its size"
        torque = "" if held else f"{signal} is in another unit, "
        yield (
            f"{said}, {weighed}: {RUNS} about {way}, {torque}or the inertias of {robot.name} are wrong; look at "
            "the unit of t, or at --rate"
        )
    elif not {s.joint for s in off} & {s.joint for s in weights}:
        yield f"{said}, and no weight shows its size: {WRONG}, or the inertias of {robot.name}"


def _range(scale: Scale) -> tuple[float, float]:
    """Return between what a scale surely is."""
    return scale.ratio - SURE * scale.deviation, scale.ratio + SURE * scale.deviation


def _is_off(scale: Scale) -> bool:
    low, high = _range(scale)
    return scale.correlation > FOLLOWS and (low > WRONG_INERTIA or -1 / WRONG_INERTIA < high < 1 / WRONG_INERTIA)


def _agrees(scale: Scale, usual: float) -> bool:
    """Whether a joint's scale may be, but for wrong reference values, the one of the others."""
    low, high = _range(scale)
    return low < usual * WRONG_SCALE and high > usual / WRONG_SCALE


def inertia_scales(q: Array, theta: Array, tau: Array, dt: float, robot: Robot) -> Iterator[Scale]:
    """Yield how many times the torque of the described inertia each joint's torque holds, NaN where it does not show.

    The torque is fitted by it beside the weight, an offset, friction and the accelerations of the joint's own link and
    motor, which the rotor's inertia follows.
    """
    lags = _lags(q)
    most = max(lags, default=0)
    if not most or len(q) < 2 * most + FEWEST:
        return
    at = evenly(most, len(q) - 1 - most, INSTANTS)
    (speed, bend), (spin, turn) = (_rates(values, at, lags, dt) for values in (q, theta))
    inertia, weight = inertial_torques(robot, q[at], speed, bend), gravity_torques(robot, q[at])
    least = ROUNDING * float(np.nanmax(np.abs(inertia), initial=0.0))
    for j in range(robot.n):
        used = np.isfinite(tau[at, j]) & np.isfinite(inertia[:, j]) & np.isfinite(speed[:, j])
        if np.count_nonzero(used) < FEWEST or not np.abs(inertia[used, j]).max() > least:
            continue
        own = [weight[:, j], spin[:, j], np.sign(spin[:, j]), bend[:, j], turn[:, j], np.ones(at.size)]
        beside = np.column_stack(own)[used]
        beside = beside if np.isfinite(beside).all() else np.nan_to_num(beside)
        yield Scale.of(j, slope_beside(beside, inertia[used, j], tau[at, j][used], OWN))


def _rates(values: Array, at: NDArray[np.intp], lags: Sequence[int], dt: float) -> tuple[Array, Array]:
    """Return velocities and accelerations of positions, (N, n), at some instants, over each joint's lag; 0: none."""
    speed, bend = np.zeros((at.size, len(lags))), np.zeros((at.size, len(lags)))
    for j, lag in enumerate(lags):
        if lag:
            ahead, here, behind = (values[at + step, j] for step in (lag, 0, -lag))
            speed[:, j], bend[:, j] = (ahead - behind) / (2 * lag * dt), (ahead - 2.0 * here + behind) / (lag * dt) ** 2
    return speed, bend


def _lags(positions: Array) -> list[int]:
    """Return over how many samples each joint's accelerations are best told, whatever the time is; 0: over none.

    A short lag leaves noise in them, whose part is four times smaller over twice the lag, and a long one smooths them:
    the best one is that from which on they change least.
    """
    spare = max(0, len(positions) - ROWS) // 2
    middle = np.ascontiguousarray(positions[spare : spare + ROWS].T)
    lags = [lag for lag in LAGS if middle.shape[1] >= 8 * lag + FEWEST]
    sizes = [_bends(middle, lag) for lag in (*lags, 2 * lags[-1])] if lags else []
    found = []
    for own in np.array(sizes).reshape(-1, len(middle)).T.tolist():
        best, least = 0, STEADY
        for lag, size, twice in zip(lags, own[:-1], own[1:], strict=True):
            if 0 < size < least * twice:
                best, least = lag, size / twice
        found.append(best)
    return found


def _bends(positions: Array, lag: int) -> Array:
    """Return the rms of every position's second differences over a lag, by the square of that; (n, N) to (n,)."""
    second = positions[:, 2 * lag :] - 2.0 * positions[:, lag:-lag] + positions[:, : -2 * lag]
    second *= second
    mean = second.mean(axis=1)
    if np.isnan(mean).any():
        known = np.isfinite(second)
        mean = np.where(known, second, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.asarray(np.sqrt(mean) / lag**2)
