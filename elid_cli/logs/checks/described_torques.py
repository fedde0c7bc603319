"""Torques that the described bodies need, by their masses, first moments and inertias (Newton and Euler)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot

MASSES = 4
"""Link parameters that weight depends on: mass and first moment."""


def gravity_torques(robot: Robot, q: Array) -> Array:
    """Return the torques, N·m (N), that hold the described bodies at rest at positions (N, n), rad (m); same shape.

    NaN at joints whose load depends on a mass or first moment that is unknown.
    """
    rest = np.zeros_like(q)
    return _known(robot, (q, rest, rest), -np.array(robot.gravity), MASSES)


def inertial_torques(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torques, N·m (N), that move the described bodies without gravity, rotors and friction; (N, n).

    NaN at joints whose load depends on a parameter that is unknown.
    """
    return _known(robot, (q, dq, ddq), np.zeros(3), len(LINK_PARAMETERS))


def _known(robot: Robot, motion: tuple[Array, Array, Array], base: Array, used: int) -> Array:
    """Return the torques where the base accelerates; NaN where they depend on an unknown one of the `used` kinds."""
    kinds = LINK_PARAMETERS[:used]
    known = np.zeros((robot.n, len(LINK_PARAMETERS)))
    known[:, :used] = [[joint.parameters.get(kind, math.nan) for kind in kinds] for joint in robot.joints]
    if np.isnan(known[:, 0]).all():
        return np.full_like(motion[0], math.nan)
    torques = _torques(robot, motion, base, np.nan_to_num(known))
    if np.isnan(known).any():
        other = _torques(robot, motion, base, np.nan_to_num(known, nan=1.0))
        torques[:, (torques != other).any(axis=0)] = math.nan
    return torques


@dataclass
class _Body:
    """Pose and motion of a body's frame in the base's, each (N, 3), rotation (N, 3, 3)."""

    pose: Array
    rate: Array
    change: Array
    """Angular velocity and acceleration; one array of zeros where neither body nor what carries it moves."""
    pull: Array
    """Acceleration of the origin."""


def _torques(robot: Robot, motion: tuple[Array, Array, Array], base: Array, parameters: Array) -> Array:
    """Return the torques of bodies of given parameters, (n, 10), in the order of `LINK_PARAMETERS`."""
    q = motion[0]
    still, shape = np.zeros((len(q), 3)), (len(q), 4, 4)
    bodies = [_Body(np.broadcast_to(np.eye(4), shape), still, still, np.broadcast_to(base, still.shape))]
    axes, places, forces, moments = [], [], [], []
    for k, (joint, (before, after)) in enumerate(zip(robot.joints, robot.placements(), strict=True)):
        parent = bodies[robot.parents[k] + 1]
        frame = parent.pose @ before
        axis, place = frame[:, :3, 2], frame[:, :3, 3]
        body = _moved(parent, frame, after, joint.revolute, tuple(values[:, k] for values in motion))
        force, moment = _load(body, parameters[k])
        bodies.append(body)
        axes.append(axis)
        places.append(place)
        forces.append(force)
        moments.append(moment + _cross(body.pose[:, :3, 3], force))
    torques = np.empty_like(q)
    for k in reversed(range(robot.n)):
        load = moments[k] - _cross(places[k], forces[k]) if robot.joints[k].revolute else forces[k]
        torques[:, k] = np.sum(axes[k] * load, axis=1)
        if (parent_of := robot.parents[k]) >= 0:
            forces[parent_of] = forces[parent_of] + forces[k]
            moments[parent_of] = moments[parent_of] + moments[k]
    return torques


def _moved(parent: _Body, frame: Array, after: Array, revolute: bool, joint: tuple[Array, ...]) -> _Body:
    """Return the body that a joint with position, velocity and acceleration, (N,) each, carries."""
    position, speed, bend = joint
    axis, spin = frame[:, :3, 2], _cross
    shift = np.broadcast_to(np.eye(4), frame.shape).copy()
    rate, change, along = parent.rate, parent.change, np.zeros_like(axis)
    if revolute:
        sin, cos = np.sin(position), np.cos(position)
        shift[:, 0, 0], shift[:, 0, 1], shift[:, 1, 0], shift[:, 1, 1] = cos, -sin, sin, cos
        turn = axis * speed[:, None]
        rate, change = rate + turn, change + axis * bend[:, None] + spin(parent.rate, turn)
    else:
        shift[:, 2, 3] = position
        along = axis * bend[:, None] + 2.0 * spin(rate, axis * speed[:, None])
    pose = frame @ shift @ after
    if parent.rate is parent.change and not np.any(speed) and not np.any(bend):  # at rest, as all before it
        return _Body(pose, parent.rate, parent.change, parent.pull)
    place, origin = frame[:, :3, 3], pose[:, :3, 3]
    lever, arm = place - parent.pose[:, :3, 3], origin - place
    pull = parent.pull + spin(parent.change, lever) + spin(parent.rate, spin(parent.rate, lever)) + along
    return _Body(pose, rate, change, pull + spin(change, arm) + spin(rate, spin(rate, arm)))


def _load(body: _Body, ten: Array) -> tuple[Array, Array]:
    """Return force and moment about its frame's origin, (N, 3) each, that a body's motion needs."""
    turn = body.pose[:, :3, :3]
    if body.rate is body.change:  # at rest
        return ten[0] * body.pull, _cross(turn @ ten[1:4], body.pull)
    xx, yy, zz, xy, xz, yz = ten[4:]
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.transpose(0, 2, 1)
    first, spin = turn @ ten[1:4], _cross
    force = ten[0] * body.pull + spin(body.change, first) + spin(body.rate, spin(body.rate, first))
    turned = np.einsum("nij,nj->ni", inertia, body.rate)
    moment = np.einsum("nij,nj->ni", inertia, body.change) + spin(body.rate, turned) + spin(first, body.pull)
    return force, moment


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of rows, (N, 3): NumPy's own takes three times as long."""
    found = np.empty_like(b)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        found[:, k] = a[:, i] * b[:, j] - a[:, j] * b[:, i]
    return found
