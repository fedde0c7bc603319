"""URDF robots: serial chains read as `Robot`, inertials as reference values, and written back (`urdf_write`).

Frame i is the frame of the link that joint i moves. Links behind fixed joints are merged into the body that carries
them, those before the first moving joint into the base. ``continuous`` is a revolute joint without position limits.

URDF has no gears: ratios come from ``<transmission>`` (``<mechanicalReduction>``, ``<stiffness>``), from elid's own
``<elid …/>`` element in it, or from ``arm.elid.yaml`` beside ``arm.urdf``, which wins::

    gravity: [0, 0, -9.81]
    joints:
      shoulder: {gear_ratio: 100, motor_axis: [0, 0, 1], transmission: elastic, parameters: {K: 2000, Jm: 2e-4}}

Without any of them a joint has gear ratio 1, an elastic transmission, and its motor along the joint's axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError, did_you_mean, nearest
from elid_cli.robot.inertia import about_origin, inertial_parameters, moved, pseudo_inertia
from elid_cli.robot.robot import LINK_PARAMETERS, Joint, Limits, Robot, rotation_rpy, rpy_of, translation
from elid_cli.robot.urdf.gears import Gears, beside_file, default_axis, gears_of, robot_with, written_as_dh
from elid_cli.robot.urdf.write import UNLIMITED, urdf_text, write_urdf
from elid_cli.robot.urdf.xml import Element, parse_xml

__all__ = ["read_urdf", "urdf_text", "write_urdf"]

QUARTER = 1e-5
"""Roll, pitch and yaw this near (rad) to a quarter turn are taken as one: most files say 1.5708 or 3.1416."""

_MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class _Link:
    element: Element
    inertia: Array | None
    """4x4 pseudo-inertia in the link's frame; None where the file has none."""


def read_urdf(text: str, file: str, beside: Path | None = None) -> Robot:
    """Return the robot of a URDF text.

    Parameters
    ----------
    text
        The XML.
    file
        Its name for error messages.
    beside
        The file's path, where there is one: ``<stem>.elid.yaml`` beside it is read too.

    Raises
    ------
    RobotError
        Not a serial chain (the branch, loop, mimic, planar or floating joint is named), or not a URDF.
    """
    root = parse_xml(text, file)
    if root.tag != "robot":
        raise RobotError(f"{file}:{root.line}: <{root.tag}> where a URDF has <robot>")
    for child in root.children:
        if child.tag.startswith("xacro:"):
            raise child.error("xacro is not expanded", hint=f"xacro {file} > arm.urdf")
    links = {name: _Link(element, _inertia(element)) for name, element in _named(root, "link").items()}
    if not links:
        raise RobotError(f"{file}: no links")
    moving, bodies = _chain(file, _named(root, "joint"), links)
    gears = gears_of(root, [name for name, _, _ in moving])
    joints = tuple(
        _joint(name, element, origin, body, gears.get(name, Gears()))
        for (name, element, origin), body in zip(moving, bodies, strict=True)
    )
    own = root.one("elid")
    gravity = (0.0, 0.0, -9.81)
    if own is not None:
        x, y, z = own.numbers("gravity", gravity)
        gravity = (x, y, z)
    name = root.attributes.get("name") or Path(file).stem
    description = own.attributes.get("description", "") if own is not None else ""
    robot = Robot(name=name, joints=joints, gravity=gravity, dh="urdf", description=description)
    robot = written_as_dh(robot, own, gears)
    return robot_with(robot, beside_file(beside)) if beside is not None else robot


