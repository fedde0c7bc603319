"""The recursion of a rollout as plain loops, for Numba: the same steps as the arrays take, a hundred times as fast."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from elid_cli._types import Array

SWEEPS = 3
"""Sweeps over the joints that couple, each from the friction of the step before."""


@cache
def compiled_steps() -> Callable[..., None] | None:
    """Return `steps` compiled, or None where Numba is not installed."""
    if importlib.util.find_spec("numba") is None:
        return None
    from numba import njit

    found: Any
    try:
        found = njit(cache=True)(steps)
    except RuntimeError:  # nowhere to keep it
        found = njit(steps)
    made: Callable[..., None] = found
    return made


def steps(  # noqa: C901  # loops that Numba compiles as one: no objects, no calls
    mass: Array, force: Array, slope: Array, place: Array, told: Array, kp: Array, kd: Array, x0: Array, v0: Array,
    inertia: Array, coulomb: Array, viscous: Array, offset: Array, limit: Array, push: Array, grip: Array, dt: float,
    xs: Array, vs: Array,
) -> None:  # fmt: skip
    """Write positions and velocities to `xs` and `vs`, (N, V, S, L, s); the arrays are those of `rollout._Part`."""
    instants, variants, stretches, chains, size = xs.shape
    each = len(told) // (instants - 1)
    h = dt / each
    for variant in range(variants):
        for stretch in range(stretches):
            for chain in range(chains):
                own = (variant, stretch, chain)
                x, v = x0[stretch, chain].copy(), v0[stretch, chain].copy()
                held = np.zeros(size)
                xs[0, variant, stretch, chain], vs[0, variant, stretch, chain] = x, v
                for k in range(instants - 1):
                    here = 0.5 * (mass[k, stretch, chain] + mass[k + 1, stretch, chain])
                    bend = 0.5 * (slope[k, stretch, chain] + slope[k + 1, stretch, chain])
                    for i in range(size):
                        here[i, i] += inertia[own][i]
                    full = here + 0.25 * h * h * bend
                    for i in range(size):
                        damping = viscous[own][i] + kd[stretch, chain, i]
                        full[i, i] += 0.5 * h * damping + 0.25 * h * h * kp[stretch, chain, i]
                    inverse = np.linalg.inv(full)
                    pushed = push[k if len(push) > 1 else 0, variant, stretch, chain]
                    gripped = grip[k if len(grip) > 1 else 0, variant, stretch, chain]
                    for j in range(each):
                        w = (j + 0.5) / each
                        now, middle, rhs = told[k * each + j, stretch, chain], x + 0.5 * h * v, np.empty(size)
                        for i in range(size):
                            drive = now[i] - kp[stretch, chain, i] * middle[i] - kd[stretch, chain, i] * v[i]
                            drive = min(max(drive, -limit[own][i]), limit[own][i]) - offset[own][i]
                            drive -= viscous[own][i] * v[i] + pushed[i]
                            one, other = force[k, stretch, chain, i], force[k + 1, stretch, chain, i]
                            drive -= one + w * (other - one)
                            for m in range(size):
                                a, b = place[k, stretch, chain, m], place[k + 1, stretch, chain, m]
                                drive -= bend[i, m] * (middle[m] - (a + w * (b - a)))
                            rhs[i] = h * drive - held[i]
                        faster = v + inverse @ rhs
                        for _ in range(SWEEPS):
                            for i in range(size):
                                bound = h * max(coulomb[own][i] + gripped[i], 0.0)
                                new = min(max(held[i] + faster[i] / inverse[i, i], -bound), bound)
                                change = new - held[i]
                                for m in range(size):
                                    faster[m] -= inverse[m, i] * change
                                held[i] = new
                        x = x + 0.5 * h * (v + faster)
                        v = faster
                    xs[k + 1, variant, stretch, chain] = x
                    vs[k + 1, variant, stretch, chain] = v
