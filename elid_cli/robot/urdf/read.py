"""URDF robots read as `Robot`, inertials as reference values.

Frame i is the frame of the link that joint i moves. Links behind fixed joints are merged into the body that carries
them, those before the first moving joint into the base; floating and planar joints are held fixed. ``continuous`` is a
revolute joint without position limits. Joints stand in the order of the file's tree, each chain in one piece.

URDF has no gears: ratios come from ``<transmission>`` (``<mechanicalReduction>``, ``<stiffness>``), from elid's own
``<elid …/>`` element in it, or from the YAML beside the file (`robot/beside.py`), which wins. Without any of them the
gear ratio is unknown and the transmission is what the log shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError, did_you_mean, nearest
from elid_cli.robot.frames import rotation_rpy, rpy_of, translation
from elid_cli.robot.inertia import about_origin, inertial_parameters, moved, pseudo_inertia, symmetric
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import BASE, MOST_READ, Joint, Limits, Robot
from elid_cli.robot.urdf.gears import Gears, default_axis, gears_of, written_as_dh
from elid_cli.robot.urdf.write import UNLIMITED
from elid_cli.robot.urdf.xml import Element, parse_xml, unit_axis

_MOVING = ("revolute", "continuous", "prismatic")
_HELD = ("floating", "planar")


@dataclass(frozen=True)
class _Link:
    element: Element
    inertia: Array | None
    """4x4 pseudo-inertia in the link's frame; None where the file has none."""


def read_urdf(text: str, file: str) -> Robot:
    """Return the robot of a URDF text.

    Parameters
    ----------
    text
        The XML.
    file
        Its name for error messages.

    Raises
    ------
    RobotError
        Not a tree (the loop is named), a type of joint that is not modelled, or not a URDF.
    """
    root = parse_xml(text, file)
    if root.tag != "robot":
        raise RobotError(f"{file}:{root.line}: <{root.tag}> where a URDF has <robot>")
    for child in root.children:
        if child.tag.startswith("xacro:"):
            raise child.error("xacro is not expanded", hint=f"xacro {file} > arm.urdf")
    links = {name: _Link(element, link_inertia(element)) for name, element in _named(root, "link").items()}
    if not links:
        raise RobotError(f"{file}: no links")
    moving, held = _tree(file, _named(root, "joint"), links)
    if len(moving) > MOST_READ:
        raise RobotError(f"{file}: {len(moving)} joints that move; at most {MOST_READ} are read")
    gears = gears_of(root, [item.name for item in moving])
    joints = tuple(_joint(item, gears.get(item.name, Gears())) for item in moving)
    own = next((element for element in root.all("elid") if "joint" not in element.attributes), None)
    gravity = (0.0, 0.0, -9.81)
    if own is not None:
        x, y, z = own.numbers("gravity", gravity)
        gravity = (x, y, z)
    name = root.attributes.get("name") or Path(file).stem
    description = own.attributes.get("description", "") if own is not None else ""
    robot = Robot(name=name, joints=joints, gravity=gravity, dh="urdf", description=description)
    robot = written_as_dh(robot, own, gears)
    notes = [f"{joint} is held fixed: {kind} joints are not modelled" for joint, kind in held]
    notes += [
        f"{item.name} mimics another joint in the file; here it is one of its own" for item in moving if item.mimic
    ]
    moved_by = dict.fromkeys(links, BASE) | {link: item.name for item in moving for link in item.links}
    return replace(robot, links=moved_by, notes=(*notes, *root.faults))


