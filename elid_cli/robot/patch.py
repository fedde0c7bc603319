"""The user's own URDF or MJCF with new parameters: everything else stays as it is.

What changed of a body is added to the link that its joint moves: links behind fixed or locked joints keep their own
inertia, but where that link would be no body then. It has those of the links fixed to it as well in that case, and
they none: one of them may be a tool that the robot does not carry. A body that did not change is not touched.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.files import LARGEST, read_text
from elid_cli.robot.files import robot_from_text
from elid_cli.robot.fixed_bodies import fixed_to, joined
from elid_cli.robot.frames import translation
from elid_cli.robot.inertia import moved, pseudo_inertia, real_tensor
from elid_cli.robot.locking import locked
from elid_cli.robot.mjcf.elements import stiffness_and_rest
from elid_cli.robot.mjcf.read import SPRING, MjcfTree, MovingJoint
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Joint, Robot
from elid_cli.robot.urdf.gears import OWN_PARAMETERS
from elid_cli.robot.urdf.read import link_inertia
from elid_cli.robot.urdf.write import UNLIMITED, in_joint_frames, unreal_bodies
from elid_cli.robot.urdf.xml import Element
from elid_cli.robot.written_bodies import inertial, is_real, loaded
from elid_cli.robot.xml_edit import XmlEdit
from elid_cli.robot.xml_text import xml_attributes, xml_number, xml_numbers
from elid_cli.robot.zeros import with_zeros, zero_between

SAME = 1e-12
"""Relative change below which a number is left as the file has it."""
_MASSLESS = '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>'


def patched(robot: Robot, remarks: Sequence[str] = (), further: Mapping[str, Mapping[str, str]] | None = None) -> str:
    """Return the text of the file that a robot came from (`Robot.source`) with the robot's parameters in it.

    Parameters
    ----------
    robot
        Read from a URDF or MJCF; its joints may be locked (`Robot.held`) and its parameters identified since.
    remarks
        Sentences for a comment in front.
    further
        Further attributes of joints of an MJCF, by their names.

    Raises
    ------
    RobotError
        The file is no longer there or has changed its joints, or a body cannot be written as one of its links.
    """
    text = read_text(Path(robot.source), RobotError, most=LARGEST * 20)
    before = robot_from_text(text, robot.source)
    missing = [name for name in (*robot.joint_names, *robot.held) if name not in before.joint_names]
    if missing:
        raise RobotError(f"{robot.source}: no joint {missing[0]!r} any more", hint="read the robot again")
    old, new = (in_joint_frames(r) for r in (locked(before, robot.held), robot))
    edit = XmlEdit(text, robot.source)
    if remarks:
        edit.comment("; ".join(remarks).replace(".; ", ". "))
    changes = {}
    for name in robot.joint_names:
        joint, was = new.joint(name), old.joint(name)
        said = _said(joint) if _said(joint) != _said(was) else {}
        place = robot.joint_names.index(name)
        zero = zero_between(old, new, place) if joint.rpy != was.rpy or joint.xyz != was.xyz else 0.0
        changes[name] = _Change(joint, _change(was, joint), said, _other_limit(was, joint), zero)
    if edit.root.tag == "mujoco":
        _patch_mjcf(edit, text, robot, changes, further or {})
    else:
        _patch_urdf(edit, changes, bool(robot.held))
    return edit.text()


def _change(old: Joint, new: Joint) -> Array | None:
    """Return what a body's 4x4 pseudo-inertia changed by, in its joint's frame; None where it did not."""
    if "m" not in new.parameters:
        return None
    before, after = _whole(old), _whole(new)
    return after - before if np.abs(after - before).max() > SAME * np.abs(after).max() else None


def _whole(joint: Joint) -> Array:
    """Return the 4x4 pseudo-inertia of all that a joint carries up to the next, in its frame."""
    return pseudo_inertia(np.array([joint.parameters.get(name, 0.0) for name in LINK_PARAMETERS]))


class _Change(NamedTuple):
    """What changed of a joint."""

    joint: Joint
    """Itself, as it is to be."""
    body: Array | None
    """What its body's inertia changed by."""
    said: dict[str, str]
    """What of its motor only elid's own element can say."""
    limit: float | None
    """A torque limit other than the file's, N·m (N); infinite where there is none any more."""
    zero: float
    """By how much its positions are read larger than by the file, rad (m)."""


_Changes = dict[str, _Change]


def _other_limit(old: Joint, new: Joint) -> float | None:
    before, after = old.limits.torque, new.limits.torque
    if after is None:
        return None if before is None else math.inf
    return after if before is None or not _near(before, after) else None


