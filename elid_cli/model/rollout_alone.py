"""The recursion of a rollout for chains of one joint, which most command logs have: `rollout_loops.steps` in scalars.

It takes the same steps to the same numbers in half the time: without loops over the joints of a chain and their arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from elid_cli._types import Array
from elid_cli.model.rollout_loops import SAME, SWEEPS, compiled_with_fading, faded


@cache
def compiled_steps_alone() -> Callable[..., None]:
    """Return `steps_alone` compiled, where Numba is installed."""
    return compiled_with_fading(steps_alone)


def steps_alone(  # noqa: C901  # loops that Numba compiles as one: no objects, no calls
    mass: Array, force: Array, slope: Array, swerve: Array, place: Array, speed: Array,
    told: Array, kp: Array, kd: Array, ki: Array, holds: Array, lag: Array, since: Array,
    half_way: Array, ramp: Array, whole: Array, rise: Array, x0: Array, v0: Array,
    inertia: Array, coulomb: Array, viscous: Array, offset: Array, limit: Array, friction: Array,
    width: Array, lead: Array, push: Array, grip: Array, dt: float, later: float, damped: float, xs: Array, vs: Array,
) -> None:  # fmt: skip
    """Write positions and velocities to `xs` and `vs`, (N, V, S, L, 1); the arguments are those of `steps`."""
    instants, variants, stretches, chains, _ = xs.shape
    each = len(told) // (instants - 1)
    h = dt / each
    smooth = 2.0 * later
    between = 0.5 if later > 0.0 else 0.5 * (each - 1) / each
    apart = later == 0.0 and friction.max() > 0.0
    for a in range(variants):
        for s in range(stretches):
            for c in range(chains):
                x, v, held, gained, slowed, summed = x0[s, c, 0], v0[s, c, 0], 0.0, 0.0, 0.0, 0.0
                wide, ahead = width[a, s, c, 0], lead[a, s, c, 0] / h
                p, d, integral, holding = kp[s, c, 0], kd[s, c, 0], ki[s, c, 0], holds[s, c, 0]
                part, full_rate, slope_rate = half_way[s, c, 0], whole[s, c, 0], rise[s, c, 0]
                top, resists, shift = limit[a, s, c, 0], viscous[a, s, c, 0], offset[a, s, c, 0]
                rotor, dry, fades = inertia[a, s, c, 0], coulomb[a, s, c, 0], friction[a, s, c, 0]
                xs[0, a, s, c, 0], vs[0, a, s, c, 0], seen = x, v, v
                stiff = smooth * (ramp[s, c, 0] * d + 0.25 * h * p)
                slow = (1.0 - later) * h * resists
                sampled, older, period, first, late = 0.0, 0.0, 1, 0, 0.0
                if holding == 0.0:
                    slow += h * (stiff + damped * d)
                else:
                    period, first = max(round(each / holding), 1), round(since[s, c, 0] * each)
                    late = lag[s, c, 0] / h
                for k in range(instants - 1):
                    pulled, pull = force[k, s, c, 0], force[k + 1, s, c, 0] - force[k, s, c, 0]
                    bend = 0.5 * (slope[k, s, c, 0, 0] + slope[k + 1, s, c, 0, 0])
                    turn = 0.5 * (swerve[k, s, c, 0, 0] + swerve[k + 1, s, c, 0, 0])
                    full = (1.0 - between) * mass[k, s, c, 0, 0] + between * mass[k + 1, s, c, 0, 0]
                    give = full + smooth * (0.25 * h * h * bend + 0.5 * h * turn)
                    give = 1.0 / (give + (rotor + (0.0 if apart else slow)))
                    ending = 1.0 / (full + (rotor + slow))
                    pushed = push[k if len(push) > 1 else 0, a, s, c, 0]
                    more = grip[k if len(grip) > 1 else 0, a, s, c, 0]
                    bound, soft = h * max(dry + more, 0.0), 0.0
                    if fades > 0.0:  # what effects add fades in as well
                        bound, soft = h * max(dry, 0.0), h * max(fades + more, 0.0)
                    where, move = place[k, s, c, 0], place[k + 1, s, c, 0] - place[k, s, c, 0]
                    pace0, pace1 = speed[k, s, c, 0], speed[k + 1, s, c, 0]
                    for j in range(each):
                        w, now = (j + later) / each, k * each + j
                        middle = x + later * h * v
                        off = middle - (where + w * move)
                        pace = v - (1.0 - w) * pace0 - w * pace1
                        given = stiff * gained
                        if holding > 0.0:
                            given = 0.0
                            phase = (now + first) % period
                            if phase == 0 or now == 0:
                                older = sampled
                                sampled = told[now, s, c, 0] - p * x - d * seen
                                sampled -= integral * summed
                                if now == 0:
                                    older = sampled
                            behind = min(max(late - phase, 0.0), 1.0)
                            drive = behind * older + (1.0 - behind) * sampled
                            if late < 0.0 and phase == period - 1:
                                coming = told[min(now + 1, len(told) - 1), s, c, 0]
                                coming -= p * (x + h * v) + d * seen
                                coming -= integral * (summed + h * x)
                                drive -= late * (coming - sampled)
                        else:
                            drive = told[now, s, c, 0] - p * middle
                            drive -= d * (part * v + (1.0 - part) * seen)
                            drive -= integral * (summed + later * h * x)
                        drive = min(max(drive - given, -top), top) + given
                        drive -= shift
                        drive -= resists * v + pushed
                        drive -= pulled + w * pull
                        drive -= bend * off + turn * pace
                        acts = h * drive
                        faster = v + give * (acts - held - slowed)
                        for _ in range(SWEEPS):
                            settled = True
                            if soft > 0.0 or slowed != 0.0:
                                free, new = faster + give * slowed, 0.0
                                if soft > 0.0 and later == 0.0:
                                    steep = soft / wide
                                    new = steep * (v + ahead * (free - v)) / (1 + steep * ahead * give)
                                    new = min(max(new, -soft), soft)
                                elif soft > 0.0:
                                    new = faded(v, free, give, soft, wide, ahead)
                                change = new - slowed
                                if abs(change) > SAME * soft:
                                    settled = False
                                    faster -= give * change
                                    slowed = new
                            # of one that passes through rest, friction turns when it does
                            free = faster + give * held
                            low, high = -bound, bound
                            if later == 0.0:
                                pass  # a step's friction is one, whatever the velocity's sign at its start
                            elif v > 0.0:
                                end = free - give * high
                                if end < 0.0:
                                    low = high * (v + end) / (v - end)
                            elif v < 0.0:
                                end = free - give * low
                                if end > 0.0:
                                    high = low * (v + end) / (v - end)
                            new = min(max(free / give, low), high)
                            change = new - held
                            if change != 0.0:
                                settled = False
                                faster -= give * change
                                held = new
                            if settled:
                                break
                        if apart:
                            faster = v + ending * (acts - held - slowed)
                        summed += h * x + 0.25 * h * h * (v + faster)
                        x += h * (later * v + (1.0 - later) * faster)
                        gained = faster - v
                        seen += full_rate * (v - seen) + slope_rate * gained
                        v = faster
                    xs[k + 1, a, s, c, 0], vs[k + 1, a, s, c, 0] = x, v
