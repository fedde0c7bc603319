"""Standard parameters whose links are real bodies, without moving a torque."""

from __future__ import annotations

import math

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.inertia import in_lengths, pseudo_inertia, ten_of
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot
from elid_cli.robot.urdf.write import in_joint_frames, with_parameters

AIM, ENOUGH = 1e-6, 1e-9
"""Smallest eigenvalue of a link's scaled pseudo-inertia relative to its trace: aimed at, and accepted."""
ROUNDS = 3000
PHYSICAL = "full physical parameters first: elid identify … --physical"


def disc(inertia: float, axis: tuple[float, float, float]) -> Array:
    """Return the 4x4 pseudo-inertia of a thin massless disc with this inertia (kg·m²) about a unit axis."""
    z = np.asarray(axis, dtype=float)
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = inertia / 2 * (np.eye(3) - np.outer(z, z))
    return matrix


def known_parameters(robot: Robot) -> Array:
    """Return standard parameters, shape (p,), all known: those that no motion notices are 0 where not given.

    Raises
    ------
    RobotError
        A parameter that matters is unknown (friction counts as none), or a rotor or spring is not positive.
    """
    values = robot.reference()
    names = robot.parameter_names()
    classes = find_base(Regressor(robot)).classes
    for k, name in enumerate(names):
        if math.isnan(values[k]) and (classes[name] == "unidentifiable" or name.kind in ("fs", "fv")):
            values[k] = 0.0
    unknown = [name for name, value in zip(names, values, strict=True) if math.isnan(value)]
    if unknown:
        listed = " ".join(unknown[:8]) + (" …" if len(unknown) > 8 else "")
        raise RobotError(f"{robot.name}: unknown parameters {listed}", hint=PHYSICAL)
    for name, value in zip(names, values, strict=True):
        if name.kind in ("Jm", "Ja", "K") and value <= 0:
            raise RobotError(f"{robot.name}: {name} is {value:g}; it must be positive to be simulated", hint=PHYSICAL)
    return values


def apart(robot: Robot, parameters: Array) -> tuple[Robot, list[Array]]:
    """Return the robot in joint frames and every link's 4x4 pseudo-inertia there, without the rotor it carries.

    Parameters
    ----------
    robot
        Any convention.
    parameters
        Standard parameters in standard order, shape (p,), none unknown.

    Raises
    ------
    RobotError
        No real body moves like this one.
    """
    full = in_joint_frames(with_parameters(robot, parameters))
    links = _links(full)
    length = _length(robot)
    if not _real(links, length):
        full = in_joint_frames(with_parameters(robot, _real_twin(robot, parameters, length)))
        links = _links(full)
    return full, links


def _links(robot: Robot) -> list[Array]:
    """Return the pseudo-inertias of a robot in joint frames, less the discs of the rotors that ride on them."""
    links = [pseudo_inertia(ten_of(joint.parameters)) for joint in robot.joints]
    for joint, carrier in zip(robot.joints, robot.parents, strict=True):
        if carrier >= 0 and joint.gear_ratio is not None:
            links[carrier] = links[carrier] - disc(joint.parameters["Jm"], joint.motor_axis)
    return links


def _length(robot: Robot) -> float:
    """Return a typical length of the robot, m, that makes masses and inertias comparable."""
    steps = [np.linalg.norm((before @ after)[:3, 3]) for before, after in robot.placements()]
    return float(max(np.mean(steps), 0.05))


def _real(links: list[Array], length: float) -> bool:
    return all(np.linalg.eigvalsh(in_lengths(link, length))[0] > ENOUGH * np.trace(link) > 0 for link in links)


def _real_twin(robot: Robot, parameters: Array, length: float) -> Array:
    """Return parameters with the same base parameters whose links are real bodies, by alternating projections.

    One set is the cone of positive pseudo-inertias, the other the parameters with these base parameters; the
    distance is that of the scaled pseudo-inertias in joint frames.
    """
    names = robot.parameter_names()
    inertial = [k for k, name in enumerate(names) if name.kind in LINK_PARAMETERS]
    transform = find_base(Regressor(robot)).transform[:, inertial]
    _, singular, right = np.linalg.svd(transform)
    free = right[int(np.sum(singular > 1e-9 * singular[0])) :].T

    def links_at(offset: Array) -> Array:
        values = parameters.copy()
        values[inertial] += offset
        links = _links(in_joint_frames(with_parameters(robot, values)))
        return np.array([in_lengths(link, length) for link in links])

    start = links_at(np.zeros(len(inertial)))
    steps = np.stack([(links_at(column) - start).ravel() for column in free.T], axis=1)
    back = np.linalg.pinv(steps, rcond=1e-12)
    least = 1e-3 * float(np.mean(np.trace(start, axis1=1, axis2=2)))
    at, move = start, np.zeros(free.shape[1])
    for _ in range(ROUNDS):
        values, vectors = np.linalg.eigh(at)
        traces = np.maximum(np.trace(at, axis1=1, axis2=2), least)[:, None]
        if np.all(values > AIM / 2 * traces):
            break
        inside = (vectors * np.maximum(values, AIM * traces)[:, None, :]) @ vectors.transpose(0, 2, 1)
        move = back @ (inside - start).ravel()
        at = start + (steps @ move).reshape(start.shape)
    else:
        worst = robot.joint_names[int(np.argmin(np.linalg.eigvalsh(at)[:, 0]))]
        raise RobotError(
            f"{robot.name}: no real bodies have these parameters (the worst is that of {worst})", hint=PHYSICAL
        )
    found = parameters.copy()
    found[inertial] += free @ move
    return found


def split_mass(link: Array, share: float) -> tuple[Array, float, Array]:
    """Return (link without a share of its mass at its centre, that mass, the centre (3,)): the rotor's to carry."""
    mass = link[3, 3] * share
    centre = link[:3, 3] / link[3, 3]
    point = np.array([*centre, 1.0])
    return link - mass * np.outer(point, point), float(mass), centre
