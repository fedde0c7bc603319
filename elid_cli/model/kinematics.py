"""Velocities and accelerations of a chain or a tree, body by body, in body frames.

Written as scalar arithmetic that runs on floats, on traced nodes or on arrays of samples alike. All quantities
of body i are expressed in frame i; the acceleration is that of frame i's origin minus gravity, so gravity needs
no separate term (Luh, Walker, Paul 1980). `twists` holds the columns of the Jacobians J_P and J_O of the paper's
eq. (8), expressed in frame i: the velocity of the origin and of the body for unit velocity of each joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.model.tracing import Scalar
from elid_cli.robot.robot import Robot

Vector = tuple[Scalar, Scalar, Scalar]
ZERO: Vector = (0.0, 0.0, 0.0)
_EXACT = 1e-14
"""Distance of a placement's number from 0 or ±1 below which it is that."""


@dataclass(frozen=True)
class JointState:
    """One joint's motion; sin and cos of q are given so that they are computed once, outside the trace."""

    sin: Scalar
    cos: Scalar
    q: Scalar
    dq: Scalar
    ddq: Scalar


@dataclass(frozen=True)
class Body:
    """Motion of one body in its own frame."""

    omega: Vector
    alpha: Vector
    acceleration: Vector
    twists: tuple[tuple[int, tuple[Vector, Vector]], ...]
    """(joint, (linear, angular) velocity per its unit velocity) of the joints that move this body."""


class Passage(NamedTuple):
    """A joint as it is passed: its motion, and constant 4x4 placements before and after it."""

    revolute: bool
    state: JointState
    before: Array
    after: Array


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def scale(a: Vector, factor: Scalar) -> Vector:
    """Return factor * a."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Vector, b: Vector) -> Scalar:
    """Return a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def acceleration_field(omega: Vector, alpha: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the rows of [alpha]x + [omega]x²: acceleration of a point per offset from the origin."""
    xx, yy, zz = omega[0] * omega[0], omega[1] * omega[1], omega[2] * omega[2]
    xy, xz, yz = omega[0] * omega[1], omega[0] * omega[2], omega[1] * omega[2]
    return (
        (-(yy + zz), xy - alpha[2], xz + alpha[1]),
        (xy + alpha[2], -(xx + zz), yz - alpha[0]),
        (xz - alpha[1], yz + alpha[0], -(xx + yy)),
    )


def passages(robot: Robot, states: Sequence[JointState]) -> Iterator[Passage]:
    """Yield every joint, base to tip, as bodies' motion and what acts on them pass it."""
    for joint, state, (before, after) in zip(robot.joints, states, robot.placements(), strict=True):
        placed = _with_offset(state, before, after) if joint.revolute else (state, before, after)
        yield Passage(joint.revolute, *placed)


def chain(robot: Robot, states: Sequence[JointState], *, gravity: bool = True, twists: bool = True) -> list[Body]:
    """Return the motion of bodies 0 (the base) to n.

    Parameters
    ----------
    robot
        Geometry and gravity (m/s², base frame).
    states
        One `JointState` per joint, rad (m) and s.
    gravity
        False leaves gravity out (for inertia matrices).
    twists
        False leaves the bodies' `twists` out, which cost as much as the depth of a body in the tree.

    """
    g = robot.gravity if gravity else (0.0, 0.0, 0.0)
    bodies = [Body(ZERO, ZERO, (-g[0], -g[1], -g[2]), ())]
    for k, (revolute, state, before, after) in enumerate(passages(robot, states)):
        body = _fixed(bodies[robot.parents[k] + 1], before)
        body = _turn(body, state, k) if revolute else _slide(body, state, k)
        if not twists:
            body = replace(body, twists=())
        bodies.append(_fixed(body, after, arriving=True))
    return bodies


def _with_offset(state: JointState, before: Array, after: Array) -> tuple[JointState, Array, Array]:
    """Return the joint's state and the placements around it, constant turns about its own axis taken into its angle.

    Two sines then turn once, instead of every vector that passes the joint.
    """
    turn = before[:3, :3]
    if turn[2, 2] == 1.0 and not np.array_equal(turn, np.eye(3)):
        state = _turned(state, float(turn[1, 0]), float(turn[0, 0]))
        placed = np.eye(4)
        placed[:3, 3] = before[:3, 3]
        before = placed
    size = float(np.hypot(after[0, 0], after[1, 0]))
    if after[1, 0] != 0.0 and size > _EXACT:
        s, c = float(after[1, 0]) / size, float(after[0, 0]) / size
        state = _turned(state, s, c)
        after = np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) @ after
        for exact in (0.0, 1.0, -1.0):  # rounding must not cost a multiplication
            after[np.abs(after - exact) < _EXACT] = exact
    return state, before, after


