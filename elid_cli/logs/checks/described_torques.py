"""Torques that the described bodies need, by their masses, first moments and inertias (Newton and Euler).

Vectors are in the frame that turns with each joint, and instants lie along the last axis. A body's rotation is told by
one tensor, A = [ω̇]× + [ω]×[ω]×: a point r of it accelerates by A r more than the origin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.memory import Recent
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot

MASSES = 4
"""Link parameters that weight depends on: mass and first moment."""
ROUNDING = 1e-9
"""Share of the largest torque below which one is rounding."""


def gravity_torques(robot: Robot, q: Array) -> Array:
    """Return the torques, N·m (N), that hold the described bodies at rest at positions (N, n), rad (m); same shape.

    NaN at joints whose load depends on a mass or first moment that is unknown.
    """
    return _known(robot, (q,), -np.array(robot.gravity), MASSES)


def inertial_torques(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torques, N·m (N), that move the described bodies without gravity, rotors and friction; (N, n).

    NaN at joints whose load depends on a parameter that is unknown.
    """
    return _known(robot, (q, dq, ddq), np.zeros(3), len(LINK_PARAMETERS))


def _known(robot: Robot, motion: tuple[Array, ...], base: Array, used: int) -> Array:
    """Return the torques where the base accelerates; NaN where they depend on an unknown one of the `used` kinds."""
    _, bodies, others = _DESCRIBED.of((id(robot), used), lambda: _described(robot, used))
    if not bodies:
        return np.full_like(motion[0], math.nan)
    rows = [np.ascontiguousarray(values.T) for values in motion]
    torques = _torques(bodies, rows, base)
    if others:
        other = _torques(others, rows, base)
        least = ROUNDING * float(np.nanmax(np.abs(other), initial=0.0))
        torques[(np.abs(torques - other) > least).any(axis=1)] = math.nan
    return np.asarray(torques.T)


class _Body(NamedTuple):
    """A joint, where it is on the body that carries it, and what it carries, in the frame that turns with it."""

    parent: int
    revolute: bool
    turn: Array | None
    """Rotation at position 0 to the carrying body's frame, (3, 3); None: none."""
    place: Array
    """Origin in that frame, m (3,)."""
    mass: float
    first: Array
    """First moment as the matrix of its cross product, kg·m (3, 3)."""
    moments: Array
    """First moment, kg·m, and columns of the second moment about the origin, kg·m², (4, 3)."""


_DESCRIBED: Recent[tuple[Robot, list[_Body], list[_Body]]] = Recent(8)
"""Bodies by robot, which is kept with them so that its identity stands for it, and by the parameters used."""


def _described(robot: Robot, used: int) -> tuple[Robot, list[_Body], list[_Body]]:
    """Return a robot, its bodies with 0 for unknown parameters, none if no mass is known, and with 1 if any is not."""
    known = np.zeros((robot.n, len(LINK_PARAMETERS)))
    kinds = LINK_PARAMETERS[:used]
    known[:, :used] = [[joint.parameters.get(kind, math.nan) for kind in kinds] for joint in robot.joints]
    if np.isnan(known[:, 0]).all():
        return robot, [], []
    whole = not np.isnan(known).any()
    return robot, _bodies(robot, np.nan_to_num(known)), [] if whole else _bodies(robot, np.nan_to_num(known, nan=1.0))


def _bodies(robot: Robot, parameters: Array) -> list[_Body]:
    """Return the bodies with given parameters, (n, 10), in the order of `LINK_PARAMETERS`."""
    placements, bodies = robot.placements(), []
    for joint, parent, (before, after), ten in zip(robot.joints, robot.parents, placements, parameters, strict=True):
        carried = before if parent < 0 else placements[parent][1] @ before
        turn = None if np.array_equal(carried[:3, :3], np.eye(3)) else carried[:3, :3]
        mass, (xx, yy, zz, xy, xz, yz) = float(ten[0]), ten[4:]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        own, origin = after[:3, :3], after[:3, 3]
        turned = own @ ten[1:4]
        second = own @ (0.5 * np.trace(inertia) * np.eye(3) - inertia) @ own.T
        second += np.outer(turned, origin) + np.outer(origin, turned) + mass * np.outer(origin, origin)
        first = turned + mass * origin
        bodies.append(
            _Body(parent, joint.revolute, turn, carried[:3, 3], mass, _crossing(first), np.vstack([first, second]))
        )
    return bodies


