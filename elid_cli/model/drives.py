"""What acts on the joints of a simulated motion: drives under commands, and the friction and inertia of motors."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from elid_cli._types import Array

Stepped = Literal["explicit", "implicit"]
"""Semi-implicit Euler steps, as simulators take them: positions go on with the new velocity, and the drives' torque is
that of a step's start, their damping that of its end where it is implicit; that of the joints always is."""

FINEST = 20
"""Largest number of samples in which whole periods of a loop are looked for."""


@dataclass(frozen=True)
class Drives:
    """What acts on the motors of S stretches in K steps: ``clip(told - kp x - kd x') - offset``, at most `limit`."""

    told: Array
    """kp q_des + kd dq_des + tau_ff of every step, N·m (N), (K, S, n)."""
    kp: Array
    """Gains, N·m/rad and N·m·s/rad, (S, n); 0 where a torque is given."""
    kd: Array
    limit: Array
    """Torque limits, N·m (N), (n,); infinite where there is none."""
    ki: Array | None = None
    """Integral gains, N·m/(rad·s), (S, n): ``- ki ∫ x dt`` from the start on is told as well; None: 0."""
    smoothing: Array | None = None
    """Time constants of the filters of velocity, s, (S, n): x' in ``kd x'`` passes a first-order one; None: 0."""
    held: Array | None = None
    """How often in a sample drives compute their torque, which they hold until the next time, (S, n): less than once
    where their period is longer; 0 of those that act all the time. None: 0."""
    lag: Array | None = None
    """By how much later than it is computed such a torque begins to act, s, (S, n), within that time; of simulators
    whose steps make it seem so, earlier. None: 0."""
    stepped: Stepped | None = None
    """How the log's simulator steps, where it is one that does so as long as these steps; None: motion is smooth."""
    since: Array | None = None
    """How long before the first sample drives that hold their torque computed it, in samples, (S, n). None: 0."""


def parts_of_loops(often: Array) -> Array:
    """Return into how many parts of a sample all instants fall at which loops compute their torque; 1 where none do.

    `often` is how often in a sample they do, of any shape: of 2.5 times, every fifth of a sample may be one.
    """
    parts = [Fraction(each).limit_denominator(FINEST).numerator for each in np.ravel(often).tolist()]
    return np.maximum(np.reshape(np.array(parts, dtype=float), np.shape(often)), 1.0)


def lost_to_holding(period: float, gain: Array) -> Array:
    """Return what drives that hold their torque for a period, s, lack beside ones that act all the time.

    To first order: the torque is half a period late on average. Of a gain kp, N·m/rad, that takes as much viscous
    friction from the joint, N·m·s/rad; of kd, N·m·s/rad, as much inertia, kg·m². Of any shape.
    """
    return np.asarray(0.5 * period * gain)


def filter_weights(smoothing: Array, h: float) -> tuple[Array, Array, Array, Array]:
    """Return how filters of velocity come along in a step of `h` s, over which the velocity goes straight.

    Parameters
    ----------
    smoothing
        Time constants, s, of any shape.
    h
        Step, s.

    Returns
    -------
    What the filtered velocity takes of the velocity at the step's start, and of its change over the step: by the
    middle, and by the end. Without a filter 1 and a half, 1 and 1.
    """
    rate = h / np.maximum(smoothing, 1e-9 * h)
    half, whole = -np.expm1(-0.5 * rate), -np.expm1(-rate)
    return half, 0.5 - half / rate, whole, 1.0 - whole / rate


@dataclass(frozen=True)
class Fading:
    """Dry friction that fades in over a speed, of V variants, (V, n): ``friction sat((v + lead v')/width)``.

    sat(u) is u within ±1, the sign of u beyond. Simulators smooth friction so: by a width alone, or, as the constraint
    that is MuJoCo's default, so that a joint comes to rest exponentially: with a lead of that time constant.
    """

    friction: Array
    """N·m (N)."""
    width: Array
    """rad/s (m/s)."""
    lead: Array
    """Time by which it acts ahead of the velocity, s."""


@dataclass(frozen=True)
class Joints:
    """Drive parameters of V variants of a robot, (V, n), SI at the joint."""

    inertia: Array
    """Inertia of the rotor beyond what the equations hold, kg·m² (kg)."""
    coulomb: Array
    viscous: Array
    offset: Array
    """Torque that the drives lack, N·m (N)."""
    push: Array | None = None
    """Torque of effects on every coordinate between one instant and the next, on the model's side, N·m (N),
    (N - 1, V, S, m)."""
    grip: Array | None = None
    """Coulomb friction beyond `coulomb` between one instant and the next, N·m (N), (N - 1, V, S, m)."""
    damping: Array | None = None
    """Viscous friction of every coordinate beyond `viscous`, N·m·s/rad, (m,), the same of all variants."""
    fading: Fading | None = None
    """Dry friction beside the one that holds; where a joint has some, `grip` fades in with it."""