def _named(root: Element, tag: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.need("name")
        if name in found:
            raise element.error(f"a second {tag} of this name (the first is in line {found[name].line})")
        found[name] = element
    return found


def _chain(
    file: str, joints: dict[str, Element], links: dict[str, _Link]
) -> tuple[list[tuple[str, Element, Array]], list[Array | None]]:
    """Return the moving joints (name, element, 4x4 origin in the moving frame before) and each one's merged inertia."""
    children: dict[str, list[str]] = {name: [] for name in links}
    parent_of: dict[str, Element] = {}
    for name, element in joints.items():
        parent, child = (_link_name(element, tag, links) for tag in ("parent", "child"))
        if child in parent_of:
            raise element.error(f"moves link {child!r}, which {parent_of[child].attributes['name']!r} moves already")
        parent_of[child] = element
        children[parent].append(name)
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        what = f"links without a parent: {', '.join(roots)}" if roots else "every link has a parent: a loop"
        raise RobotError(f"{file}: not a chain ({what})", hint="exactly one link is the base")
    moving: list[tuple[str, Element, Array]] = []
    bodies: list[Array | None] = []
    link, origin = roots[0], np.eye(4)
    visited = 0
    while True:
        body, exits, seen = _rigid_group(link, origin, joints, links, children)
        visited += seen
        bodies.append(body)
        if not exits:
            break
        if len(exits) > 1:
            names = ", ".join(repr(name) for name, _ in exits)
            raise joints[exits[1][0]].error(f"a branch: joints {names} move off one body", hint="keep one chain")
        name, origin = exits[0]
        moving.append((name, joints[name], origin))
        link, origin = _link_name(joints[name], "child", links), np.eye(4)
    if visited != len(links):
        raise RobotError(f"{file}: not a chain ({len(links) - visited} links form a loop apart from the base)")
    if not moving:
        raise RobotError(f"{file}: no joint moves", hint=f"moving types: {', '.join(_MOVING)}")
    return moving, bodies[1:]


def _rigid_group(
    link: str, origin: Array, joints: dict[str, Element], links: dict[str, _Link], children: dict[str, list[str]]
) -> tuple[Array | None, list[tuple[str, Array]], int]:
    """Return a body's merged inertia, the (joint, 4x4 origin) that move off it, and how many links it has."""
    body: Array | None = None
    exits: list[tuple[str, Array]] = []
    waiting = [(link, origin)]
    seen = 0
    while waiting:
        link, pose = waiting.pop()
        seen += 1
        inertia = links[link].inertia
        if inertia is not None:
            body = moved(inertia, pose) + (0 if body is None else body)
        for name in children[link]:
            at = pose @ _origin(joints[name])
            if _type(joints[name]) == "fixed":
                waiting.append((_link_name(joints[name], "child", links), at))
            else:
                exits.append((name, at))
    return body, exits, seen


def _type(element: Element) -> str:
    kind = element.need("type")
    if element.one("mimic") is not None:
        raise element.error("mimic joints are not modelled", hint="make it fixed, or remove it")
    if kind not in (*_MOVING, "fixed"):
        near = nearest(kind, (*_MOVING, "fixed"))
        known = ("planar", "floating", "spherical")
        hint = f"did you mean {near!r}?" if near and kind not in known else f"types read: {', '.join(_MOVING)}, fixed"
        raise element.error(f"type {kind!r} is not modelled", hint=hint)
    return kind


def _joint(name: str, element: Element, origin: Array, body: Array | None, gears: Gears) -> Joint:
    kind = _type(element)
    axis_element = element.one("axis")
    axis = np.array(axis_element.numbers("xyz", (1.0, 0.0, 0.0)) if axis_element else (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise element.error("axis 0 0 0")
    if abs(length - 1) > 1e-14:
        axis = axis / length
    parameters: dict[str, float] = {}
    if body is not None:
        parameters |= zip(LINK_PARAMETERS, map(float, inertial_parameters(body)), strict=True)
    dynamics = element.one("dynamics")
    if dynamics is not None:
        for key, attribute in (("fs", "friction"), ("fv", "damping")):
            if attribute in dynamics.attributes:
                parameters[key] = dynamics.number(attribute, 0.0)
    raw = _placement(element)
    straight = np.array_equal(origin, translation(*raw[0]) @ rotation_rpy(raw[1]))  # no fixed joint in between
    x, y, z = raw[0] if straight else map(float, origin[:3, 3])
    return Joint(
        name=name,
        type="prismatic" if kind == "prismatic" else "revolute",
        gear_ratio=gears.gear_ratio,
        motor_axis=gears.motor_axis or default_axis(origin, axis),
        transmission=gears.transmission,
        parameters=parameters | gears.parameters,
        limits=_limits(element, kind, gears.acceleration),
        xyz=(x, y, z),
        rpy=raw[1] if straight else rpy_of(origin),
        axis=(float(axis[0]), float(axis[1]), float(axis[2])),
    )


def _limits(element: Element, kind: str, acceleration: float | None) -> Limits:
    limit = element.one("limit")
    found: dict[str, Any] = {"acceleration": acceleration}
    if limit is None:
        return Limits(**found)
    low, high = limit.number("lower", 0.0), limit.number("upper", 0.0)
    if kind != "continuous" and low < high and (low > -UNLIMITED or high < UNLIMITED):
        found["position"] = (low, high)
    for key, attribute in (("velocity", "velocity"), ("torque", "effort")):
        value = limit.number(attribute, 0.0)
        if 0 < value < UNLIMITED:
            found[key] = value
    return Limits(**found)


def _inertia(link: Element) -> Array | None:
    inertial = link.one("inertial")
    if inertial is None:
        return None
    mass, inertia = inertial.one("mass"), inertial.one("inertia")
    value = mass.number("value", 0.0) if mass is not None else 0.0
    tensor = np.zeros((3, 3))
    if inertia is not None:
        xx, yy, zz, xy, xz, yz = (inertia.number(key, 0.0) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pose = _origin(inertial)
    turned = pose[:3, :3] @ tensor @ pose[:3, :3].T
    return pseudo_inertia(about_origin(value, pose[:3, 3], turned))


def _origin(element: Element) -> Array:
    """Return the 4x4 pose of an element's <origin>, identity where it has none."""
    xyz, rpy = _placement(element)
    return translation(*xyz) @ rotation_rpy(rpy)


def _placement(element: Element) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    origin = element.one("origin")
    if origin is None:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    x, y, z = origin.numbers("xyz", (0.0, 0.0, 0.0))
    roll, pitch, yaw = (_quarter(angle) for angle in origin.numbers("rpy", (0.0, 0.0, 0.0)))
    return (x, y, z), (roll, pitch, yaw)


def _quarter(angle: float) -> float:
    turns = round(angle / (math.pi / 2))
    exact = turns * math.pi / 2
    return exact if abs(angle - exact) < QUARTER else angle


def _link_name(element: Element, tag: str, links: dict[str, _Link]) -> str:
    end = element.one(tag)
    if end is None:
        raise element.error(f"no <{tag} link=…/>")
    name = end.need("link")
    if name not in links:
        raise end.error(f"no link {name!r}", hint=did_you_mean(name, links))
    return name