def _crossing(a: Array) -> Array:
    """Return the matrix of the cross product of a vector, (3, 3)."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _torques(bodies: Sequence[_Body], motion: Sequence[Array], base: Array) -> Array:
    """Return the torques of bodies, (n, N), at rest at positions (n, N), or with velocities and accelerations."""
    q, moving = motion[0], len(motion) > 1
    cos, sin = np.cos(q), np.sin(q)
    still = np.zeros((3, 3 if moving else 1, q.shape[1]))
    still[:, -1] = base[:, None]
    states: list[tuple[Array, Array | None]] = []
    loads = []
    for k, body in enumerate(bodies):
        state, bend = states[body.parent] if body.parent >= 0 else (still, None)
        if bend is not None:
            state = state.copy()
            state[:, -1] += (body.place @ bend).reshape(3, -1)
        if body.turn is not None:
            state = (body.turn.T @ state.reshape(3, -1)).reshape(state.shape)
        state = _turned(state, cos[k], -sin[k]) if body.revolute else state.copy()
        bend = _moved(body, state, [values[k] for values in motion]) if moving else None
        states.append((state, bend))
        loads.append(_load(body, state[:, -1], bend))
    torques = np.empty_like(q)
    for k in reversed(range(len(bodies))):
        body, load = bodies[k], loads[k]
        torques[k] = load[2, 1 if body.revolute else 0]
        if body.parent >= 0:
            loads[body.parent] += _passed(body, load, q[k], cos[k], sin[k])
    return torques


def _turned(vectors: Array, cos: Array, sin: Array) -> Array:
    """Return vectors, (3, k, N), turned about z."""
    turned = np.empty_like(vectors)
    turned[0] = vectors[0] * cos - vectors[1] * sin
    turned[1] = vectors[0] * sin + vectors[1] * cos
    turned[2] = vectors[2]
    return turned


def _moved(body: _Body, state: Array, joint: Sequence[Array]) -> Array:
    """Add a joint's motion to angular velocity and acceleration and the origin's, (3, 3, N); return A by columns."""
    (rate, change, pull), (position, speed, bend) = state.swapaxes(0, 1), joint
    moved, times = (change, 1.0) if body.revolute else (pull, 2.0)
    moved[0] += times * rate[1] * speed
    moved[1] -= times * rate[0] * speed
    moved[2] += bend
    if body.revolute:
        rate[2] += speed
    columns = rate[:, None] * rate
    square = columns[0, 0] + columns[1, 1] + columns[2, 2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        columns[i, i] -= square
        columns[j, k] += change[i]
        columns[k, j] -= change[i]
    if not body.revolute:
        pull += columns[2] * position
    return np.asarray(columns.reshape(3, -1))


def _load(body: _Body, pull: Array, bend: Array | None) -> Array:
    """Return force and moment about the origin, (3, 2, N), that a body's motion needs."""
    load = np.empty((3, 2, pull.shape[1]))
    load[:, 0], load[:, 1] = body.mass * pull, body.first @ pull
    if bend is not None:
        force, *second = (body.moments @ bend).reshape(4, 3, -1)
        load[:, 0] += force
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            load[i, 1] += second[j][k] - second[k][j]
    return load


def _passed(body: _Body, load: Array, position: Array, cos: Array, sin: Array) -> Array:
    """Return a joint's force and moment, (3, 2, N), in the frame of the body that carries it, about its origin."""
    if body.revolute:
        load = _turned(load, cos, sin)
    else:
        load[0, 1] -= position * load[1, 0]
        load[1, 1] += position * load[0, 0]
    if body.turn is not None:
        load = (body.turn @ load.reshape(3, -1)).reshape(load.shape)
    load[:, 1] += _crossing(body.place) @ load[:, 0]
    return load
