"""Wrenches and inertias carried from body to body towards the base: dynamics then cost what the chains are long.

The recursions of Luh, Walker and Paul (1980) for torques and of Walker and Orin (1982) for the mass matrix, as scalar
arithmetic like `kinematics.py`. A wrench and an inertia of body i are told in frame i, about its origin.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from elid_cli._types import Array
from elid_cli.model.kinematics import ZERO, Body, JointState, Passage, Vector, add, cross, passages, scale
from elid_cli.model.terms.base_term import Entry
from elid_cli.model.tracing import Scalar
from elid_cli.robot.robot import Robot

Tensor = tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]
"""xx, yy, zz, xy, xz, yz."""
UNITS: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Wrench(NamedTuple):
    """Force, N, and moment about the frame's origin, N·m."""

    force: Vector = ZERO
    moment: Vector = ZERO


class Inertia(NamedTuple):
    """Mass (kg), first moment (kg·m) and tensor about the frame's origin (kg·m²) of what moves as one body."""

    mass: Scalar = 0.0
    first: Vector = ZERO
    tensor: Tensor = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def with_unit_twists(bodies: Sequence[Body]) -> list[Body]:
    """Return bodies, the base first, whose twists are their own six unit motions."""
    return [bodies[0], *(replace(body, twists=unit_twists(k)) for k, body in enumerate(bodies[1:], 1))]


def unit_twists(body: int) -> tuple[tuple[int, tuple[Vector, Vector]], ...]:
    """Return the six unit motions of a body as `Body.twists`, which number them where the joints' numbers would stand.

    Rows of these numbers are then a body's wrench: `component_of` says which part of it.
    """
    motions = [*((axis, ZERO) for axis in UNITS), *((ZERO, axis) for axis in UNITS)]
    return tuple((-1 - 6 * body - part, motion) for part, motion in enumerate(motions))


def component_of(number: int) -> tuple[int, int] | None:
    """Return (body, part of its wrench) of a number of `unit_twists`; None of a joint's."""
    return divmod(-1 - number, 6) if number < 0 else None


def joint_torques(robot: Robot, states: Sequence[JointState], wrenches: Sequence[Wrench]) -> list[Scalar]:
    """Return the torques, N·m (N), of all joints that hold wrenches at bodies 0 (the base) to n."""
    total, torques = list(wrenches), [0.0] * robot.n  # type: list[Wrench], list[Scalar]
    for k, passage in reversed(list(enumerate(passages(robot, states)))):
        torques[k], arrived = _carried(passage, total[k + 1])
        place = robot.parents[k] + 1
        total[place] = Wrench(add(total[place].force, arrived.force), add(total[place].moment, arrived.moment))
    return torques


class JointRows:
    """Torques of all joints while the terms' entries come in, those of bodies with `unit_twists`."""

    def __init__(self, n: int) -> None:
        self._link: list[Scalar] = [0.0] * n
        self._motor: list[Scalar] = [0.0] * n
        self._parts: dict[int, list[Scalar]] = {}

    def hold(self, body: int, wrench: Wrench) -> None:
        """Let a body need a wrench besides."""
        self._parts[body] = [*wrench.force, *wrench.moment]

    def take(self, entry: Entry, values: Mapping[str, Scalar], elastic: Container[int]) -> None:
        """Add an entry, its parameter's value put in; motor rows of joints that are not `elastic` go to link rows."""
        side, number, name, value = entry
        own = value * values[name]
        if (at := component_of(number)) is not None:
            parts = self._parts.setdefault(at[0], [0.0] * 6)
            parts[at[1]] = parts[at[1]] + own
            return
        rows = self._motor if side == "motor" and number in elastic else self._link
        rows[number] = rows[number] + own

    def torques(self, robot: Robot, states: Sequence[JointState]) -> tuple[list[Scalar], list[Scalar]]:
        """Return (link rows, motor rows), what acts on bodies carried to the joints below."""
        if not self._parts:
            return self._link, self._motor
        wrenches = [Wrench()] * (robot.n + 1)
        for body, (x, y, z, a, b, c) in self._parts.items():
            wrenches[body] = Wrench((x, y, z), (a, b, c))
        held = joint_torques(robot, states, wrenches)
        return [own + of_bodies for own, of_bodies in zip(self._link, held, strict=True)], self._motor


