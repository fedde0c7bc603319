"""Motion of a described robot under drives, many variants and stretches side by side.

The equations of motion are linearised about a motion that is near (the measured one, then the simulated one, until
both agree), which is vectorised over time; what is left is a short recursion in time, vectorised over variants. Its
steps are those of the trapezoidal rule, of second order and stable however stiff a spring is. Coulomb friction holds a
joint at rest: it is the torque, at most `fs` in size, that brings the velocity at the step's end nearest to zero
(projected Gauss-Seidel over the joints that couple). Friction that fades in over a speed (`drives.Fading`) is its mean
over the step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.drives import Drives, Fading, Joints
from elid_cli.model.linearised import Linearised, Local
from elid_cli.model.rollout_steps import advance

STEP = 1.1e-3
"""Longest step, s: 1 ms at the usual rates."""
ROUNDS = 12
"""Times that the equations are linearised about the motion that came out."""
SETTLED = 2e-6
"""Change of the motion, rad (m), below which it is the one that the equations were linearised about."""
FASTEST = 1e3
"""Largest velocity, rad/s (m/s), about which equations are linearised: beyond, the motion runs away."""


@dataclass(frozen=True)
class Added:
    """What effects add along a motion: `Joints.push` and `Joints.grip`, and how the push changes about that motion."""

    push: Array
    grip: Array
    stiffness: Array
    """Usual change of the push with the position of its coordinate, N·m/rad, (m,); at least 0."""
    damping: Array
    """The same with velocity, N·m·s/rad, (m,)."""


Along = Callable[[Local, Array, Array], Added]
"""What effects add along a motion x, v (N, S, m) about which equations are."""


def motion_of(
    equations: Linearised,
    start: tuple[Array, Array],
    near: Array,
    drives: Drives,
    joints: Joints,
    dt: float,
    along: Along | None = None,
    finer: int = 1,
) -> tuple[Array, Array]:
    """Return positions x and velocities at N samples, (N, S, m), of one robot.

    Parameters
    ----------
    equations, joints
        The robot, and its drives, one variant.
    start
        Positions and velocities that the stretches start from, (S, m).
    near
        A motion to linearise about at first, (N, S, m).
    drives
        What acts.
    dt
        Time between samples, s; the steps of `drives` divide it.
    finer
        How often in a sample the equations are taken; the steps in a sample are a multiple of it.
    along
        What effects add, of the motion that they act along; None: there are none.
    """
    x, v = between(near, np.gradient(near, dt, axis=0), dt, finer)
    for number in range(ROUNDS):
        local = equations.about(x, v, dt / finer if number else None, finer)
        if along is not None:
            # a spring or damper that is stiff beside the masses must act on the motion that comes out, too
            added = along(local, x, v)
            local = replace(local, slope=local.slope + np.diag(added.stiffness))
            push = added.push - (added.damping * 0.5 * (v[1:] + v[:-1]))[:, None]
            joints = replace(joints, push=push, grip=added.grip, damping=added.damping)
        found, speed = variants_of(equations, local, start, drives, joints, dt)
        found, speed = found[:, 0], speed[:, 0]
        wild = np.array(~np.isfinite(found).all(axis=(0, 2)))
        change = np.abs(found - x)[:, ~wild].max(initial=0.0)
        # a stretch that runs away has no motion to linearise about
        x = np.where(wild[:, None], x, np.clip(found, x - 1.0, x + 1.0))
        v = np.where(wild[:, None], v, np.clip(speed, -FASTEST, FASTEST))
        if change < SETTLED:
            break
    return found[::finer], speed[::finer]


def variants_of(
    equations: Linearised, local: Local, start: tuple[Array, Array], drives: Drives, joints: Joints, dt: float
) -> tuple[Array, Array]:
    """Return positions and velocities at the instants of equations that are linear, (N, V, S, m), of V variants.

    As `motion_of`; joints that do not couple are taken apart. `dt` is the time between samples.
    """
    dt /= local.finer
    instants, stretches, count = local.force.shape
    variants, positions, velocities = joints.coulomb.shape[0], *np.empty((2, 0))
    shape = (instants, variants, stretches, count)
    for taken, owner in equations.chains:
        whole = taken.size == count and bool(np.array_equal(taken.ravel(), np.arange(count)))
        mass, slope, swerve = (_square(part, taken, whole=whole) for part in (local.mass, local.slope, local.swerve))
        force, place, speed = (_along(part, taken, whole=whole) for part in (local.force, local.place, local.speed))
        moved = Local(mass, force, slope, swerve, place, speed)
        x, v = advance(
            moved, (start[0][:, taken], start[1][:, taken]), _on(drives, owner, local.finer, whole=whole),
            _of(joints, owner, taken), dt,
        )  # fmt: skip
        if whole:
            return x.reshape(shape), v.reshape(shape)
        if not len(positions):
            positions, velocities = np.empty((2, *shape))
        positions[..., taken.ravel()] = x.reshape(*x.shape[:3], -1)
        velocities[..., taken.ravel()] = v.reshape(*v.shape[:3], -1)
    return positions, velocities


def between(x: Array, v: Array, dt: float, finer: int) -> tuple[Array, Array]:
    """Return a motion `finer` times per sample, by the cubic through positions and velocities (N, …) at two samples."""
    if finer == 1:
        return x, v
    shape = (finer * (len(x) - 1) + 1, *x.shape[1:])
    positions, velocities = np.empty((2, *shape))
    for k in range(finer):
        u = k / finer
        h, own = [1 - u * u * (3 - 2 * u), u * u * (3 - 2 * u), u * (1 - u) ** 2, u * u * (u - 1)], slice(k, -1, finer)
        g = [-6 * u * (1 - u), 6 * u * (1 - u), (1 - u) * (1 - 3 * u), u * (3 * u - 2)]
        positions[own] = h[0] * x[:-1] + h[1] * x[1:] + dt * (h[2] * v[:-1] + h[3] * v[1:])
        velocities[own] = (g[0] * x[:-1] + g[1] * x[1:]) / dt + g[2] * v[:-1] + g[3] * v[1:]
    positions[-1], velocities[-1] = x[-1], v[-1]
    return positions, velocities


def _along(values: Array, taken: NDArray[np.intp], *, whole: bool) -> Array:
    """Return values (…, m) of the coordinates of chains, (…, L, s); of the `whole` in its order, the same memory."""
    if whole:
        return values.reshape(*values.shape[:-1], *taken.shape)
    return np.asarray(values[..., taken])


def _square(values: Array, taken: NDArray[np.intp], *, whole: bool) -> Array:
    """Return matrices (N, S, m, m) of the coordinates of chains, (N, S, L, s, s): as `_along`."""
    if whole and len(taken) == 1:
        return values[:, :, None]
    if whole and taken.shape[1] == 1:
        return np.diagonal(values, axis1=2, axis2=3)[..., None, None]
    return np.asarray(values[:, :, taken[:, :, None], taken[:, None]])


def _on(drives: Drives, owner: NDArray[np.intp], finer: int, *, whole: bool) -> Drives:
    """Return what acts on the coordinates of chains; nothing on links behind a spring. `whole`: all, in order."""
    held = owner >= 0
    every = bool(held.all())

    def of_motors(values: Array) -> Array:
        return _along(values, owner, whole=whole) if every else np.asarray(np.where(held, values[..., owner], 0.0))

    told, kp, kd = (of_motors(values) for values in (drives.told, drives.kp, drives.kd))
    ki, smoothing, holding, lag, since = (
        np.zeros_like(kp) if part is None else of_motors(part)
        for part in (drives.ki, drives.smoothing, drives.held, drives.lag, drives.since)
    )
    return Drives(
        told,
        kp,
        kd,
        np.where(held, drives.limit[owner], np.inf),
        ki,
        smoothing,
        holding / finer,
        lag,
        drives.stepped,
        since * finer,
    )


def _of(joints: Joints, owner: NDArray[np.intp], taken: NDArray[np.intp]) -> Joints:
    """Return the drives of the motors that own coordinates, and what effects do at the coordinates themselves."""
    held = owner >= 0

    def over_time(values: Array | None) -> Array:
        return np.zeros((1, 1, 1, *owner.shape)) if values is None else values[..., taken]

    every = bool(held.all())

    def of_motors(values: Array) -> Array:
        found = values[:, owner]
        return np.asarray((found if every else np.where(held, found, 0.0))[:, None])

    own = map(of_motors, (joints.inertia, joints.coulomb, joints.viscous, joints.offset))
    inertia, coulomb, viscous, offset = own
    if joints.damping is not None:
        viscous = viscous + joints.damping[taken]
    fading = joints.fading
    if fading is not None:
        fading = Fading(of_motors(fading.friction), of_motors(fading.width), of_motors(fading.lead))
    push, grip = over_time(joints.push), over_time(joints.grip)
    return Joints(inertia, coulomb, viscous, offset, push, grip, fading=fading)
