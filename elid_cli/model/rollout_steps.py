"""Steps of a rollout in time: by loops, compiled where Numba is installed; without it, of many rollouts by arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elid_cli._types import Array
from elid_cli.model.drives import Drives, Joints, filter_weights
from elid_cli.model.linearised import Local
from elid_cli.model.rollout_alone import compiled_steps_alone, steps_alone
from elid_cli.model.rollout_loops import SWEEPS, compiled_steps, faded
from elid_cli.model.rollout_loops import steps as plain_steps

FEW = 10
"""Rollouts of a chain of joints that loops in plain Python step as fast as arrays do; one in a tenth of the time."""


def advance(part: Local, start: tuple[Array, Array], drives: Drives, joints: Joints, dt: float) -> tuple[Array, Array]:
    """Return positions and velocities (N, V, S, L, s), by loops; without Numba those of more than `FEW` by arrays."""
    shape = np.broadcast_shapes(joints.coulomb.shape, part.force.shape[1:])
    fast = compiled_steps()
    if fast is None and np.prod(shape[:-1]) > FEW:
        return advance_arrays(part, start, drives, joints, dt)
    take: Callable[..., None] = fast or plain_steps
    if shape[-1] == 1:
        take = compiled_steps_alone() if fast else steps_alone
    x, v = np.empty((2, len(part.force), *shape))
    flat = [values if values.shape == shape else np.broadcast_to(values, shape) for values in (
        joints.inertia, joints.coulomb, joints.viscous, joints.offset, drives.limit, *_fading(joints))]  # fmt: skip
    over_time = [(values, (len(values), *shape)) for values in _over_time(joints)]
    flat += [values if values.shape == whole else np.broadcast_to(values, whole) for values, whole in over_time]
    ki = np.zeros_like(drives.kp) if drives.ki is None else drives.ki
    weights = _weights(drives, dt / (len(drives.told) // max(len(part.force) - 1, 1)))
    holds, lag, since = (
        np.zeros_like(drives.kp) if part is None else part for part in (drives.held, drives.lag, drives.since)
    )
    arrays = (
        part.mass, part.force, part.slope, part.swerve, part.place, part.speed,
        drives.told, drives.kp, drives.kd, ki, holds, lag, since, *weights, *start,
    )  # fmt: skip
    # contiguous and writable, as a broadcast view is not: of every other kind of array Numba compiles the loops anew
    ready = (
        values if values.flags.c_contiguous and values.flags.writeable else np.array(values, order="C")
        for values in (*arrays, *flat)
    )
    with np.errstate(all="ignore"):  # of what runs away, as the compiled loops have it
        take(*ready, dt, 0.5 if drives.stepped is None else 0.0, float(drives.stepped == "implicit"), x, v)
    return x, v


def _weights(drives: Drives, h: float) -> tuple[Array, Array, Array, Array]:
    return filter_weights(np.zeros_like(drives.kp) if drives.smoothing is None else drives.smoothing, h)


def _fading(joints: Joints) -> tuple[Array, Array, Array]:
    """Return friction, width and lead of what fades in; no friction where there is none."""
    if joints.fading is None:
        none = np.zeros_like(joints.coulomb)
        return none, np.ones_like(none), none
    return joints.fading.friction, joints.fading.width, joints.fading.lead


def _over_time(joints: Joints) -> tuple[Array, Array]:
    """Return push and grip of every interval; one that stands for all where there are none."""
    none = np.zeros((1, *joints.coulomb.shape))
    return (none if joints.push is None else joints.push, none if joints.grip is None else joints.grip)


def advance_arrays(
    part: Local, start: tuple[Array, Array], drives: Drives, joints: Joints, dt: float
) -> tuple[Array, Array]:
    """Return what `advance` does, vectorised over variants, stretches and chains."""
    instants = len(part.force)
    steps = len(drives.told) // max(instants - 1, 1)
    h, size = dt / steps, part.force.shape[-1]
    diagonal = np.arange(size)
    shape = np.broadcast_shapes(joints.coulomb.shape, part.force.shape[1:])
    x, v = (np.broadcast_to(value, shape).copy() for value in start)
    positions, velocities = np.empty((2, instants, *shape))
    positions[0], velocities[0] = x, v
    held, gained, summed = np.zeros((3, *shape))
    seen, (half, ramp, whole, rise) = v.copy(), _weights(drives, h)  # the velocity as a drive's filter has it
    ki = 0.0 if drives.ki is None else drives.ki
    holds = np.zeros(drives.kp.shape, dtype=bool) if drives.held is None else drives.held > 0
    acting = np.where(holds, 0.0, 1.0)  # of what a drive gives as it moves within a sample
    often = np.where(holds, 1.0 if drives.held is None else drives.held, 1.0)  # in a part of a sample, or less
    periods = np.maximum(np.round(steps / often), 1)
    lag = np.zeros(drives.kp.shape) if drives.lag is None else drives.lag / h
    since = np.zeros(drives.kp.shape) if drives.since is None else np.round(drives.since * steps)
    older = sampled = np.zeros(shape)
    push, grip = (np.broadcast_to(values, (len(values), *shape)) for values in _over_time(joints))
    every, own = np.arange(size), [np.index_exp[..., k] for k in range(size)]
    friction, width, ahead = (np.broadcast_to(values, shape) for values in _fading(joints))
    ahead, slowed, fades = ahead / h, np.zeros(shape), friction > 0
    later, damped = 0.5 if drives.stepped is None else 0.0, float(drives.stepped == "implicit")
    smooth, between = 2.0 * later, 0.5 if later else 0.5 * (steps - 1) / steps
    # friction that fades in follows the acceleration without the damping of the end of Euler's steps
    apart = later == 0.0 and fades.any()
    for k in range(instants - 1):
        bend, swerve = (0.5 * (slope[k] + slope[k + 1]) for slope in (part.slope, part.swerve))
        half_way = (1.0 - between) * part.mass[k] + between * part.mass[k + 1]
        mass = np.broadcast_to(half_way, (*shape, size)).copy()
        mass[..., diagonal, diagonal] += joints.inertia
        full = mass + smooth * (0.25 * h * h * bend + 0.5 * h * swerve)
        stiff = acting * (smooth * (ramp * drives.kd + 0.25 * h * drives.kp) + damped * drives.kd)
        full[..., diagonal, diagonal] += h * ((1.0 - later) * joints.viscous + stiff)
        inverse = ending = np.linalg.inv(full)
        if apart:
            inverse = np.linalg.inv(mass)
        give = np.maximum(np.diagonal(inverse, axis1=-2, axis2=-1), 1e-300)
        columns = [inverse[..., :, i] for i in every]
        more = grip[k if len(grip) > 1 else 0]
        bound = h * np.maximum(joints.coulomb + np.where(fades, 0.0, more), 0.0)
        soft = h * np.where(fades, np.maximum(friction + more, 0.0), 0.0)  # what effects add fades in as well
        pulled, place = part.force[k] + joints.offset + push[k if len(push) > 1 else 0], part.place[k]
        speed = part.speed[k]
        pull, move, gain = ((of[k + 1] - of[k]) / steps for of in (part.force, part.place, part.speed))
        for j in range(steps):
            middle = x + later * h * v
            drive = drives.told[k * steps + j] - drives.kp * middle - ki * (summed + later * h * x)
            drive -= drives.kd * (half * v + (1.0 - half) * seen)
            # what a drive gives as the velocity changes is in `inverse`: at its limit it gives none
            given = smooth * acting * (ramp * drives.kd + 0.25 * h * drives.kp) * gained
            if holds.any():
                at = k * steps + j
                phase = (at + since) % periods
                computed = drives.told[at] - drives.kp * x - drives.kd * seen - ki * summed
                older = computed if at == 0 else np.where(phase == 0, sampled, older)
                sampled = computed if at == 0 else np.where(phase == 0, computed, sampled)
                behind = np.clip(lag - phase, 0.0, 1.0)
                now = behind * older + (1.0 - behind) * sampled
                coming = drives.told[min(at + 1, len(drives.told) - 1)]
                coming = coming - drives.kp * (x + h * v) - drives.kd * seen - ki * (summed + h * x)
                now += np.where(phase == periods - 1, np.maximum(-lag, 0.0), 0.0) * (coming - sampled)
                drive = np.where(holds, now, drive)
            drive = np.clip(drive - given, -drives.limit, drives.limit) + given - joints.viscous * v
            drive -= pulled + (j + later) * pull
            drive -= _times(bend, middle - (place + (j + later) * move))
            drive -= _times(swerve, v - (speed + (j + later) * gain))
            acts = h * drive
            faster = v + _times(inverse, acts - held - slowed)
            for _ in range(SWEEPS):
                for i in every:
                    here = own[i]
                    if fades[here].any():
                        free = faster[here] + give[here] * slowed[here]
                        fade = _faded if later else _faded_at_once
                        now = fade(v[here], free, give[here], soft[here], width[here], ahead[here])
                        faster -= columns[i] * (now - slowed[here])[..., None]
                        slowed[here] = now
                    free, slid = faster[here] + give[here] * held[here], np.sign(v[here]) * bound[here]
                    # of one that passes through rest, friction turns when it does
                    end = free - give[here] * slid
                    with np.errstate(divide="ignore", invalid="ignore"):
                        turned = np.where(end * v[here] < 0, slid * (v[here] + end) / (v[here] - end), -slid)
                    still = (v[here] == 0) | (later == 0.0)
                    low = np.where(still, -bound[here], np.minimum(slid, turned))
                    high = np.where(still, bound[here], np.maximum(slid, turned))
                    now = np.clip(free / give[here], low, high)
                    faster -= columns[i] * (now - held[here])[..., None]
                    held[here] = now
            if apart:
                faster = v + _times(ending, acts - held - slowed)
            x, before = x + h * (later * v + (1.0 - later) * faster), x
            summed += 0.5 * h * (before + x)
            seen = (1.0 - whole) * seen + whole * v + rise * (faster - v)
            gained, v = faster - v, faster
        positions[k + 1], velocities[k + 1] = x, v
    return positions, velocities


def _faded(v: Array, free: Array, give: Array, bound: Array, width: Array, ahead: Array) -> Array:
    """Return `rollout_loops.faded` of every variant: those that slide have all of their friction."""
    found: Array = np.copysign(bound, v + free)
    end = free - give * found
    far = ahead * (end - v)
    sliding = (bound == 0) | (np.minimum(found * (v + far), found * (end + far)) >= bound * width)
    parts = (part[~sliding] for part in (v, free, give, bound, width, ahead))
    found[~sliding] = [faded(*values) for values in zip(*(part.tolist() for part in parts), strict=True)]
    return found


def _faded_at_once(v: Array, free: Array, give: Array, bound: Array, width: Array, ahead: Array) -> Array:
    """Return the impulse of friction that fades in over a step of Euler's: of the velocity at its start."""
    steep = bound / width
    return np.asarray(np.clip(steep * (v + ahead * (free - v)) / (1.0 + steep * ahead * give), -bound, bound))


def _times(matrix: Array, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])