def mass_rows(
    robot: Robot, states: Sequence[JointState], inertias: Sequence[Inertia]
) -> Iterator[tuple[int, int, Scalar]]:
    """Yield (i, j, entry) of the mass matrix of bodies 1 to n, kg·m², for i <= j where the tree leaves it not 0."""
    ways, composite = list(passages(robot, states)), list(inertias)
    for j in reversed(range(robot.n)):
        composite[j] = at_joint = _placed(composite[j], ways[j].after)
        mass, (x, y, _), tensor = at_joint
        if ways[j].revolute:
            wrench = Wrench((-y, x, 0.0), (tensor[4], tensor[5], tensor[2]))
        else:
            wrench = Wrench((0.0, 0.0, mass), (y, -x, 0.0))
        yield j, j, wrench.moment[2] if ways[j].revolute else wrench.force[2]
        below, i = _left(ways[j], wrench), robot.parents[j]
        while i >= 0:
            torque, below_it = _carried(ways[i], below)
            yield i, j, torque
            below, i = below_it, robot.parents[i]
        if (parent := robot.parents[j]) >= 0:
            composite[parent] = _sum(composite[parent], _moved_inertia(ways[j], at_joint))


def _carried(passage: Passage, wrench: Wrench) -> tuple[Scalar, Wrench]:
    """Return (torque of a joint, wrench on the body that carries it) of a wrench on the body that it moves."""
    arrived = _fixed(wrench, passage.after)
    return (arrived.moment if passage.revolute else arrived.force)[2], _left(passage, arrived)


def _left(passage: Passage, wrench: Wrench) -> Wrench:
    """Return a wrench at a joint's moving side as one on the body that carries it."""
    state = passage.state
    if passage.revolute:
        wrench = Wrench(_turned(state, wrench.force), _turned(state, wrench.moment))
    else:
        wrench = Wrench(wrench.force, add(wrench.moment, cross((0.0, 0.0, state.q), wrench.force)))
    return _fixed(wrench, passage.before)


def _turned(state: JointState, v: Vector) -> Vector:
    s, c = state.sin, state.cos
    return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


def _rotated(turn: Array, v: Vector) -> Vector:
    x, y, z = (sum((v[k] * float(turn[r, k]) for k in range(3)), 0.0) for r in range(3))
    return (x, y, z)


def _fixed(wrench: Wrench, transform: Array) -> Wrench:
    """Return a wrench in the frame in which a constant placement of its own frame is told."""
    force = _rotated(transform[:3, :3], wrench.force)
    return Wrench(force, add(_rotated(transform[:3, :3], wrench.moment), cross(_origin(transform), force)))


def _origin(transform: Array) -> Vector:
    return (float(transform[0, 3]), float(transform[1, 3]), float(transform[2, 3]))


def _placed(inertia: Inertia, transform: Array) -> Inertia:
    """Return an inertia in the frame in which a constant placement of its own frame is told."""
    turn = transform[:3, :3]
    xx, yy, zz, xy, xz, yz = inertia.tensor
    columns = [_rotated(turn, v) for v in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))]
    rows = [_rotated(turn, (columns[0][r], columns[1][r], columns[2][r])) for r in range(3)]
    tensor = (rows[0][0], rows[1][1], rows[2][2], rows[0][1], rows[0][2], rows[1][2])
    return _shifted(Inertia(inertia.mass, _rotated(turn, inertia.first), tensor), _origin(transform))


def _shifted(inertia: Inertia, p: Vector) -> Inertia:
    """Return an inertia about a point from which its own origin is at p."""
    m, c, (xx, yy, zz, xy, xz, yz) = inertia
    # sum of (|x|² E - x x') with x = p + r, whose part of r alone is the tensor; h = 2 c + m p
    h = add(scale(c, 2.0), scale(p, m))
    x, y, z = p[0] * h[0], p[1] * h[1], p[2] * h[2]
    first = add(c, scale(p, m))
    products = [p[a] * first[b] + c[a] * p[b] for a, b in ((0, 1), (0, 2), (1, 2))]
    tensor = (xx + (y + z), yy + (x + z), zz + (x + y), xy - products[0], xz - products[1], yz - products[2])
    return Inertia(m, first, tensor)


def _moved_inertia(passage: Passage, inertia: Inertia) -> Inertia:
    """Return an inertia at a joint's moving side as one of the body that carries it."""
    if not passage.revolute:
        return _placed(_shifted(inertia, (0.0, 0.0, passage.state.q)), passage.before)
    s, c = passage.state.sin, passage.state.cos
    xx, yy, zz, xy, xz, yz = inertia.tensor
    a = c * (xx - yy) - s * (xy * 2.0)
    tensor = (yy + c * a, xx - c * a, zz, xy + s * a, c * xz - s * yz, s * xz + c * yz)
    return _placed(Inertia(inertia.mass, _turned(passage.state, inertia.first), tensor), passage.before)


def _sum(one: Inertia, other: Inertia) -> Inertia:
    a, b = one.tensor, other.tensor
    tensor = (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])
    return Inertia(one.mass + other.mass, add(one.first, other.first), tensor)
