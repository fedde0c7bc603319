"""States of windows side by side, step by step, by equations that are linear about a motion; and their sensitivities.

Steps are those of the implicit midpoint rule (second order, no damping of its own). Within a step in which a motor's
velocity comes to zero its Coulomb friction turns round, or holds it from there on; sensitivities know when.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

SWEEPS = 3
"""Sweeps over the motors in a step in which one of them comes to rest or turns round: they move each other."""


@dataclass(frozen=True)
class Steps:
    """K steps of S windows: equations about their midpoints, and what acts."""

    mass: Array
    """(K, S, m, m)."""
    damping: Array
    slope: Array
    drive: Array
    """Torque less what of the equations does not follow the state, (K, S, m)."""
    columns: Array
    """Torque that every unknown of 1 takes away, (K, S, m, C)."""
    grip: Array
    """Size of the Coulomb friction at every joint, (K, S, n)."""
    grips: Array
    """Its change with every unknown, (K, S, n, C), or (1, 1, n, C)."""
    motors: NDArray[np.intp]
    """Coordinate of every joint's motor, (n,)."""
    h: float
    """s."""


def march(steps: Steps, x: Array, v: Array, each: int = 1) -> tuple[Array, Array, Array]:
    """Return positions and velocities at K + 1 instants, and how the positions change with what is unknown.

    Parameters
    ----------
    steps
        The equations.
    x, v
        States at the start, (S, m).
    each
        Steps from one sample to the next.

    Returns
    -------
    tuple
        x, v (K + 1, S, m), and the change of x at every sample with the C unknowns and then the 2m states at the
        start, (K / each + 1, S, m, C + 2m).
    """
    count, windows, m, unknowns = steps.columns.shape
    h = steps.h
    left = steps.mass / h + 0.5 * steps.damping + 0.25 * h * steps.slope
    inverse = np.linalg.inv(left)
    keep = inverse @ (2.0 / h * steps.mass - left)
    turn = -inverse @ steps.slope
    push = (inverse @ steps.drive[..., None])[..., 0]
    pull = -inverse @ steps.columns
    brake = inverse[..., steps.motors]  # (K, S, m, n)
    xs, vs = np.empty((2, count + 1, windows, m))
    changes = np.empty((count // each + 1, windows, m, unknowns + 2 * m))
    dx, dv = np.zeros((2, windows, m, unknowns + 2 * m))
    xs[0], vs[0] = x, v
    dx[..., unknowns : unknowns + m] = dv[..., unknowns + m :] = np.eye(m)
    changes[0] = dx
    dry = bool(steps.grip.any() or steps.grips.any())
    held = np.zeros((windows, len(steps.motors)))
    for k in range(count):
        speed = (keep[k] @ vs[k][..., None] + turn[k] @ xs[k][..., None])[..., 0] + push[k]
        change = keep[k] @ dv + turn[k] @ dx
        change[..., :unknowns] += pull[k]
        if dry:
            grips = steps.grips[k if len(steps.grips) > 1 else 0]
            speed, change = _braked((speed, change), (vs[k], dv), (steps.grip[k], grips), brake[k], steps.motors, held)
        xs[k + 1], vs[k + 1] = xs[k] + 0.5 * h * (vs[k] + speed), speed
        dx = dx + 0.5 * h * (dv + change)
        dv = change
        if (k + 1) % each == 0:
            changes[(k + 1) // each] = dx
    return xs, vs, changes


def _braked(
    free: tuple[Array, Array], before: tuple[Array, Array], grip: tuple[Array, Array], brake: Array,
    motors: NDArray[np.intp], held: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Return velocities (S, m) and their changes (S, m, C + 2m) after a step with Coulomb friction.

    `free` are those without friction, `before` those before the step, `brake` what a friction of 1 takes from every
    velocity, (S, m, n); `held`, (S, n), is the friction of the step before and becomes this one's.
    """
    speed, change = free
    old, size = before[0][:, motors], grip[0]
    unknowns = grip[1].shape[-1]
    forward = np.where(old != 0, np.sign(old), np.sign(speed[:, motors]))
    fast = forward * size
    sliding = speed - (brake @ fast[..., None])[..., 0]
    calm = (sliding[:, motors] * forward > 0) | (size == 0)
    if calm.all():
        change = change.copy()
        change[..., :unknowns] -= brake @ (forward[..., None] * grip[1])
        held[:] = fast
        return sliding, change
    n = len(motors)
    held[:] = np.where(calm, fast, held)
    give = brake[:, motors, np.arange(n)]
    speed = speed - (brake @ held[..., None])[..., 0]
    stay, back, less = np.ones_like(old), np.zeros_like(old), np.zeros_like(old)
    for _ in range(SWEEPS):
        for i in range(n):
            alone = speed[:, motors[i]] + give[:, i] * held[:, i]
            now, stay[:, i], back[:, i], less[:, i] = _slowed(alone, old[:, i], give[:, i], size[:, i])
            new = (alone - now) / give[:, i]
            speed -= brake[:, :, i] * (new - held[:, i])[:, None]
            held[:, i] = new
    # the friction of a motor changes with its velocity where it comes to rest: sweeps again
    taken = np.zeros((*old.shape, change.shape[-1]))
    change = change.copy()
    for _ in range(SWEEPS):
        for i in range(n):
            alone = change[:, motors[i]] + give[:, i, None] * taken[:, i]
            now = stay[:, i, None] * alone + back[:, i, None] * before[1][:, motors[i]]
            now[:, :unknowns] += less[:, i, None] * np.broadcast_to(grip[1], (len(old), n, unknowns))[:, i]
            new = (alone - now) / give[:, i, None]
            change -= brake[:, :, i, None] * (new - taken[:, i])[:, None]
            taken[:, i] = new
    return speed, change


def _slowed(alone: Array, old: Array, give: Array, size: Array) -> tuple[Array, Array, Array, Array]:
    """Return a motor's velocity after a step, (S,), and its slopes with `alone`, `old` and `size`.

    `alone` is the velocity without its friction, `old` the one before, `give` what a friction of 1 takes from it.
    """
    forward = np.where(old != 0, np.sign(old), np.sign(alone))
    forward[forward == 0] = 1.0
    u, v = alone * forward, np.abs(old)  # as if it moved forward
    kept = u - give * size  # sliding on
    on = kept > 0
    down, up = u - v - give * size, u - v + give * size
    reached = (~on) & (v > 0) & (down < 0)
    turns = reached & (up < 0)
    safe = np.where(down < 0, down, -1.0)
    # down to rest after the part v / -down of the step; then, if pulled on, backwards with friction turned round
    rest = np.where(turns, 1.0 + v / safe, 0.0)
    leaves = (~on) & (v == 0) & (up < 0)  # cannot be: forward is where it is pulled to
    now = np.where(on, kept, np.where(turns, rest * up, np.where(leaves, up, 0.0)))
    by_u = np.where(on, 1.0, np.where(turns, rest - v / safe**2 * up, 0.0))
    by_v = np.where(turns, (1.0 / safe + v / safe**2) * up - rest, 0.0)
    by_size = np.where(on, -give, np.where(turns, give * v / safe**2 * up + rest * give, 0.0))
    return now * forward, by_u, by_v, by_size * forward
