"""Torques of the rigid bodies on arrays of samples, for effects that turn gravity or change a body.

`model.py` sits above the terms, so that this small evaluation uses the base terms directly, untraced.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.scene import EquationRow
from elid_cli.model.kinematics import JointState, chain
from elid_cli.model.terms.base_term import BaseTerm, ChainMotion, MotorState, Side
from elid_cli.model.terms.rigid_body import RigidBody
from elid_cli.model.terms.rotor import Rotor
from elid_cli.model.terms.spring import Spring
from elid_cli.model.terms.viscous import Viscous
from elid_cli.robot.parameter import LINK_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

SMOOTH: tuple[BaseTerm, ...] = (RigidBody(), Rotor(), Viscous(), Spring())
SIDES: tuple[Side, ...] = ("motor", "link")


def gravity_torque(robot: Robot, q: Array, parameters: Array, gravity: Sequence[float]) -> Array:
    """Return the torques (n, N) that hold the robot against a gravity vector (m/s², base frame) at angles q (N, n)."""
    values = dict(zip(robot.parameter_names(), np.nan_to_num(parameters).tolist(), strict=True))
    tilted = with_gravity(robot, gravity)
    torque = np.zeros((robot.n, q.shape[0]))
    for _, joint, name, value in RigidBody().entries(tilted, _resting(tilted, q)):
        if values[name]:
            torque[joint] += np.asarray(value) * values[name]
    return torque


def body_torque(robot: Robot, motion: Motion, parameters: Array) -> Array:
    """Return the torques (n, N) that the bodies need from the link rows, rotors left out."""
    values = dict(zip(robot.parameter_names(), np.nan_to_num(parameters).tolist(), strict=True))
    torque = np.zeros((robot.n, motion.samples))
    for _, joint, name, value in RigidBody().entries(robot, _moving(robot, motion)):
        if values[name]:
            torque[joint] += np.asarray(value) * values[name]
    return torque


def model_torque(robot: Robot, motion: Motion, values: Mapping[StandardParameter, float]) -> dict[EquationRow, Array]:
    """Return the torques (N,) of every motor and link equation: all of the model but Coulomb friction."""
    motors = [
        MotorState(v, a, np.zeros_like(v), d)
        for v, a, d in zip(motion.dtheta.T, motion.ddtheta.T, (motion.q - motion.theta).T, strict=True)
    ]
    whole = ChainMotion(_moving(robot, motion).bodies, motors)
    torque = {EquationRow(side, k): np.zeros(motion.samples) for side in SIDES for k in range(robot.n)}
    for side, joint, name, value in (e for term in SMOOTH for e in term.entries(robot, whole)):
        if values[name]:
            torque[EquationRow(side, joint)] += np.asarray(value) * values[name]
    return torque


def last_body(robot: Robot, motion: Motion) -> Array:
    """Return the columns of the last body's ten parameters in every link row, shape (n, 10, N)."""
    columns = np.zeros((robot.n, len(LINK_PARAMETERS), motion.samples))
    place = {StandardParameter(kind, robot.n - 1): k for k, kind in enumerate(LINK_PARAMETERS)}
    for _, joint, name, value in RigidBody().entries(robot, _moving(robot, motion)):
        if name in place:
            columns[joint, place[name]] = np.asarray(value)
    return columns


def with_gravity(robot: Robot, gravity: Sequence[float]) -> Robot:
    """Return the robot in another field of gravity, m/s² in the base frame."""
    x, y, z = (float(g) for g in gravity)
    return replace(robot, gravity=(x, y, z))


def horizontal_axes(robot: Robot) -> tuple[Array, Array]:
    """Return the two base axes that gravity points along least, in the order x, y, z."""
    vertical = int(np.argmax(np.abs(robot.gravity)))
    first, second = (np.eye(3)[k] for k in range(3) if k != vertical)
    return first, second


def turned(vector: Array, rotation: Array) -> Array:
    """Return a vector turned by a rotation vector, rad (Rodrigues)."""
    angle = float(np.linalg.norm(rotation))
    if angle == 0:
        return vector
    axis = rotation / angle
    along = axis * float(axis @ vector)
    turned: Array = along + math.cos(angle) * (vector - along) + math.sin(angle) * np.cross(axis, vector)
    return turned


def _moving(robot: Robot, motion: Motion) -> ChainMotion:
    rows = (a.T.copy() for a in (motion.q, motion.dq, motion.ddq))
    # arrays stand where traced values usually do: the recursion only adds and multiplies
    states = [JointState(np.sin(q), np.cos(q), q, v, a) for q, v, a in zip(*rows, strict=True)]
    return ChainMotion(chain(robot, states), [])


def _resting(robot: Robot, q: Array) -> ChainMotion:
    states = [JointState(np.sin(a), np.cos(a), a, 0.0, 0.0) for a in q.T]
    return ChainMotion(chain(robot, states), [])
