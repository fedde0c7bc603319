"""The user's own URDF or MJCF with new parameters: everything else stays as it is.

What changed of a body is added to the link that its joint moves: links behind fixed or locked joints keep their own
inertia, but where that link would be no body then. It has those of the links fixed to it as well in that case, and
they none: one of them may be a tool that the robot does not carry. A body that did not change is not touched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.files import LARGEST, read_text
from elid_cli.robot.files import robot_from_text
from elid_cli.robot.fixed_bodies import fixed_to, joined
from elid_cli.robot.inertia import pseudo_inertia, real_tensor, ten_of
from elid_cli.robot.locking import locked
from elid_cli.robot.mjcf.patch import patch_mjcf
from elid_cli.robot.mjcf.places import name_from
from elid_cli.robot.patch_values import SAME, Change, Changes, named, near, other
from elid_cli.robot.robot import Joint, Robot
from elid_cli.robot.urdf.gears import OWN_PARAMETERS
from elid_cli.robot.urdf.read import link_inertia
from elid_cli.robot.urdf.write import UNLIMITED, in_joint_frames, unreal_bodies
from elid_cli.robot.urdf.xml import Element
from elid_cli.robot.written_bodies import inertial, is_real
from elid_cli.robot.xml_edit import XmlEdit
from elid_cli.robot.xml_text import xml_attributes, xml_number, xml_numbers
from elid_cli.robot.zeros import with_zeros, zero_between


def patched(
    robot: Robot, remarks: Sequence[str] = (), further: Mapping[str, Mapping[str, str]] | None = None,
    folder: Path | None = None,
) -> str:  # fmt: skip
    """Return the text of the file that a robot came from (`Robot.source`) with the robot's parameters in it.

    Parameters
    ----------
    robot
        Read from a URDF or MJCF; its joints may be locked (`Robot.held`) and its parameters identified since.
    remarks
        Sentences for a comment in front.
    further
        Further attributes of joints of an MJCF, by their names.
    folder
        Where the text is written to: what an MJCF includes and shows is named from there. None: where it came from.

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
        changes[name] = Change(joint, _change(was, joint), said, _other_limit(was, joint), zero)
    if edit.root.tag == "mujoco":
        patch_mjcf(edit, text, robot, changes, before, further or {})
        if folder is not None:
            name_from(edit, Path(robot.source).parent, folder)
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
    return pseudo_inertia(ten_of(joint.parameters))


def _other_limit(old: Joint, new: Joint) -> float | None:
    before, after = old.limits.torque, new.limits.torque
    if after is None:
        return None if before is None else math.inf
    return after if before is None or not near(before, after) else None


def _said(joint: Joint) -> dict[str, str]:
    said = named(joint, OWN_PARAMETERS)
    if joint.gear_ratio is not None:
        said |= {"gear_ratio": xml_number(joint.gear_ratio), "motor_axis": xml_numbers(joint.motor_axis)}
    return said


def _patch_urdf(edit: XmlEdit, changes: Changes, locks: bool) -> None:
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
        _set(edit, element, "dynamics", named(joint, (("damping", "fv"), ("friction", "fs"))))
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
    edit.set_attributes(element, other(element, values))


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
