"""The user's own MJCF with new parameters: joints, rotors of their own, tendons, bodies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.robot.fixed_bodies import joined
from elid_cli.robot.frames import translation
from elid_cli.robot.inertia import about_centre, about_origin, inertial_parameters, moved, pseudo_inertia, six_of
from elid_cli.robot.locking import motion
from elid_cli.robot.mjcf.drives import without_limits_below
from elid_cli.robot.mjcf.elements import axis_of, stiffness_and_rest
from elid_cli.robot.mjcf.held import DAMPING, LINK_EFFECTS, SPRING, declared
from elid_cli.robot.mjcf.moving import MovingJoint
from elid_cli.robot.mjcf.places import elements
from elid_cli.robot.mjcf.read import MjcfTree
from elid_cli.robot.mjcf.rotors import Rotor
from elid_cli.robot.patch_values import SAME, Change, Changes, named, near, other
from elid_cli.robot.robot import Joint, Robot
from elid_cli.robot.urdf.xml import Element
from elid_cli.robot.written_bodies import PHYSICAL, is_real, loaded
from elid_cli.robot.xml_edit import XmlEdit
from elid_cli.robot.xml_text import xml_number, xml_numbers

FIRM = {"solreffriction": "0.001 1"}
"""What makes dry friction hold a joint: MuJoCo takes no less than two of its steps."""
_MASSLESS = '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>'


def patch_mjcf(
    edit: XmlEdit, text: str, robot: Robot, changes: Changes, before: Robot, further: Mapping[str, Mapping[str, str]]
) -> None:
    """Make the changes of a robot that came from an MJCF.

    Parameters
    ----------
    edit, text
        The document, and its text as it stands.
    robot, changes
        The robot, and what changed of its joints, by their names.
    before
        The robot as the text describes it.
    further
        Further attributes of joints, by their names.
    """
    _Patch(edit, MjcfTree(text, robot.source), robot, {(e.tag, e.start): e for e in elements(edit.root)}).make(
        changes, before, further
    )


@dataclass(frozen=True)
class _Patch:
    edit: XmlEdit
    tree: MjcfTree
    robot: Robot
    places: Mapping[tuple[str, int], Element]
    """The elements of the document by tag and first byte."""

    def make(self, changes: Changes, before: Robot, further: Mapping[str, Mapping[str, str]]) -> None:
        """Make the changes."""
        tree = self.tree
        others: dict[int, Array] = {}  # what rotors of their own change by, on what carries them
        for link, rotor in tree.rotors.items():
            if (change := changes.get(tree.moving[link].name)) is not None:
                delta = self._rotor(rotor, change)
                carrier, pose = self._carrier(before, rotor)
                if carrier >= 0 and delta is not None:
                    others[carrier] = others.get(carrier, np.zeros((4, 4))) + moved(delta, pose)
        meshes = [carrier for carrier, _ in tree.meshes]
        for number, item in enumerate(tree.moving):
            if item.name not in changes or number in tree.ridden:
                continue
            change = changes[item.name]
            values = self._of_joint(item, change, tree.rotors.get(number))
            values |= _constraint(item, values, further.get(item.name, {}))
            self._set(item.element, values)
            own = tree.rotors.get(number)
            driven, turns = (item, 1.0) if own is None else (tree.moving[own.number], abs(own.turns))
            self._lift(driven.name, change.limit, turns)
            body = change.body
            if number in others and "m" in change.joint.parameters:
                body = (0 if body is None else body) - others[number]
            if body is None:
                continue
            if item.owner is None or number in meshes:
                raise self._no_inertial(item, meshes=number in meshes)
            _add_to_body(self.edit, self.places, item, item.owner, body)

    def _lift(self, joint: str, limit: float | None, turns: float) -> None:
        """Lift the limits of a joint's actuators that are below what its drive delivers, N·m (N) per joint turn."""
        if limit is None:
            return
        for actuator in self.tree.drives.of(joint):
            self._set(actuator, without_limits_below(actuator, limit / turns))

    def _set(self, element: Element, values: dict[str, str]) -> None:
        """Set attributes of an element, which has those of its class; equal numbers stay as they are written."""
        changed = other(element, values)
        if not changed:
            return
        if element.file != self.robot.source:
            name = element.attributes.get("name", element.tag)
            raise RobotError(f"{name} is described in {element.file}", hint="give that file, or write a .yaml")
        self.edit.set_attributes(self.places[element.tag, element.start], changed)

    def _no_inertial(self, item: MovingJoint, *, meshes: bool) -> RobotError:
        why = "its body has nothing but meshes" if meshes else "its body has another joint behind it"
        return RobotError(f"{self.robot.source}: {item.name}: no <inertial> to write to: {why}", hint="write a .yaml")

    def _carrier(self, before: Robot, rotor: Rotor) -> tuple[int, Array]:
        """Return the joint that moves what carries a rotor, -1 for the base, and the rotor's 4x4 pose in its frame."""
        moving, held = self.tree.moving, self.robot.held
        carrier, pose = moving[rotor.number].parent, moving[rotor.number].origin
        while carrier >= 0 and moving[carrier].name in held:
            item = moving[carrier]
            pose = item.origin @ motion(before.joint(item.name), held[item.name]) @ pose
            carrier = item.parent
        return carrier, pose

    def _of_joint(self, item: MovingJoint, change: Change, rotor: Rotor | None) -> dict[str, str]:
        """Return the attributes of a joint of the robot."""
        joint = change.joint
        specs = [s for s in self.robot.effects if s.effect == SPRING]
        spring = {s.joint or self.robot.joint_names[0]: s.parameters for s in specs}.get(item.name)
        values = self._zero(item, change.zero) | _spring(item, spring, self.tree.conventions.degrees)
        if rotor is None:
            return _dynamics(joint) | values | _limit(change.limit, 1.0)
        for attribute, effect in LINK_EFFECTS.items():
            value = declared(self.robot, item.name, *effect) if rotor.elastic else 0.0
            if value or attribute in item.element.attributes:
                values[attribute] = xml_number(value)
        return values

    def _zero(self, item: MovingJoint, zero: float) -> dict[str, str]:
        """Return the reference of a joint whose positions are read larger by `zero`, rad (m)."""
        if abs(zero) < SAME:
            return {}
        more = math.degrees(zero) if self.tree.conventions.degrees and item.turns else zero
        return {"ref": xml_number(item.element.number("ref", 0.0) + more)}

    def _rotor(self, rotor: Rotor, change: Change) -> Array | None:
        """Change a rotor and its transmission; return what its 4x4 pseudo-inertia changed by, in its frame."""
        joint, k = change.joint, rotor.turns
        item = self.tree.moving[rotor.number]
        values = self._zero(item, k * change.zero) | _limit(change.limit, abs(k))
        told = replace(
            joint,
            parameters={
                key: joint.parameters[key] / scale
                for key, scale in (("fs", abs(k)), ("fv", k**2))
                if key in joint.parameters
            },
        )
        values |= named(told, (("damping", "fv"), ("frictionloss", "fs")))
        if rotor.elastic:
            self._set(rotor.coupling, self._of_tendon(rotor, joint))
        inertia = _rotors_inertia(joint, k)
        if inertia is None or near(inertia, rotor.inertia):
            self._set(item.element, values)
            return None
        if not inertia > 0:
            raise RobotError(f"the rotor of {joint.name} would have an inertia of {inertia:.3g} kg·m²", hint=PHYSICAL)
        rotating = rotor.rotating
        if not rotor.couples and inertia > rotating:
            self._set(item.element, values | {"armature": xml_number(inertia - rotating)})
            return None
        if rotor.armature:
            values["armature"] = xml_number(rotor.armature * inertia / rotor.inertia)
        self._set(item.element, values)
        return self._turned_body(rotor, rotating * inertia / rotor.inertia)

    def _of_tendon(self, rotor: Rotor, joint: Joint) -> dict[str, str]:
        values = {}
        if "K" in joint.parameters:
            values["stiffness"] = xml_number(joint.parameters["K"] / rotor.lever**2)
        damping = declared(self.robot, joint.name, *DAMPING) / rotor.lever**2
        if joint.elastic and (damping or "damping" in rotor.coupling.attributes):
            values["damping"] = xml_number(damping)
        return values

    def _turned_body(self, rotor: Rotor, rotating: float) -> Array:
        """Give a rotor's body another inertia about its axis, kg·m²; return what changed, in the rotor's frame."""
        item = self.tree.moving[rotor.number]
        if rotor.number in [carrier for carrier, _ in self.tree.meshes] or item.owner is None:
            raise self._no_inertial(item, meshes=True)
        axis = np.array(axis_of(item.element))
        mass, centre, tensor = about_centre(inertial_parameters(item.own))
        own = float(axis @ tensor @ axis)
        factor = (rotating - (rotor.rotating - own)) / own if own > 0 else 0.0
        if not factor > 0:
            what = f"the body of {item.name} cannot have an inertia of {rotating:.3g} kg·m²"
            raise RobotError(what, hint="write a .yaml, which holds any")
        new = pseudo_inertia(about_origin(mass, centre, tensor * factor))
        _write_inertial(self.edit, self.places["body", item.owner.start], mass, centre, tensor * factor)
        back = translation(*(-value for value in item.element.numbers("pos", (0.0, 0.0, 0.0))))
        return moved(new - item.own, back)


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
    _write_inertial(edit, places["body", owner.start], mass, centre, tensor)