def _said(joint: Joint) -> dict[str, str]:
    said = _named(joint, OWN_PARAMETERS)
    if joint.gear_ratio is not None:
        said |= {"gear_ratio": xml_number(joint.gear_ratio), "motor_axis": xml_numbers(joint.motor_axis)}
    return said


def _patch_urdf(edit: XmlEdit, changes: _Changes, locks: bool) -> None:
    links = {link.attributes.get("name"): link for link in edit.root.all("link")}
    own = {e.attributes["joint"]: e for e in edit.root.all("elid") if "joint" in e.attributes}
    unreal = []
    for element in edit.root.all("joint"):
        name = element.attributes.get("name", "")
        if name not in changes:
            continue
        joint, change, said, limit, zero = changes[name]
        child = element.one("child")
        if change is not None and child is not None:
            link = links[child.attributes["link"]]
            if not _add_to_link(edit, link, change, None if locks else _whole(joint)):
                unreal.append(link.attributes["name"])
        _set(edit, element, "dynamics", _named(joint, (("damping", "fv"), ("friction", "fs"))))
        if limit is not None:
            _set(edit, element, "limit", {"effort": xml_number(min(limit, UNLIMITED))})
        if abs(zero) > SAME:
            _set(edit, element, "origin", _origin_at(element, joint, zero))
        if said:
            said = {"joint": name, "transmission": joint.transmission, **said}
            if name in own:
                edit.set_attributes(own[name], said)
            else:
                edit.add_first(edit.root, f"<elid {xml_attributes(said)}/>")
    if unreal:  # kinematics libraries load them, MuJoCo and others refuse
        edit.comment(unreal_bodies(unreal))


def _add_to_link(edit: XmlEdit, link: Element, change: Array, whole: Array | None) -> bool:
    """Add to a link's inertia; return whether the link is a real body then, or was none before.

    Where it would be none, it gets `whole`, what it and those fixed to it are together, if that is a body.
    """
    known, carried = link_inertia(link), fixed_to(edit.root, link)
    body = change + (0 if known is None else known)
    if carried and whole is not None and not is_real(body) and is_real(whole):
        body = whole
        for other in carried:
            edit.replace(next(other.all("inertial")), "")
        edit.comment(joined(link, carried))
    ten = inertial(body, f"link {link.attributes['name']!r}")
    _put(edit, link, ten)
    return real_tensor(ten[2]) or not (known is None or is_real(known))


