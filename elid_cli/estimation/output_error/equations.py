"""Equations of motion along a motion, with their slopes: what a simulation that is linear about it needs.

All of base parameters, so that rigid and elastic joints, rotors behind gears and reflected ones are alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.coordinates import coordinates_of
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

SLIGHT = 1e-5
"""Change of positions, rad (m), and velocities, rad/s (m/s), for the slopes of the torques."""


@dataclass(frozen=True)
class Along:
    """Equations about a motion at N instants: ``mass a + damping v + slope x + rest = torque - friction``."""

    mass: Array
    """(N, m, m)."""
    damping: Array
    slope: Array
    rest: Array
    """(N, m)."""
    columns: Array
    """Torque of every base parameter but Coulomb friction, of 1, (N, m, B)."""


class MotionEquations:
    """Torque on the m coordinates of a robot: the links' positions, then the motors' of elastic joints.

    Parameters
    ----------
    robot
        The robot; its declared effects take no part.
    base
        Its base parameters.
    """

    def __init__(self, robot: Robot, base: BaseParameters) -> None:
        self.robot, self.base = robot, base
        self.model = Regressor(replace(robot, effects=()))
        self.coordinates = coordinates_of(robot)
        place = {int(column): k for k, column in enumerate(base.leaders)}
        self._rows: list[tuple[int, slice, NDArray[np.intp], NDArray[np.intp]]] = []
        for item in self.model.equations.rows:
            own = np.array([k for k, c in enumerate(item.columns) if int(c) in place], dtype=np.intp)
            number = np.array([place[int(item.columns[k])] for k in own], dtype=np.intp)
            joint = item.row.joint
            coordinate = int(self.coordinates.motors[joint]) if item.row.kind == "motor" else joint
            self._rows.append((coordinate, item.slots, own, number))

    @cached_property
    def coulomb(self) -> NDArray[np.intp]:
        """Base parameter that the Coulomb friction of each joint is, (n,); -1 where there is none."""
        found = np.full(self.robot.n, -1, dtype=np.intp)
        for k, leader in enumerate(self.base.leaders):
            name = self.base.parameters[leader]
            if name.kind == "fs":
                found[name.joint] = k
        return found

    def columns(self, x: Array, v: Array, a: Array) -> Array:
        """Return the torque of every base parameter of 1, (N, m, B); 0 of Coulomb friction."""
        n, motors = self.robot.n, self.coordinates.motors
        motion = Motion(np.zeros(len(x)), x[:, :n], v[:, :n], a[:, :n], x[:, motors], v[:, motors], a[:, motors])
        rows = self.model.rows(motion, self.model.equations)
        found = np.zeros((len(x), self.coordinates.count, self.base.count))
        for (coordinate, _, own, number), values in zip(self._rows, rows.values(), strict=True):
            found[:, coordinate, number] = values[own].T
        found[:, :, self.coulomb[self.coulomb >= 0]] = 0.0
        return found

    def torque(self, x: Array, v: Array, a: Array, values: Array) -> Array:
        """Return the torque that base parameters (B,) need but Coulomb friction's, (N, m)."""
        return np.asarray(self.columns(x, v, a) @ values)

    def about(self, x: Array, v: Array, a: Array, values: Array) -> Along:
        """Return the equations with base parameters (B,) about positions, velocities, accelerations (N, m)."""
        count = self.coordinates.count
        columns = self.columns(x, v, a)
        torque = columns @ values
        mass, damping, slope = np.empty((3, *x.shape, count))
        for k in range(count):
            unit = np.zeros(count)
            unit[k] = 1.0
            mass[:, :, k] = self.torque(x, v, a + unit, values) - torque
            damping[:, :, k] = (self.torque(x, v + SLIGHT * unit, a, values) - torque) / SLIGHT
            slope[:, :, k] = (self.torque(x + SLIGHT * unit, v, a, values) - torque) / SLIGHT
        rest = torque - sum(
            (matrix @ state[..., None])[..., 0] for matrix, state in ((mass, a), (damping, v), (slope, x))
        )
        return Along(mass, damping, slope, rest, columns)
