"""What the signals of a log were like: all that verdicts and reports ask of them, whoever still has the samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.signals.signals import Signals

POSES = 200
"""Link positions kept to say where a log did not go."""


@dataclass(frozen=True)
class SignalFacts:
    """Facts about the signals of one log, or of several together, arrays (n,)."""

    dt: float
    """Sample time of the log, s; of several the longest."""
    rate: float
    """Instants per second after decimation."""
    cutoff: float
    """Cut-off of the parallel filter, Hz."""
    instants: int
    knots: Array
    min_velocity: Array
    noise: Array
    """Standard deviation of the noise of q, theta and tau, (3, n)."""
    deflection_noise: Array
    """The same in the smoothed, filtered deflection."""
    still: NDArray[np.bool_]
    torque: NDArray[np.bool_]
    """Joints with a torque."""
    unlinked: NDArray[np.bool_]
    """Joints without a link position: their transmission counts as rigid (`Signals.missing_link`)."""
    link_torque: NDArray[np.bool_]
    """Joints whose torque is read behind the motor (`Signals.link_torque`)."""
    computed: NDArray[np.bool_]
    """Joints whose torque is computed from commands: what delays these never shows well enough to be taken for none."""
    velocity_used: bool
    known: NDArray[np.intp]
    """Instants at which a joint's torque is known."""
    moved: Array
    """By how much each torque channel was moved before the fit, s."""
    poses: Array
    """Link positions at a few instants spread over the log, (k, n)."""


def facts_of(signals: Signals, known: NDArray[np.bool_] | NDArray[np.intp]) -> SignalFacts:
    """Return the facts of a log's signals.

    Parameters
    ----------
    signals
        The log.
    known
        Number of instants at which each joint's torque is known, (n,), or marks of them, (n, M).
    """
    outputs = signals.outputs[:: max(1, len(signals.outputs) // POSES)]
    known = np.asarray(known.sum(axis=1) if known.ndim == 2 else known, dtype=np.intp)
    return SignalFacts(
        dt=signals.dt,
        rate=signals.rate,
        cutoff=signals.filter.cutoff,
        instants=len(signals.outputs),
        knots=np.asarray(signals.knots, dtype=float),
        min_velocity=np.asarray(signals.min_velocity, dtype=float),
        noise=np.stack([signals.noise.q, signals.noise.theta, signals.noise.tau]),
        deflection_noise=np.array([deflection_noise(signals, k) for k in range(signals.n)]),
        still=signals.still,
        torque=known > 0,
        unlinked=signals.missing_link,
        link_torque=signals.link_torque,
        computed=_computed(signals),
        velocity_used=bool(signals.velocity_used.any()),
        known=known,
        moved=signals.moved if len(signals.moved) else np.zeros(signals.n),
        poses=np.nan_to_num(_poses(signals, outputs)),
    )


def _computed(signals: Signals) -> NDArray[np.bool_]:
    if signals.recording is None:
        return np.full(signals.n, signals.command_torque is not None)
    return signals.recording.commanded


NEAR = 64
"""Samples between instants up to which all of them are evaluated at once rather than each instant by itself."""

RUNS = 40
"""Parts of the instants, each evenly spaced, up to which every part is evaluated at once."""


def _poses(signals: Signals, instants: NDArray[np.intp]) -> Array:
    """Return the link positions at some instants, ascending, (M, n)."""
    first, last, steps = int(instants[0]), int(instants[-1]), np.diff(instants)
    runs = np.split(instants, np.flatnonzero(steps != steps[0]) + 1) if steps.size else [instants]
    if len(runs) <= RUNS:  # evenly spaced but from segment to segment
        step = int(steps[0]) if steps.size else 1
        return np.concatenate([signals.motion[int(run[0]) : int(run[-1]) + 1 : step].q for run in runs])
    if last - first < NEAR * instants.size:
        return np.asarray(signals.motion.positions(slice(first, last + 1))[0][:, instants - first].T)
    return np.array([signals.motion.positions(slice(k, k + 1))[0, :, 0] for k in instants.tolist()])


def deflection_noise(signals: Signals, joint: int) -> float:
    """Return the standard deviation of encoder noise in the smoothed, filtered deflection, rad (m)."""
    raw = float(np.hypot(signals.noise.q[joint], signals.noise.theta[joint]))
    knots = float(signals.knots[joint])
    # a least-squares spline keeps one coefficient's worth of noise per knot; the filter keeps the energy of its taps
    spline = signals.dt / knots if np.isfinite(knots) and knots > 0 else 1.0
    kept = min(1.0, spline, float(np.sum(signals.filter.taps**2)))
    return raw * float(np.sqrt(kept))


def joined_facts(facts: Sequence[SignalFacts]) -> SignalFacts:
    """Return the facts of several logs together: noises by their mean squares, the finest knots, all poses."""
    if len(facts) == 1:
        return facts[0]
    weights = [f.instants for f in facts]
    first = facts[0]
    return replace(
        first,
        dt=max(f.dt for f in facts),
        instants=sum(weights),
        knots=np.min(np.array([f.knots for f in facts]), axis=0),
        min_velocity=np.max(np.array([f.min_velocity for f in facts]), axis=0),
        noise=np.array([_mean_square([f.noise[k] for f in facts], weights) for k in range(3)]),
        deflection_noise=_mean_square([f.deflection_noise for f in facts], weights),
        still=np.all([f.still for f in facts], axis=0),
        torque=np.any([f.torque for f in facts], axis=0),
        computed=np.any([f.computed for f in facts], axis=0),
        velocity_used=any(f.velocity_used for f in facts),
        moved=np.average([f.moved for f in facts], axis=0, weights=weights),
        known=np.sum([f.known for f in facts], axis=0, dtype=np.intp),
        poses=np.concatenate([f.poses for f in facts]),
    )


def _mean_square(values: Sequence[Array], weights: Sequence[int]) -> Array:
    return np.asarray(np.sqrt(np.average(np.square(values), axis=0, weights=weights)))
