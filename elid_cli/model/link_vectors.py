"""What sensors on links feel, angular velocity and specific force, and how that changes with the joints' motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.model.duals import Dual
from elid_cli.model.kinematics import Body, JointState, Vector, acceleration_field, add, chain, dot
from elid_cli.model.program import Program, compile_program
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.robot.robot import Robot
from elid_cli.signals.trigonometry import sine_and_cosine

AXES = 3
_RATES = 3
"""q, q', q''."""
_INPUTS = 2 + _RATES
"""Inputs of a joint: sin q, cos q, q, q', q''."""


class Slopes(NamedTuple):
    """Vectors of m links and their derivatives."""

    values: Array
    """(N, m, 3)."""
    by_motion: Array
    """By q, q' (and q'') of every joint, (orders, N, m, 3, n)."""
    by_place: Array
    """By where on the link they are felt, (N, m, 3, 3); (N, m, 3, 0) where that is all the same."""


class LinkVectors(ABC):
    """A vector of each of some links in that link's own frame, by the motion of the joints.

    Parameters
    ----------
    robot
        The joints that move.
    joints
        Whose links are looked at, m.
    """

    orders: int
    """Of how many of q, q', q'' it is a function."""
    placed: int
    """Coordinates of the place on the link that it is a function of: 3 or 0."""

    def __init__(self, robot: Robot, joints: Sequence[int]) -> None:
        self.robot, self.joints = robot, tuple(joints)

    @abstractmethod
    def _vector(self, body: Body, place: Vector) -> Vector:
        """Return the vector of one body."""

    def _field(self, body: Body) -> Sequence[Vector]:
        """Return the rows of its derivatives by the place."""
        return ()

    def values(self, motion: Sequence[Array], places: Array | None = None) -> Array:
        """Return the vectors, (N, m, 3).

        Parameters
        ----------
        motion
            q, q' and q'' of all joints, as many as it takes, (N, n) each; rad (m) and s.
        places
            Where on the links, in their frames, m, (m, 3).
        """
        return self.slopes(motion, places).values

    def slopes(self, motion: Sequence[Array], places: Array | None = None) -> Slopes:
        """Return them and their derivatives, of the same motion and places as `values`."""
        program, where = self._traced
        samples, n = motion[0].shape
        many = len(self.joints)
        rows = np.zeros((_INPUTS * n + self.placed * many, samples))
        for k in range(n):
            for order in range(self.orders):
                rows[_INPUTS * k + 2 + order] = motion[order][:, k]
            sine_and_cosine(rows[_INPUTS * k + 2], rows[_INPUTS * k], rows[_INPUTS * k + 1])
        if self.placed and places is not None:
            rows[_INPUTS * n :] = places.reshape(-1, 1)
        out = np.empty((program.outputs, samples))
        program.run(rows, out)
        plain = AXES * many * (1 + self.placed)
        vectors = out[: AXES * many].T.reshape(samples, many, AXES)
        field = out[AXES * many : plain].T.reshape(samples, many, AXES, self.placed)
        slopes = np.zeros((self.orders, samples, AXES * many, n))
        for place, (row, number) in enumerate(where, plain):
            slopes[number % _RATES, :, row, number // _RATES] = out[place]
        return Slopes(vectors, slopes.reshape(self.orders, samples, many, AXES, n), field)

    @cached_property
    def _traced(self) -> tuple[Program, list[tuple[int, int]]]:
        """Return the program, and of every derivative by the motion its row, and 3 joint + order."""
        n, many = self.robot.n, len(self.joints)
        graph = Graph(_INPUTS * n + self.placed * many)
        states: list[Any] = []
        for k in range(n):
            sin, cos, *motion = (graph.input(_INPUTS * k + d) for d in range(_INPUTS))
            q = motion[0]
            turned = Dual(sin, {_RATES * k: cos}), Dual(cos, {_RATES * k: -sin})
            moved = [Dual(rate, {_RATES * k + d: 1.0}) for d, rate in enumerate((q, *motion[1:]))]
            moved[self.orders :] = [Dual(0.0)] * (_RATES - self.orders)
            states.append(JointState(*turned, *moved))  # type: ignore[arg-type]
        bodies = chain(self.robot, states, twists=False)
        rows: list[Any] = []
        fields: list[Any] = []
        for number, joint in enumerate(self.joints):
            body = bodies[joint + 1]  # the base is the first
            first = _INPUTS * n + self.placed * number
            place = tuple(graph.input(first + d) for d in range(self.placed))
            rows += self._vector(body, place)  # type: ignore[arg-type]
            fields += [element for row in self._field(body) for element in row]
        values: list[Scalar] = [row.value if isinstance(row, Dual) else row for row in (*rows, *fields)]
        where = []
        for number, row in enumerate(rows):
            for slope_by, slope in row.slopes.items() if isinstance(row, Dual) else ():
                where.append((number, slope_by))
                values.append(slope)
        return compile_program(graph, values), where


class LinkRates(LinkVectors):
    """Angular velocities of links, rad/s: what gyroscopes measure."""

    orders, placed = 2, 0

    def _vector(self, body: Body, place: Vector) -> Vector:
        return body.omega


class LinkForces(LinkVectors):
    """Accelerations of places on links minus gravity, m/s²: the specific forces that accelerometers measure."""

    orders, placed = 3, AXES

    def _vector(self, body: Body, place: Vector) -> Vector:
        x, y, z = (dot(row, place) for row in acceleration_field(body.omega, body.alpha))
        return add(body.acceleration, (x, y, z))

    def _field(self, body: Body) -> Sequence[Vector]:
        return acceleration_field(body.omega, body.alpha)