def _origin_at(element: Element, joint: Joint, zero: float) -> dict[str, str]:
    """Return the origin of a joint whose positions are read larger by `zero`; fixed joints before it stay."""
    origin = element.one("origin")
    (x, y, z), (roll, pitch, yaw) = (
        (0.0, 0.0, 0.0) if origin is None else origin.numbers(key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy")
    )
    own = Joint("own", joint.type, xyz=(x, y, z), rpy=(roll, pitch, yaw), axis=joint.axis)
    at = Robot("", (own,), dh="urdf")
    (moved_one,) = with_zeros(at, np.array([zero])).joints
    return {"xyz": xml_numbers(moved_one.xyz), "rpy": xml_numbers(moved_one.rpy)}


def _set(edit: XmlEdit, holder: Element, tag: str, values: dict[str, str]) -> None:
    """Set attributes of a child, which is made where it is missing; equal numbers stay as they are written."""
    element = holder.one(tag)
    if element is None:
        if values:
            edit.add_first(holder, f"<{tag} {xml_attributes(values)}/>")
        return
    edit.set_attributes(element, _other(element, values))


def _other(element: Element, values: dict[str, str]) -> dict[str, str]:
    """Return the attributes that have another value."""
    return {
        key: value
        for key, value in values.items()
        if key not in element.attributes or not _alike(element.attributes[key], value)
    }


def _alike(before: str, after: str) -> bool:
    """Whether two attributes hold the same words, or numbers that are nearly equal."""
    if before.split() == after.split():
        return True
    try:
        numbers = [[float(word) for word in text.split()] for text in (before, after)]
    except ValueError:
        return False
    return len(numbers[0]) == len(numbers[1]) and all(map(_near, *numbers))


def _near(a: float, b: float) -> bool:
    return abs(a - b) <= SAME * max(abs(a), abs(b))


def _put(edit: XmlEdit, link: Element, ten: tuple[float, Array, Array]) -> None:
    """Write a link's inertial: mass, centre (3,), tensor about it (3, 3); comments inside stay."""
    mass, centre, tensor = ten
    keys = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
    said = {
        "origin": {"xyz": xml_numbers(centre), "rpy": "0 0 0"},
        "mass": {"value": xml_number(mass)},
        "inertia": {key: xml_number(tensor[r, c]) for key, r, c in keys},
    }
    old = link.one("inertial")
    if old is None:
        parts = (f"<{tag} {xml_attributes(values)}/>" for tag, values in said.items())
        edit.add_first(link, f"<inertial>{''.join(parts)}</inertial>")
        return
    if (origin := old.one("origin")) is not None:
        edit.set_attributes(origin, said.pop("origin"))
    for tag, values in said.items():
        _set(edit, old, tag, values)


def _patch_mjcf(
    edit: XmlEdit, text: str, robot: Robot, changes: _Changes, further: Mapping[str, Mapping[str, str]]
) -> None:
    tree = MjcfTree(text, robot.source)
    springs = {spec.joint or robot.joint_names[0]: spec.parameters for spec in robot.effects if spec.effect == SPRING}
    meshes = [carrier for carrier, _ in tree.meshes]
    places = {(e.tag, e.start): e for e in _all(edit.root)}
    for number, item in enumerate(tree.moving):
        if item.name not in changes:
            continue
        joint, change, _, limit, zero = changes[item.name]
        if item.element.file != robot.source:
            raise RobotError(
                f"{item.name} is described in {item.element.file}", hint="give that file, or write a .yaml"
            )
        values = _dynamics(joint) | _spring(item, springs.get(item.name), tree.conventions.degrees)
        if limit is not None:  # of what all actuators of the joint deliver: a higher one may be theirs as well
            values["actuatorfrclimited"] = "true" if math.isfinite(limit) else "false"
            if math.isfinite(limit):
                values["actuatorfrcrange"] = f"{xml_number(-limit)} {xml_number(limit)}"
        if abs(zero) > SAME:
            turning = tree.conventions.degrees and joint.revolute
            more = math.degrees(zero) if turning else zero
            values["ref"] = xml_number(item.element.number("ref", 0.0) + more)
        edit.set_attributes(
            places[item.element.tag, item.element.start],
            _other(item.element, values) | dict(further.get(item.name, {})),
        )
        if change is None:
            continue
        if item.owner is None or number in meshes:
            why = "its body has nothing but meshes" if number in meshes else "its body has another joint behind it"
            raise RobotError(f"{robot.source}: {item.name}: no <inertial> to write to: {why}", hint="write a .yaml")
        _add_to_body(edit, places, item, item.owner, change)


def _add_to_body(
    edit: XmlEdit, places: Mapping[tuple[str, int], Element], item: MovingJoint, owner: Element, change: Array
) -> None:
    """Add to the inertia of the body that a joint moves; where that is none then, it gets that of those fixed to it."""
    anchor = translation(*item.element.numbers("pos", (0.0, 0.0, 0.0)))
    own = item.own + moved(change, anchor)
    if item.fixed and item.body is not None and not is_real(own):
        whole = moved(item.body + change, anchor)
        if is_real(whole):
            own = whole
            for other in item.fixed:
                _set_inertial(edit, places["body", other.start], _MASSLESS)
            edit.comment(joined(owner, item.fixed))
    mass, centre, tensor = loaded(own, item.own, f"the body of {item.name}")
    order = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
    full = f'mass="{xml_number(mass)}" fullinertia="{xml_numbers(order)}"'
    _set_inertial(edit, places["body", owner.start], f'<inertial pos="{xml_numbers(centre)}" {full}/>')


def _set_inertial(edit: XmlEdit, body: Element, inertial: str) -> None:
    old = body.one("inertial")
    if old is None:
        edit.add_first(body, inertial)
    else:
        edit.replace(old, inertial)


def _spring(item: MovingJoint, spring: Mapping[str, float] | None, degrees: bool) -> dict[str, str]:
    """Return the attributes of the spring between a joint's body and the one that carries it."""
    if spring is None:
        return {"stiffness": "0"} if "stiffness" in item.element.attributes else {}
    stiffness, rest = stiffness_and_rest(spring)
    turning = degrees and item.element.attributes.get("type", "hinge") == "hinge"
    return {"stiffness": xml_number(stiffness), "springref": xml_number(math.degrees(rest) if turning else rest)}


def _dynamics(joint: Joint) -> dict[str, str]:
    values = dict(joint.parameters)
    if joint.gear_ratio is not None and "Jm" in values:
        values["Ja"] = values["Jm"] * joint.gear_ratio**2
    return _named(replace(joint, parameters=values), (("armature", "Ja"), ("damping", "fv"), ("frictionloss", "fs")))


def _named(joint: Joint, keys: Sequence[tuple[str, str]]) -> dict[str, str]:
    return {attribute: xml_number(joint.parameters[key]) for attribute, key in keys if key in joint.parameters}


def _all(element: Element) -> Iterator[Element]:
    yield element
    for child in element.children:
        yield from _all(child)
