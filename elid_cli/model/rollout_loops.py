"""The recursion of a rollout as plain loops, which Numba compiles: one rollout after the other, as arrays step."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from elid_cli._types import Array
from elid_cli.compiling import compiled, has_numba

SWEEPS = 3
"""Sweeps over the joints that couple, each from the friction of the step before."""
NEWTON = 40
"""Most steps to the mean of friction that fades in and is within its width for a part of a step; three are usual."""
SAME = 1e-9
"""Part of such friction by which it may change between two sweeps that agree."""


@cache
def compiled_steps() -> Callable[..., None] | None:
    """Return `steps` compiled, or None where Numba is not installed."""
    return compiled_with_fading(steps) if has_numba() else None


def compiled_with_fading(loops: Callable[..., None]) -> Callable[..., None]:
    """Return loops compiled that call `faded`.

    Numba keeps them by the date of their own file alone: who changes this one touches `rollout_alone.py`, too.
    """
    _register()
    return compiled(loops, error_model="numpy")


@cache
def _register() -> None:
    from numba.extending import register_jitable

    register_jitable(error_model="numpy")(faded)


def steps(  # noqa: C901  # loops that Numba compiles as one: no objects, no calls
    mass: Array, force: Array, slope: Array, swerve: Array, place: Array, speed: Array,
    told: Array, kp: Array, kd: Array, ki: Array, holds: Array, lag: Array, since: Array,
    half_way: Array, ramp: Array, whole: Array, rise: Array, x0: Array, v0: Array,
    inertia: Array, coulomb: Array, viscous: Array, offset: Array, limit: Array, friction: Array,
    width: Array, lead: Array, push: Array, grip: Array, dt: float, later: float, damped: float, xs: Array, vs: Array,
) -> None:  # fmt: skip
    """Write positions and velocities to `xs` and `vs`, (N, V, S, L, s); the arrays are those of `rollout.Local`.

    `later` is the part of a step at which what drives the motion is taken: half, of Euler's 0, where `damped` is 1 if
    the drives' damping is implicit (`drives.Stepped`).
    """
    # scalars only: expressions of arrays take Numba seconds to compile, and memory at every step
    instants, variants, stretches, chains, size = xs.shape
    each = len(told) // (instants - 1)
    h = dt / each
    smooth = 2.0 * later
    between = 0.5 if later > 0.0 else 0.5 * (each - 1) / each  # of two instants, where a mass stands for its steps
    inverses, bend = np.empty((2, size, size)), np.empty((size, size))  # the second one for the end of Euler's steps
    inverse, ending, acts, turn, pace = inverses[0], inverses[1], np.empty(size), np.empty((size, size)), np.empty(size)
    # friction that fades in follows the acceleration without the damping of the end of Euler's steps
    apart = later == 0.0 and friction.max() > 0.0
    x, v, held, middle, rhs, faster = (np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size),
                                       np.empty(size))  # fmt: skip
    pulled, pull, where, move, off, pushed, bound, gained = (
        np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size),
        np.empty(size))  # fmt: skip
    soft, wide, ahead, slowed, summed = np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    seen = np.empty(size)  # the velocity as a drive's filter has it
    sampled, older = np.empty(size), np.empty(size)  # the torque of drives that hold it, and the last one
    for a in range(variants):
        for s in range(stretches):
            for c in range(chains):
                for i in range(size):
                    x[i], v[i], held[i], gained[i] = x0[s, c, i], v0[s, c, i], 0.0, 0.0
                    wide[i], ahead[i], slowed[i], summed[i] = width[a, s, c, i], lead[a, s, c, i] / h, 0.0, 0.0
                    xs[0, a, s, c, i], vs[0, a, s, c, i], seen[i] = x[i], v[i], v[i]
                for k in range(instants - 1):
                    for i in range(size):
                        # force and slope between two instants, and how they change, about where the motion is
                        pulled[i], pull[i] = force[k, s, c, i], force[k + 1, s, c, i] - force[k, s, c, i]
                        for m in range(size):
                            half = 0.5 * (slope[k, s, c, i, m] + slope[k + 1, s, c, i, m])
                            turn[i, m] = 0.5 * (swerve[k, s, c, i, m] + swerve[k + 1, s, c, i, m])
                            full = (1.0 - between) * mass[k, s, c, i, m] + between * mass[k + 1, s, c, i, m]
                            bend[i, m] = half
                            inverse[i, m] = full + smooth * (0.25 * h * h * half + 0.5 * h * turn[i, m])
                            ending[i, m] = full
                        slow = (1.0 - later) * h * viscous[a, s, c, i]
                        if holds[s, c, i] == 0.0:
                            stiff = smooth * (ramp[s, c, i] * kd[s, c, i] + 0.25 * h * kp[s, c, i])
                            slow += h * (stiff + damped * kd[s, c, i])
                        ending[i, i] += inertia[a, s, c, i] + slow
                        inverse[i, i] += inertia[a, s, c, i] + (0.0 if apart else slow)
                    for own in inverses if apart else inverses[:1]:
                        for n in range(size):  # Gauss-Jordan in place; a mass matrix needs no pivots
                            pivot = 1.0 / own[n, n]
                            own[n, n] = 1.0
                            for m in range(size):
                                own[n, m] *= pivot
                            for i in range(size):
                                if i != n:
                                    factor = own[i, n]
                                    own[i, n] = 0.0
                                    for m in range(size):
                                        own[i, m] -= factor * own[n, m]
                    p, g = k if len(push) > 1 else 0, k if len(grip) > 1 else 0
                    for i in range(size):
                        pushed[i] = push[p, a, s, c, i]
                        bound[i], soft[i] = h * max(coulomb[a, s, c, i] + grip[g, a, s, c, i], 0.0), 0.0
                        if friction[a, s, c, i] > 0.0:  # what effects add fades in as well
                            bound[i] = h * max(coulomb[a, s, c, i], 0.0)
                            soft[i] = h * max(friction[a, s, c, i] + grip[g, a, s, c, i], 0.0)
                        where[i], move[i] = place[k, s, c, i], place[k + 1, s, c, i] - place[k, s, c, i]
                    for j in range(each):
                        w, now = (j + later) / each, k * each + j
                        for i in range(size):
                            middle[i] = x[i] + later * h * v[i]
                            off[i] = middle[i] - (where[i] + w * move[i])
                            pace[i] = v[i] - (1.0 - w) * speed[k, s, c, i] - w * speed[k + 1, s, c, i]
                        for i in range(size):
                            drive = told[now, s, c, i] - kp[s, c, i] * middle[i]
                            part = half_way[s, c, i]
                            drive -= kd[s, c, i] * (part * v[i] + (1.0 - part) * seen[i])
                            drive -= ki[s, c, i] * (summed[i] + later * h * x[i])
                            # what a drive gives as the velocity changes is in `inverse`: at its limit it gives none
                            given = smooth * (ramp[s, c, i] * kd[s, c, i] + 0.25 * h * kp[s, c, i]) * gained[i]
                            if holds[s, c, i] > 0.0:
                                given = 0.0
                                period = max(round(each / holds[s, c, i]), 1)
                                phase = (now + round(since[s, c, i] * each)) % period
                                if phase == 0 or now == 0:
                                    older[i] = sampled[i]
                                    sampled[i] = told[now, s, c, i] - kp[s, c, i] * x[i] - kd[s, c, i] * seen[i]
                                    sampled[i] -= ki[s, c, i] * summed[i]
                                    if now == 0:
                                        older[i] = sampled[i]
                                behind = min(max(lag[s, c, i] / h - phase, 0.0), 1.0)
                                drive = behind * older[i] + (1.0 - behind) * sampled[i]
                                if lag[s, c, i] < 0.0 and phase == period - 1:
                                    coming = told[min(now + 1, len(told) - 1), s, c, i]
                                    coming -= kp[s, c, i] * (x[i] + h * v[i]) + kd[s, c, i] * seen[i]
                                    coming -= ki[s, c, i] * (summed[i] + h * x[i])
                                    drive -= lag[s, c, i] / h * (coming - sampled[i])
                            drive = min(max(drive - given, -limit[a, s, c, i]), limit[a, s, c, i]) + given
                            drive -= offset[a, s, c, i]
                            drive -= viscous[a, s, c, i] * v[i] + pushed[i]
                            drive -= pulled[i] + w * pull[i]
                            for m in range(size):
                                drive -= bend[i, m] * off[m] + turn[i, m] * pace[m]
                            acts[i] = h * drive
                            rhs[i] = acts[i] - held[i] - slowed[i]
                        for i in range(size):
                            faster[i] = v[i]
                            for m in range(size):
                                faster[i] += inverse[i, m] * rhs[m]
                        for _ in range(SWEEPS):
                            settled = True
                            for i in range(size):
                                give = inverse[i, i]
                                if soft[i] > 0.0 or slowed[i] != 0.0:
                                    free, new = faster[i] + give * slowed[i], 0.0
                                    if soft[i] > 0.0 and later == 0.0:
                                        steep = soft[i] / wide[i]
                                        new = steep * (v[i] + ahead[i] * (free - v[i])) / (1 + steep * ahead[i] * give)
                                        new = min(max(new, -soft[i]), soft[i])
                                    elif soft[i] > 0.0:
                                        new = faded(v[i], free, give, soft[i], wide[i], ahead[i])
                                    change = new - slowed[i]
                                    if abs(change) > SAME * soft[i]:
                                        settled = False
                                        for m in range(size):
                                            faster[m] -= inverse[m, i] * change
                                        slowed[i] = new
                                # of one that passes through rest, friction turns when it does
                                free = faster[i] + give * held[i]
                                low, high = -bound[i], bound[i]
                                if later == 0.0:
                                    pass  # a step's friction is one, whatever the velocity's sign at its start
                                elif v[i] > 0.0:
                                    end = free - give * high
                                    if end < 0.0:
                                        low = high * (v[i] + end) / (v[i] - end)
                                elif v[i] < 0.0:
                                    end = free - give * low
                                    if end > 0.0:
                                        high = low * (v[i] + end) / (v[i] - end)
                                new = min(max(free / give, low), high)
                                change = new - held[i]
                                if change != 0.0:
                                    settled = False
                                    for m in range(size):
                                        faster[m] -= inverse[m, i] * change
                                    held[i] = new
                            if settled:  # the usual case of joints that move: friction is as it was
                                break
                        if apart:
                            for i in range(size):
                                faster[i] = v[i]
                                for m in range(size):
                                    faster[i] += ending[i, m] * (acts[m] - held[m] - slowed[m])
                        for i in range(size):
                            summed[i] += h * x[i] + 0.25 * h * h * (v[i] + faster[i])
                            x[i] += h * (later * v[i] + (1.0 - later) * faster[i])
                            gained[i] = faster[i] - v[i]
                            seen[i] += whole[s, c, i] * (v[i] - seen[i]) + rise[s, c, i] * gained[i]
                            v[i] = faster[i]
                    for i in range(size):
                        xs[k + 1, a, s, c, i], vs[k + 1, a, s, c, i] = x[i], v[i]


def faded(v: float, free: float, give: float, bound: float, width: float, ahead: float) -> float:
    """Return the impulse, N·m·s (N·s), of friction that fades in over a speed (`drives.Fading`), in one step.

    It is the mean of the friction over the step, in which the velocity goes straight; of a joint that is within the
    width all along, or comes to it within a step that is long beside its course there, that of the exponential which
    its velocity follows: long steps must not ring.

    Parameters
    ----------
    v
        Velocity at the start, rad/s (m/s).
    free, give
        Velocity at the end without the impulse, and by how much an impulse of 1 lowers it.
    bound
        Impulse of the whole friction; positive.
    width, ahead
        Speed over which it fades in, and its lead in steps.
    """
    new = bound if v + free > 0.0 else -bound
    far = ahead * (free - give * new - v)
    first, last = v + far, free - give * new + far
    if (new > 0.0 and min(first, last) >= width) or (new < 0.0 and max(first, last) <= -width):
        return new
    steep = bound / width
    rate = steep * give / (1.0 + steep * give * ahead)
    part = ahead + (0.5 + rate / 12.0 if rate < 1e-3 else 1.0 / (1.0 - np.exp(-rate)) - 1.0 / rate)
    new = steep * (part * free + (1.0 - part) * v) / (1.0 + steep * part * give)
    far = ahead * (free - give * new - v)
    first, last = v + far, free - give * new + far
    if abs(last) <= width and (abs(first) <= width or (rate > 1.0 and abs(new) <= bound)):
        return new
    low, high = -bound, bound
    new = min(max(new, low), high)
    for _ in range(NEWTON):
        far = ahead * (free - give * new - v)
        first, last = (v + far) / width, (free - give * new + far) / width
        one, other = min(max(first, -1.0), 1.0), min(max(last, -1.0), 1.0)
        gap = last - first
        if abs(gap) > 1e-9:
            # the integral of sat(u) is u²/2 within 1, |u| - 1/2 beyond
            mean = (other * (last - 0.5 * other) - one * (first - 0.5 * one)) / gap
            fall = (other * (1.0 + ahead) - one * ahead - mean) / gap
        else:
            mean, fall = other, (0.5 + ahead if abs(other) < 1.0 else 0.0)
        miss = new - bound * mean
        if abs(miss) <= 1e-12 * bound:
            break
        low, high = (low, new) if miss > 0.0 else (new, high)
        new -= miss / (1.0 + bound * fall * give / width)
        if not low < new < high:
            new = 0.5 * (low + high)
    return new