def _named(root: Element, tag: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.need("name")
        if name in found:
            raise element.error(f"a second {tag} of this name (the first is in line {found[name].line})")
        found[name] = element
    return found


@dataclass(frozen=True)
class _Moving:
    """A joint that moves: its 4x4 origin in the moving frame before, that frame's joint, the inertia it moves."""

    name: str
    element: Element
    origin: Array
    parent: str
    body: Array | None
    links: tuple[str, ...]

    @property
    def mimic(self) -> bool:
        """Whether the file has it follow another joint."""
        return self.element.one("mimic") is not None


def _tree(
    file: str, joints: dict[str, Element], links: dict[str, _Link]
) -> tuple[list[_Moving], list[tuple[str, str]]]:
    """Return the moving joints, parents first, and the (name, type) of joints that are held fixed."""
    children: dict[str, list[str]] = {name: [] for name in links}
    parent_of: dict[str, Element] = {}
    for name, element in joints.items():
        parent, child = (_link_name(element, tag, links) for tag in ("parent", "child"))
        if child in parent_of:
            other = parent_of[child].attributes["name"]
            what = f"moves link {child!r}, which {other!r} moves already: closed loops are not modelled"
            raise element.error(what, hint=f"remove one of the joints {other!r} and {name!r}")
        parent_of[child] = element
        children[parent].append(name)
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        what = f"links without a parent: {', '.join(roots)}" if roots else "every link has a parent: a loop"
        raise RobotError(f"{file}: not a tree ({what})", hint="exactly one link is the base")
    moving: list[_Moving] = []
    held: list[tuple[str, str]] = []
    visited = 0
    following: list[tuple[str, Element | None, Array, str]] = [("", None, np.eye(4), "")]
    while following:
        name, joint, origin, parent = following.pop()
        link = roots[0] if joint is None else _link_name(joint, "child", links)
        body, exits, seen = _rigid_group(link, joints, links, children, held)
        visited += len(seen)
        if joint is not None:
            before = moving[-1].name if moving else BASE
            moving.append(_Moving(name, joint, origin, "" if parent == before else parent, body, seen))
        following += [(exit, joints[exit], at, name or BASE) for exit, at in reversed(exits)]
    if visited != len(links):
        raise RobotError(f"{file}: not a tree ({len(links) - visited} links form a loop apart from the base)")
    if not moving:
        raise RobotError(f"{file}: no joint moves", hint=f"moving types: {', '.join(_MOVING)}")
    return moving, held


def _rigid_group(
    link: str,
    joints: dict[str, Element],
    links: dict[str, _Link],
    children: dict[str, list[str]],
    held: list[tuple[str, str]],
) -> tuple[Array | None, list[tuple[str, Array]], tuple[str, ...]]:
    """Return a body's merged inertia, the (joint, 4x4 origin) that move off it, and its links."""
    body: Array | None = None
    exits: list[tuple[str, Array]] = []
    waiting = [(link, np.eye(4))]
    seen: list[str] = []
    while waiting:
        link, pose = waiting.pop()
        seen.append(link)
        inertia = links[link].inertia
        if inertia is not None:
            body = moved(inertia, pose) + (0 if body is None else body)
        for name in children[link]:
            at = pose @ _origin(joints[name])
            kind = _type(joints[name])
            if kind in _HELD:
                held.append((name, kind))
            if kind in _MOVING:
                exits.append((name, at))
            else:
                waiting.append((_link_name(joints[name], "child", links), at))
    return body, exits, tuple(seen)


def _type(element: Element) -> str:
    kind = element.need("type")
    if kind not in (*_MOVING, *_HELD, "fixed"):
        near = nearest(kind, (*_MOVING, "fixed"))
        hint = f"did you mean {near!r}?" if near and kind != "spherical" else f"types read: {', '.join(_MOVING)}, fixed"
        raise element.error(f"type {kind!r} is not modelled", hint=hint)
    return kind


def _joint(item: _Moving, gears: Gears) -> Joint:
    element, origin, body = item.element, item.origin, item.body
    kind = _type(element)
    axis_element = element.one("axis")
    axis = unit_axis(element, axis_element.numbers("xyz", (1.0, 0.0, 0.0)) if axis_element else (1.0, 0.0, 0.0))
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
        name=item.name,
        parent=item.parent,
        type="prismatic" if kind == "prismatic" else "revolute",
        gear_ratio=gears.gear_ratio,
        motor_axis=gears.motor_axis or default_axis(origin, np.array(axis)),
        transmission=gears.transmission,
        parameters=parameters | gears.parameters,
        limits=_limits(element, kind, gears.acceleration),
        xyz=(x, y, z),
        rpy=raw[1] if straight else rpy_of(origin),
        axis=axis,
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


def link_inertia(link: Element) -> Array | None:
    """Return a link's 4x4 pseudo-inertia in its own frame; None where the file has none."""
    inertial = link.one("inertial")
    if inertial is None:
        return None
    mass, inertia = inertial.one("mass"), inertial.one("inertia")
    value = mass.number("value", 0.0) if mass is not None else 0.0
    tensor = np.zeros((3, 3))
    if inertia is not None:
        tensor = symmetric(inertia.number(key, 0.0) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
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
    roll, pitch, yaw = origin.numbers("rpy", (0.0, 0.0, 0.0))
    return (x, y, z), (roll, pitch, yaw)


def _link_name(element: Element, tag: str, links: dict[str, _Link]) -> str:
    end = element.one(tag)
    if end is None:
        raise element.error(f"no <{tag} link=…/>")
    name = end.need("link")
    if name not in links:
        raise end.error(f"no link {name!r}", hint=did_you_mean(name, links))
    return name