def _turned(state: JointState, s: float, c: float) -> JointState:
    """Return the state at an angle larger by that of sine `s` and cosine `c`."""
    return JointState(state.sin * c + state.cos * s, state.cos * c - state.sin * s, state.q, state.dq, state.ddq)


def _fixed(body: Body, transform: Array, *, arriving: bool = False) -> Body:
    """Move to a frame at a constant placement on the same body.

    The acceleration between the origins is told by the field in the frame of a body's parameters, whose elements are
    needed there anyway: the frame `arriving` at, or the one left.
    """
    p: Vector = (float(transform[0, 3]), float(transform[1, 3]), float(transform[2, 3]))
    turn = transform[:3, :3]
    moved = any(p)
    turned = not np.array_equal(turn, np.eye(3))

    def into(v: Vector) -> Vector:
        if not turned:
            return v
        x, y, z = (sum((v[k] * float(turn[k, c]) for k in range(3)), 0.0) for c in range(3))
        return (x, y, z)

    omega, alpha, acceleration = into(body.omega), into(body.alpha), body.acceleration
    if moved and not arriving:
        acceleration = add(acceleration, _times(acceleration_field(body.omega, body.alpha), p))
    acceleration = into(acceleration)
    if moved and arriving:
        x, y, z = (0.0 if abs(c) < _EXACT else c for c in (turn.T @ np.array(p)).tolist())
        acceleration = add(acceleration, _times(acceleration_field(omega, alpha), (x, y, z)))
    twists = tuple((j, (into(add(v, cross(w, p)) if moved else v), into(w))) for j, (v, w) in body.twists)
    return Body(omega, alpha, acceleration, twists)


def _times(rows: tuple[Vector, Vector, Vector], v: Vector) -> Vector:
    return (dot(rows[0], v), dot(rows[1], v), dot(rows[2], v))


def _turn(body: Body, state: JointState, joint: int) -> Body:
    """Turn about z by q."""
    s, c = state.sin, state.cos

    def into(v: Vector) -> Vector:
        return (c * v[0] + s * v[1], c * v[1] - s * v[0], v[2])

    omega = into(body.omega)
    alpha = into(body.alpha)
    # d/dt of the relative velocity seen from the turning frame: omega x (dq z)
    alpha = (alpha[0] + omega[1] * state.dq, alpha[1] - omega[0] * state.dq, alpha[2] + state.ddq)
    twists = (*((j, (into(v), into(w))) for j, (v, w) in body.twists), (joint, (ZERO, (0.0, 0.0, 1.0))))
    return Body((omega[0], omega[1], omega[2] + state.dq), alpha, into(body.acceleration), twists)


def _slide(body: Body, state: JointState, joint: int) -> Body:
    """Slide along z by q."""
    p: Vector = (0.0, 0.0, state.q)
    acceleration = add(body.acceleration, cross(body.alpha, p))
    acceleration = add(acceleration, cross(body.omega, cross(body.omega, p)))
    acceleration = add(acceleration, cross(scale(body.omega, 2.0), (0.0, 0.0, state.dq)))
    acceleration = add(acceleration, (0.0, 0.0, state.ddq))
    twists = (*((j, (add(v, cross(w, p)), w)) for j, (v, w) in body.twists), (joint, ((0.0, 0.0, 1.0), ZERO)))
    return Body(body.omega, body.alpha, acceleration, twists)
