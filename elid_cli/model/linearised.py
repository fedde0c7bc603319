"""The equations of motion of a robot, linearised about a motion that is near: all instants of it at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.coordinates import chains_of, coordinates_of, side_by_side
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.regressor import INPUTS, fill_inputs, inputs_of
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

DIRECTION = 7
"""Number of the motor's direction among a joint's inputs."""
RATES = range(3, 7)
"""Numbers of its velocities and accelerations among them."""
SLIGHT = 1e-5
"""Change of position, rad (m), or velocity for the slope of the torques."""


@dataclass(frozen=True)
class Local:
    """Equations of motion about a motion at N instants of S stretches.

    mass·v' + force + slope·(x - place) + swerve·(v - speed) = drive. Those of L chains of s coordinates have two axes,
    L and s, for m.
    """

    mass: Array
    """kg·m² (kg), (N, S, m, m)."""
    force: Array
    """Gravity, centrifugal terms and springs, N·m (N), (N, S, m)."""
    slope: Array
    """Its change with position, and that of the inertial torque, N·m/rad, (N, S, m, m)."""
    swerve: Array
    """Its change with velocity, N·m·s/rad, (N, S, m, m)."""
    place: Array
    """Motion linearised about, rad (m), (N, S, m) …"""
    speed: Array
    """… and its velocity."""
    curved: bool = True
    """Whether `slope` knows how inertias change with position."""
    finer: int = 1
    """Instants per sample of the log, the last sample's one but once."""

    @property
    def at_samples(self) -> Local:
        """The equations at the samples of the log alone."""
        if self.finer == 1:
            return self
        own = slice(None, None, self.finer)
        return replace(
            self, mass=self.mass[own], force=self.force[own], slope=self.slope[own], swerve=self.swerve[own],
            place=self.place[own], speed=self.speed[own], finer=1,
        )  # fmt: skip

    def stretch(self, number: int) -> Local:
        """Return the equations of one stretch."""
        own = slice(number, number + 1)
        return replace(
            self, mass=self.mass[:, own], force=self.force[:, own], slope=self.slope[:, own],
            swerve=self.swerve[:, own], place=self.place[:, own], speed=self.speed[:, own],
        )  # fmt: skip


