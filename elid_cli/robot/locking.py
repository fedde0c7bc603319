"""Joints that do not move: their bodies become part of the bodies that carry them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError, UsageError, did_you_mean
from elid_cli.robot.frames import rotation_z, rpy_of, translation, z_to
from elid_cli.robot.inertia import inertial_parameters, moved, pseudo_inertia, ten_of
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import BASE, Joint, Robot


def locked(robot: Robot, values: Mapping[str, float]) -> Robot:
    """Return the robot with some joints held at values, rad or m; its frames are then those of its joints.

    Effects and log mappings of held joints go with them.

    Raises
    ------
    UsageError
        No such joint.
    RobotError
        No joint is left to move.
    """
    for name in values:
        if name in robot.held:
            raise UsageError(f"--lock {name}: already locked at {robot.held[name]:g} by the robot's own file")
        if name not in robot.joint_names:
            raise UsageError(f"--lock {name}: no such joint", hint=did_you_mean(name, robot.joint_names))
    if not values:
        return robot
    if len(values) == robot.n:
        raise RobotError(f"{robot.name}: no joint is left to move", detail=f"locked: {' '.join(values)}")
    from elid_cli.robot.urdf.write import in_joint_frames, origins

    full = in_joint_frames(robot)
    places, kept = origins(full), []
    # of every joint frame: the kept joint that carries it, and its pose in that one's frame
    carriers: list[tuple[int, Array]] = [(-1, np.eye(4))]
    bodies: list[Array | None] = [None] * (robot.n + 1)
    for k, (joint, parent) in enumerate(zip(full.joints, full.parents, strict=True)):
        carrier, pose = carriers[parent + 1]
        origin = pose @ places[k]
        body = _body(joint)
        if joint.name not in values:
            carriers.append((k, np.eye(4)))
            bodies[k + 1] = body
            x, y, z = (pose[:3, :3] @ joint.motor_axis + 0.0).tolist()
            kept.append((replace(joint, motor_axis=(x, y, z)), carrier, origin))
            continue
        at = origin @ motion(joint, values[joint.name])
        carriers.append((carrier, at))
        held = bodies[carrier + 1]
        if body is not None and (held is not None or carrier < 0):
            bodies[carrier + 1] = moved(body, at) + (0 if held is None else held)
    joints: list[Joint] = []
    for joint, carrier, origin in kept:
        body = bodies[full.joint_names.index(joint.name) + 1]
        inertial = {} if body is None else dict(zip(LINK_PARAMETERS, inertial_parameters(body).tolist(), strict=True))
        before = joints[-1].name if joints else BASE
        name = BASE if carrier < 0 else full.joint_names[carrier]
        x, y, z = origin[:3, 3].tolist()
        joints.append(
            replace(
                joint, xyz=(x, y, z), rpy=rpy_of(origin), a=0.0, alpha=0.0, d=0.0, theta=0.0,
                parent="" if name == before else name, parameters=dict(joint.parameters) | inertial,
            )
        )  # fmt: skip
    effects = tuple(spec for spec in robot.effects if spec.joint is None or spec.joint not in values)
    control = {gain: {j: v for j, v in given.items() if j not in values} for gain, given in robot.control.items()}
    payload = robot.payload if robot.payload is not None and robot.payload.joint not in values else None
    return replace(
        robot, joints=tuple(joints), dh="urdf", effects=effects, control=control, payload=payload,
        held=dict(robot.held) | dict(values), order=robot.order or robot.joint_names,
    )  # fmt: skip


def beside_chain(robot: Robot, tip: str) -> tuple[str, ...]:
    """Return the joints that do not move a link (or the body of a joint) `tip`: all but those of its chain.

    Raises
    ------
    UsageError
        No such link, or one that no joint moves.
    """
    names = dict(robot.links) | {name: name for name in robot.joint_names}
    if tip not in names:
        raise UsageError(f"--tip {tip}: no such link", hint=did_you_mean(tip, robot.links or robot.joint_names))
    if names[tip] == BASE:
        raise UsageError(f"--tip {tip}: no joint moves it")
    if names[tip] in robot.held:
        raise UsageError(f"--tip {tip}: {names[tip]}, which moves it, is locked by the robot's own file")
    chain = robot.ancestors[robot.joint_names.index(names[tip])]
    return tuple(name for k, name in enumerate(robot.joint_names) if k not in chain)


def beyond_limits(robot: Robot, values: Mapping[str, float]) -> list[str]:
    """Return a sentence per joint that is locked where it cannot be."""
    ranges = {joint.name: joint.limits.position for joint in robot.joints if joint.limits.position is not None}
    return [
        f"{name} is locked at {values[name]:g}, outside its limits, {low:g} to {high:g}"
        for name, (low, high) in ranges.items()
        if name in values and values[name] != 0 and not low <= values[name] <= high
    ]


def _body(joint: Joint) -> Array | None:
    if "m" not in joint.parameters:
        return None
    return pseudo_inertia(ten_of(joint.parameters))


def motion(joint: Joint, value: float) -> Array:
    """Return the 4x4 motion of a joint at a value about or along its own axis, in its own frame."""
    turn = z_to(joint.axis)
    move = rotation_z(value) if joint.revolute else translation(0.0, 0.0, value)
    return np.asarray(turn @ move @ turn.T)