def _write_inertial(edit: XmlEdit, body: Element, mass: float, centre: Array, tensor: Array) -> None:
    full = f'mass="{xml_number(mass)}" fullinertia="{xml_numbers(six_of(tensor))}"'
    _set_inertial(edit, body, f'<inertial pos="{xml_numbers(centre)}" {full}/>')


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
    rest = math.degrees(rest) if degrees and item.turns else rest
    return {"stiffness": xml_number(stiffness), "springref": xml_number(rest)}


def _dynamics(joint: Joint) -> dict[str, str]:
    values = dict(joint.parameters)
    if joint.gear_ratio is not None and "Jm" in values:
        values["Ja"] = values["Jm"] * joint.gear_ratio**2
    return named(replace(joint, parameters=values), (("armature", "Ja"), ("damping", "fv"), ("frictionloss", "fs")))


def _rotors_inertia(joint: Joint, turns: float) -> float | None:
    """Return the inertia about its axis of a rotor of so many turns per joint turn, kg·m²; None: not known."""
    values = joint.parameters
    if joint.gear_ratio is not None and "Jm" in values:
        return values["Jm"] * (joint.gear_ratio / turns) ** 2
    return values["Ja"] / turns**2 if "Ja" in values else None


def _constraint(item: MovingJoint, values: Mapping[str, str], asked: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of a joint's friction constraint.

    What only makes dry friction hold the joint, where MuJoCo's own fades in, is not asked of friction that stays as it
    was, nor of a joint whose constraint the file describes.
    """
    known = item.element.attributes
    loss = float(values.get("frictionloss", 0.0))
    stays = not loss > 0 or near(loss, float(known.get("frictionloss", 0.0)))
    return {} if asked == FIRM and (stays or "solreffriction" in known) else dict(asked)


def _limit(limit: float | None, turns: float) -> dict[str, str]:
    """Return the limit of the torque of what turns so often per joint turn; empty where it is the file's."""
    if limit is None:  # of what all actuators of the joint deliver: a higher one may be theirs as well
        return {}
    if not math.isfinite(limit):
        return {"actuatorfrclimited": "false"}
    most = limit / turns
    return {"actuatorfrclimited": "true", "actuatorfrcrange": f"{xml_number(-most)} {xml_number(most)}"}
