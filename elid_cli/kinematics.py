"""Velocities and accelerations of a serial chain, body by body, in body frames.

Written as scalar arithmetic that runs on floats, on traced nodes or on arrays of samples alike. All quantities
of body i are expressed in frame i; the acceleration is that of frame i's origin minus gravity, so gravity needs
no separate term (Luh, Walker, Paul 1980). `twists` holds the columns of the Jacobians J_P and J_O of the paper's
eq. (8), expressed in frame i: the velocity of the origin and of the body for unit velocity of each joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli.robot import Robot
from elid_cli.trace import Scalar

Vector = tuple[Scalar, Scalar, Scalar]
Array = NDArray[np.float64]
ZERO: Vector = (0.0, 0.0, 0.0)


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
    twists: tuple[tuple[Vector, Vector], ...]
    """(linear, angular) velocity per unit velocity of joints 1…i."""


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


def chain(robot: Robot, states: Sequence[JointState], *, gravity: bool = True) -> list[Body]:
    """Return the motion of bodies 0 (the base) to n.

    Parameters
    ----------
    robot
        Geometry and gravity (m/s², base frame).
    states
        One `JointState` per joint, rad (m) and s.
    gravity
        False leaves gravity out (for inertia matrices).

    """
    g = robot.gravity if gravity else (0.0, 0.0, 0.0)
    bodies = [Body(ZERO, ZERO, (-g[0], -g[1], -g[2]), ())]
    for joint, state, (before, after) in zip(robot.joints, states, robot.placements(), strict=True):
        if joint.revolute:
            state, before = _with_offset(state, before)
        body = _fixed(bodies[-1], before)
        body = _turn(body, state) if joint.revolute else _slide(body, state)
        bodies.append(_fixed(body, after))
    return bodies


def _with_offset(state: JointState, before: Array) -> tuple[JointState, Array]:
    """Return the joint's state and the placement before it, a constant turn about its own axis taken into its angle.

    Two sines then turn once, instead of every vector that passes the joint.
    """
    turn = before[:3, :3]
    if np.array_equal(turn, np.eye(3)) or turn[2, 2] != 1.0:
        return state, before
    s, c = float(turn[1, 0]), float(turn[0, 0])
    placed = np.eye(4)
    placed[:3, 3] = before[:3, 3]
    turned = JointState(state.sin * c + state.cos * s, state.cos * c - state.sin * s, state.q, state.dq, state.ddq)
    return turned, placed


def _fixed(body: Body, transform: Array) -> Body:
    """Move to a frame at a constant placement on the same body."""
    p: Vector = (float(transform[0, 3]), float(transform[1, 3]), float(transform[2, 3]))
    turn = transform[:3, :3]
    moved = any(p)
    turned = not np.array_equal(turn, np.eye(3))

    def into(v: Vector) -> Vector:
        if not turned:
            return v
        x, y, z = (sum((v[k] * float(turn[k, c]) for k in range(3)), 0.0) for c in range(3))
        return (x, y, z)

    acceleration = body.acceleration
    if moved:
        acceleration = add(acceleration, cross(body.alpha, p))
        acceleration = add(acceleration, cross(body.omega, cross(body.omega, p)))
    twists = tuple((into(add(v, cross(w, p)) if moved else v), into(w)) for v, w in body.twists)
    return Body(into(body.omega), into(body.alpha), into(acceleration), twists)


def _turn(body: Body, state: JointState) -> Body:
    """Turn about z by q."""
    s, c = state.sin, state.cos

    def into(v: Vector) -> Vector:
        return (c * v[0] + s * v[1], c * v[1] - s * v[0], v[2])

    omega = into(body.omega)
    alpha = into(body.alpha)
    # d/dt of the relative velocity seen from the turning frame: omega x (dq z)
    alpha = (alpha[0] + omega[1] * state.dq, alpha[1] - omega[0] * state.dq, alpha[2] + state.ddq)
    twists = (*((into(v), into(w)) for v, w in body.twists), (ZERO, (0.0, 0.0, 1.0)))
    return Body((omega[0], omega[1], omega[2] + state.dq), alpha, into(body.acceleration), twists)


def _slide(body: Body, state: JointState) -> Body:
    """Slide along z by q."""
    p: Vector = (0.0, 0.0, state.q)
    acceleration = add(body.acceleration, cross(body.alpha, p))
    acceleration = add(acceleration, cross(body.omega, cross(body.omega, p)))
    acceleration = add(acceleration, cross(scale(body.omega, 2.0), (0.0, 0.0, state.dq)))
    acceleration = add(acceleration, (0.0, 0.0, state.ddq))
    twists = (*((add(v, cross(w, p)), w) for v, w in body.twists), ((0.0, 0.0, 1.0), ZERO))
    return Body(body.omega, body.alpha, acceleration, twists)
