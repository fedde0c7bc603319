"""Angular velocities of links, and their derivatives by the joints' motion: what a gyroscope on a link measures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.model.duals import Dual
from elid_cli.model.kinematics import JointState, chain
from elid_cli.model.program import Program, compile_program
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.robot.robot import Robot
from elid_cli.signals.trigonometry import sine_and_cosine

AXES = 3
_INPUTS = 4
"""Inputs of a joint: sin q, cos q, q, q'."""


class LinkRates:
    """Angular velocities of links by the motion of the joints.

    Parameters
    ----------
    robot
        The joints that move.
    joints
        Whose links are looked at, m.
    """

    def __init__(self, robot: Robot, joints: Sequence[int]) -> None:
        self.robot, self.joints = robot, tuple(joints)

    def rates(self, q: Array, dq: Array) -> Array:
        """Return the links' angular velocities in their own frames, rad/s, (N, m, 3), of positions (N, n) and rates."""
        return self._run(q, dq)[0]

    def slopes(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return them, and their derivatives by q and q' of every joint, (2, N, m, 3, n)."""
        return self._run(q, dq)

    def _run(self, q: Array, dq: Array) -> tuple[Array, Array]:
        program, places = self._traced
        samples, n = q.shape
        rows = np.empty((_INPUTS * n, samples))
        for k in range(n):
            rows[_INPUTS * k + 2], rows[_INPUTS * k + 3] = q[:, k], dq[:, k]
            sine_and_cosine(rows[_INPUTS * k + 2], rows[_INPUTS * k], rows[_INPUTS * k + 1])
        out = np.empty((program.outputs, samples))
        program.run(rows, out)
        turning = out[: AXES * len(self.joints)].T.reshape(samples, len(self.joints), AXES)
        slopes = np.zeros((2, samples, AXES * len(self.joints), n))
        for place, (row, number) in enumerate(places, AXES * len(self.joints)):
            slopes[number % 2, :, row, number // 2] = out[place]
        return turning, slopes.reshape(2, samples, len(self.joints), AXES, n)

    @cached_property
    def _traced(self) -> tuple[Program, list[tuple[int, int]]]:
        """Return the program, and of every output after the velocities its row, and 2 joint + order of derivative."""
        n = self.robot.n
        graph = Graph(_INPUTS * n)
        states: list[Any] = []
        for k in range(n):
            sin, cos, q, dq = (graph.input(_INPUTS * k + d) for d in range(_INPUTS))
            turned = Dual(sin, {2 * k: cos}), Dual(cos, {2 * k: -sin}), Dual(q, {2 * k: 1.0})
            states.append(JointState(*turned, Dual(dq, {2 * k + 1: 1.0}), Dual(0.0)))  # type: ignore[arg-type]
        bodies = chain(self.robot, states)
        rows: list[Any] = [axis for joint in self.joints for axis in bodies[joint + 1].omega]  # the base is the first
        values: list[Scalar] = [row.value if isinstance(row, Dual) else row for row in rows]
        places = []
        for number, row in enumerate(rows):
            for place, slope in row.slopes.items() if isinstance(row, Dual) else ():
                places.append((number, place))
                values.append(slope)
        return compile_program(graph, values), places