class Linearised:
    """The equations of motion of a robot without its drives' friction.

    Parameters
    ----------
    robot
        Its parameters must be known, but for drive parameters that `without` takes out.
    without
        Kinds of drive parameters that count as 0: friction always does, `Ja` where it is a variant's.

    Raises
    ------
    RobotError
        Parameters that the motion depends on are unknown.
    """

    def __init__(self, robot: Robot, without: tuple[str, ...] = ("fs", "fv")) -> None:
        values = robot.reference().copy()
        values[[name.kind in without for name in robot.parameter_names()]] = 0.0
        dynamics = Dynamics(robot, values, inert="Ja" not in without)  # which a variant then adds
        self._program = dynamics.inverse_program
        self.robot = robot
        self.coordinates = coordinates_of(robot)
        own = self.coordinates.motors
        # those of rigid joints are the joints' own: a slice is a view, numbers copy
        self._motors = slice(0, robot.n) if np.array_equal(own, np.arange(robot.n)) else own
        self._chain = chains_of(robot)
        self._rates = {INPUTS * joint + slot for joint in range(robot.n) for slot in RATES}

    @cached_property
    def chains(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Coordinates of the chains of joints that couple, (L, s), those of one length together, and their joints.

        The joint is that whose motor drives the coordinate; -1 where none does.
        """
        places, found = self.coordinates.motors, []
        for group in _coupled(self.robot):
            taken = np.array([np.unique(np.concatenate([chain, places[chain]])) for chain in group])
            motors = [[np.flatnonzero(places == c) for c in row] for row in taken]
            found.append((taken, np.array([[int(own[0]) if len(own) else -1 for own in row] for row in motors])))
        return found

    def about(self, x: Array, v: Array, dt: float | None = None, finer: int = 1) -> Local:
        """Return the equations about a motion x (N, S, m) with velocities v, every `dt`, `finer` times per sample.

        Without `dt`, of a motion whose accelerations are mostly noise, the inertias do not change with position.
        """
        count = x.shape[2]
        flat, speed = x.reshape(-1, count), v.reshape(-1, count)
        still, none = np.zeros_like(flat), np.zeros_like(flat)
        gained = none if dt is None else np.gradient(v, dt, axis=0).reshape(-1, count)
        groups = side_by_side(self._chain)
        units = np.zeros((len(groups), *flat.shape))
        for unit, moved in zip(units, groups, strict=True):
            unit[:, moved] = 1.0
        mass, slope, swerve = np.zeros((3, *flat.shape, count))
        # one array of inputs, at rest first, then moving, then accelerated: none is copied
        inputs = self._inputs(flat, still, none)
        rest = self._torques(inputs)
        for unit, moved in zip(units, groups, strict=True):
            self._note(mass, moved, self._beside(inputs, moved, flat, still, unit, RATES) - rest)
        self._again(inputs, flat, speed, none)
        force = self._torques(inputs)
        for unit, moved in zip(units, groups, strict=True):
            swerved = self._beside(inputs, moved, flat, speed + SLIGHT * unit, none, RATES) - force
            self._note(swerve, moved, swerved / SLIGHT)
        self._again(inputs, flat, speed, gained)
        needed = self._torques(inputs)
        for unit, moved in zip(units, groups, strict=True):
            bent = self._beside(inputs, moved, flat + SLIGHT * unit, speed, gained, range(INPUTS)) - needed
            self._note(slope, moved, bent / SLIGHT)
        square = (*x.shape, count)
        mass, slope, swerve = (part.reshape(square) for part in (mass, slope, swerve))
        return Local(mass, force.reshape(x.shape), slope, swerve, x, v, dt is not None, finer)

    def _note(self, found: Array, moved: Sequence[int], columns: Array) -> None:
        """Write what coordinates move in their chains, (N, m), as columns of matrices, (N, m, m)."""
        for k in moved:
            own = np.flatnonzero(self._chain == self._chain[k])
            alike = slice(own[0], own[-1] + 1) if own[-1] + 1 - own[0] == len(own) else own
            found[:, alike, k] = columns[:, alike]

    def _motion(self, x: Array, v: Array, a: Array) -> Motion:
        n, own = self.robot.n, self._motors
        return Motion(np.zeros(len(x)), x[:, :n], v[:, :n], a[:, :n], x[:, own], v[:, own], a[:, own])

    def _inputs(self, x: Array, v: Array, a: Array) -> Array:
        """Return the program's inputs, (9 n, N), of a motion of the coordinates, (N, m) each; without friction."""
        inputs = inputs_of(self._motion(x, v, a))
        inputs[DIRECTION::INPUTS] = 0.0
        return inputs

    def _again(self, inputs: Array, x: Array, v: Array, a: Array) -> None:
        """Make inputs those of a motion at the same positions as the one that they are of."""
        motion = self._motion(x, v, a)
        for joint in range(self.robot.n):
            fill_inputs(inputs, motion, joint, self._rates)

    def _beside(self, inputs: Array, moved: Sequence[int], x: Array, v: Array, a: Array, slots: Sequence[int]) -> Array:
        """Return the torques of a motion that differs at some coordinates from the one that the inputs are of.

        `slots`: numbers of a joint's inputs that may differ.
        """
        motion = self._motion(x, v, a)
        joints = [k for k, own in enumerate(self.coordinates.motors.tolist()) if k in moved or own in moved]
        rows = [INPUTS * joint + slot for joint in joints for slot in slots]
        before = inputs[rows]
        for joint in joints:
            fill_inputs(inputs, motion, joint, rows)
        inputs[DIRECTION::INPUTS] = 0.0
        found = self._torques(inputs)
        inputs[rows] = before
        return found

    def _torques(self, inputs: Array) -> Array:
        """Return the torque on every coordinate, (N, m)."""
        n, own = self.robot.n, self._motors
        out = np.empty((2 * n, inputs.shape[1]))
        self._program.run(inputs, out)
        shape = inputs.shape[1], self.coordinates.count
        if isinstance(own, slice):
            return np.asarray(np.add(out[:n].T, out[n:].T, out=np.empty(shape)))
        found = np.zeros(shape)
        found[:, :n] = out[:n].T
        found[:, own] += out[n:].T
        return found


def _coupled(robot: Robot) -> list[list[NDArray[np.intp]]]:
    """Return the chains of joints that carry each other or a common joint, those of one length together."""
    roots: dict[int, list[int]] = {}
    for k in range(robot.n):
        roots.setdefault(robot.ancestors[k][0], []).append(k)
    lengths: dict[tuple[bool, ...], list[NDArray[np.intp]]] = {}
    for chain in roots.values():
        kinds = tuple(robot.joints[k].elastic for k in chain)
        lengths.setdefault(kinds, []).append(np.array(chain, dtype=np.intp))
    return list(lengths.values())
