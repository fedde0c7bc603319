"""Torques of the rigid bodies on arrays of samples, for effects that turn gravity or change a body.

They use the base terms directly: what is asked for often is traced once, with the parameters among its inputs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.memory import Recent
from elid_cli.model.effects.scene import Scene
from elid_cli.model.kinematics import JointState, chain
from elid_cli.model.program import Program, compile_program
from elid_cli.model.regressor import INPUTS, fill_inputs, inputs_of, states_of
from elid_cli.model.terms.base_term import BaseTerm, ChainMotion, Side, entries
from elid_cli.model.terms.rigid_body import RigidBody, wrench_of
from elid_cli.model.terms.rotor import Rotor
from elid_cli.model.terms.spring import Spring
from elid_cli.model.terms.viscous import Viscous
from elid_cli.model.towards_base import JointRows, with_unit_twists
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.robot.parameter import LINK_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

NEW = 1e-8
"""Share of a body's column that has to be new for it to count as independent of those before it."""

SMOOTH: tuple[BaseTerm, ...] = (Rotor(), Viscous(), Spring())
"""Terms beside the bodies that no motion interrupts."""
SIDES: tuple[Side, ...] = ("motor", "link")
TOGETHER = 8192
"""Samples whose kinematics are held at a time."""
POSES, SAME = 8, 1e-6
"""Random poses, and the part by which a torque differs between them at most that is taken for the same."""


def gravity_torque(robot: Robot, q: Array, parameters: Array, gravity: Sequence[float]) -> Array:
    """Return the torques (n, N) that hold the robot against a gravity vector (m/s², base frame) at angles q (N, n)."""
    values = dict(zip(robot.parameter_names(), np.nan_to_num(parameters).tolist(), strict=True))
    tilted = with_gravity(robot, gravity)
    torque = np.zeros((robot.n, q.shape[0]))
    for start in range(0, len(q), TOGETHER):
        part = slice(start, start + TOGETHER)
        for _, joint, name, value in RigidBody().entries(tilted, _resting(tilted, q[part])):
            if values[name]:
                torque[joint, part] += np.asarray(value) * values[name]
    return torque


def tilt_torques(robot: Robot, q: Array, parameters: Array) -> Array:
    """Return by how much holding torques change with roll and pitch of the base at angles q (N, n), (n, 2, N)."""
    gravity = np.array(robot.gravity)
    turns = [np.cross(axis, gravity).tolist() for axis in horizontal_axes(robot)]
    return np.asarray(np.stack([gravity_torque(robot, q, parameters, turn) for turn in turns], axis=1))


def same_everywhere(torques: Array) -> NDArray[np.bool_]:
    """Return which torques (n, 2, N) in some poses are the same in all, those that are 0 among them, (n, 2)."""
    return np.asarray(np.ptp(torques, axis=-1) <= SAME * np.max(np.abs(torques), axis=(0, -1)))


Moved = tuple[int, Motion]
"""A joint, and another motion of it alone, (N, 1)."""


def body_torque(scene: Scene, parameters: Array, moved: Moved | None = None) -> Array:
    """Return the torques (n, N) that the bodies need from the link rows, rotors left out, along a scene's motion.

    Standard parameters (p,), NaN where unknown; where a joint is `moved`, with its other motion.
    """
    return _traced(scene, np.nan_to_num(parameters), (), moved)[scene.robot.n :]


def model_torque(scene: Scene, parameters: Array, moved: Moved | None = None) -> Array:
    """Return the torques of all motor equations, then of all link equations, (2n, N), as `body_torque`.

    All of the model is in them but Coulomb friction.
    """
    return _traced(scene, np.nan_to_num(parameters), SMOOTH, moved)


_PROGRAMS: Recent[Program] = Recent(16)
_INPUTS: Recent[Array] = Recent(1)
"""Inputs along the motion of the scene that was asked about last."""


def _traced(scene: Scene, parameters: Array, terms: tuple[BaseTerm, ...], moved: Moved | None) -> Array:
    """Return the torques of the bodies and of some terms in motor and link equations, (2n, N)."""
    robot = scene.robot
    key = (robot.structure, tuple(term.name for term in terms))
    program = _PROGRAMS.of(key, lambda: _program(robot, terms))
    inputs = _INPUTS.of(scene.of_motion(("inputs",), object), lambda: inputs_of(scene.motion))
    if moved is not None:
        joint, motion = moved
        inputs = inputs.copy()
        fill_inputs(inputs[INPUTS * joint :], motion, 0, range(INPUTS))
    out = np.empty((program.outputs, scene.samples))
    program.run(inputs, out, list(map(np.asarray, parameters)))
    return out


def _program(robot: Robot, terms: Sequence[BaseTerm]) -> Program:
    """Trace bodies and terms; inputs are those of `inputs_of`, then the standard parameters."""
    names = robot.parameter_names()
    graph = Graph(INPUTS * robot.n + len(names))
    values: dict[str, Scalar] = {name: graph.input(INPUTS * robot.n + k) for k, name in enumerate(names)}
    states, motors = states_of([graph.input(k) for k in range(INPUTS * robot.n)], robot)
    # what moves bodies and rotors is carried from body to body: half the operations of a sum over all parameters
    bodies, rows = chain(robot, states, twists=False), JointRows(robot.n)
    for k, body in enumerate(bodies[1:]):
        rows.hold(k + 1, wrench_of(body, [values[StandardParameter(kind, k)] for kind in LINK_PARAMETERS]))
    for entry in entries(terms, robot, ChainMotion(with_unit_twists(bodies), motors)):
        rows.take(entry, values, range(robot.n))
    link, motor = rows.torques(robot, states)
    return compile_program(graph, [*motor, *link])


def end_bodies(robot: Robot) -> list[int]:
    """Return the last body of every branch, by its joint, the robot's last one first."""
    return sorted(set(range(robot.n)) - set(robot.parents), reverse=True)


def body_columns(robot: Robot, number: int, motion: Motion) -> Array:
    """Return the columns of a body's ten parameters in every link row, shape (n, 10, N)."""
    columns = np.zeros((robot.n, len(LINK_PARAMETERS), motion.samples))
    place = {StandardParameter(kind, number): k for k, kind in enumerate(LINK_PARAMETERS)}
    for start in range(0, motion.samples, TOGETHER):
        part = slice(start, start + TOGETHER)
        for _, joint, name, value in RigidBody().entries(robot, _moving(robot, motion[part])):
            if name in place:
                columns[joint, place[name], part] = np.asarray(value)
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
    return np.asarray(along + math.cos(angle) * (vector - along) + math.sin(angle) * np.cross(axis, vector))


def _moving(robot: Robot, motion: Motion) -> ChainMotion:
    rows = (a.T.copy() for a in (motion.q, motion.dq, motion.ddq))
    # arrays stand where traced values usually do: the recursion only adds and multiplies
    states = [JointState(np.sin(q), np.cos(q), q, v, a) for q, v, a in zip(*rows, strict=True)]
    return ChainMotion(chain(robot, states), [])


def _resting(robot: Robot, q: Array) -> ChainMotion:
    states = [JointState(np.sin(a), np.cos(a), a, 0.0, 0.0) for a in q.T]
    return ChainMotion(chain(robot, states), [])
