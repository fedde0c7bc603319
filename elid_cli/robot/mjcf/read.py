"""MJCF robots read as `Robot`: bodies, joints, inertials, armature, damping, friction loss, limits, default classes.

Frame i has the directions of the body that joint i moves, and its origin where the joint is. Bodies without joints are
merged into the body that carries them; free joints are held fixed. MuJoCo itself is asked, where it is installed, for
the inertia of bodies that have nothing but meshes.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.robot.frames import rotation_z, rpy_of, translation, z_to
from elid_cli.robot.inertia import about_origin, inertial_parameters, moved, pseudo_inertia
from elid_cli.robot.mjcf.attributes import MAIN, Conventions, merged
from elid_cli.robot.mjcf.drives import Drives, Motor
from elid_cli.robot.mjcf.elements import axis_of, first_number, included, inertial_of, placed_frames
from elid_cli.robot.mjcf.geoms import geom_inertia
from elid_cli.robot.mjcf.held import DAMPING, LINK_EFFECTS, SPRING
from elid_cli.robot.mjcf.loops import refuse_loops
from elid_cli.robot.mjcf.moving import MovingJoint
from elid_cli.robot.mjcf.rotors import Rotor, RotorSearch, motor_parameters, own_motor
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import BASE, MOST_READ, EffectSpec, Joint, Limits, Robot
from elid_cli.robot.urdf.xml import Element, parse_xml

MOVING = {"hinge": "revolute", "slide": "prismatic"}


def read_mjcf(text: str, file: str) -> Robot:
    """Return the robot of an MJCF text; `file` is its name for error messages, and where its ``<include>`` look.

    Raises
    ------
    RobotError
        No joint moves, a closed loop (by name), a type of joint that is not modelled, or not an MJCF.
    """
    return MjcfTree(text, file).robot()


class MjcfTree:
    """The bodies of an MJCF, walked once."""

    def __init__(self, text: str, file: str) -> None:
        self.file = file
        self.root = parse_xml(text, file)
        if self.root.tag != "mujoco":
            raise RobotError(f"{file}:{self.root.line}: <{self.root.tag}> where an MJCF has <mujoco>")
        self.root.children = list(included(self.root, Path(file).parent, 0))
        self.conventions = Conventions.of(self.root)
        self.moving: list[MovingJoint] = []
        self.links: dict[str, str] = {}
        self.sites: dict[str, str] = {}
        self.held: list[str] = []
        self.meshes: list[tuple[int, Element]] = []
        """Bodies whose inertia is that of meshes, with the joint that moves them."""
        for world in self.root.all("worldbody"):
            self._walk(world, -1, np.eye(4), world.attributes.get("childclass", MAIN))
        if not self.moving:
            raise RobotError(f"{file}: no joint moves", hint="joints read: hinge, slide")

    def robot(self) -> Robot:
        """Return the robot."""
        refuse_loops(self.root, self.links, self.sites, [rotor.coupling.place for rotor in self.rotors.values()])
        kept = [k for k in range(len(self.moving)) if k not in self.ridden]
        motors = {self.moving[k].name: self._motor(k) for k in kept}
        bodies = self._bodies()
        joints: list[Joint] = []
        for k in kept:
            joints.append(self._joint(k, bodies[k], motors[self.moving[k].name], joints[-1].name if joints else BASE))
        x, y, z = merged(self.root, "option").numbers("gravity", (0.0, 0.0, -9.81))
        notes = [f"{name} is held fixed: free joints are not modelled" for name in self.held]
        read = {rotor.coupling.place for rotor in self.rotors.values()}
        tendons = [tendon for holder in self.root.all("tendon") for tendon in holder.children]
        if beyond := sum(tendon.place not in read for tendon in tendons):
            notes.append(f"{beyond} tendons are not modelled")
        rotors = {self.moving[k].name: (self.moving[r.number].name, r.turns) for k, r in self.rotors.items()}
        carriers = {self.moving[k].name: self._carrier_name(k) for k in self.ridden}
        return Robot(
            name=self.root.attributes.get("model") or Path(self.file).stem,
            joints=tuple(joints), gravity=(x, y, z), dh="urdf",
            effects=tuple(spec for k in kept for spec in self._effects(k)),
            links={link: carriers.get(joint, joint) for link, joint in self.links.items()},
            control=self.drives.gains(motors), rotors=rotors, notes=(*notes, *self.root.faults),
        )  # fmt: skip

    @cached_property
    def drives(self) -> Drives:
        """The actuators."""
        return Drives(self.root, self.conventions)

    @cached_property
    def rotors(self) -> dict[int, Rotor]:
        """Rotors of their own, by the number of the joint that they drive."""
        self._compile_meshes()
        driven = [item.name for item in self.moving if any(self.drives.of(item.name))]
        return RotorSearch(self.root, self.conventions, self.moving, driven).found()

    @cached_property
    def ridden(self) -> dict[int, int]:
        """The joints that are rotors, with the number of the joint that each drives."""
        return {rotor.number: link for link, rotor in self.rotors.items()}

    def _carrier_name(self, k: int) -> str:
        parent = self.moving[k].parent
        return self.moving[parent].name if parent >= 0 else BASE

    def _motor(self, k: int) -> Motor:
        """Return what drives a joint: its rotor where it has one of its own."""
        rotor = self.rotors.get(k)
        item = self.moving[k if rotor is None else rotor.number]
        return Motor(item.name, item.element, 1.0 if rotor is None else rotor.turns)

    def _bodies(self) -> list[Array | None]:
        """Return what every joint carries up to the next, 4x4 in its frame (None: unknown): the rotors ride on it."""
        bodies = [item.body for item in self.moving]
        for number in self.ridden:
            rotor = self.moving[number]
            body = bodies[rotor.parent] if rotor.parent >= 0 else None
            if body is not None and rotor.body is not None:
                bodies[rotor.parent] = body + moved(rotor.body, rotor.origin)
        for link in self.rotors:
            body, element = bodies[link], self.moving[link].element
            armature = first_number(element, "armature") if "armature" in element.attributes else 0.0
            if not armature or body is None:
                continue
            if not self.moving[link].turns:
                element.fault("its armature, on the link's side of its transmission, is not modelled")
                continue
            element.fault("its armature, on the link's side of its transmission, is taken as its body's")
            axis = np.array(axis_of(element))
            tensor = armature * np.outer(axis, axis)
            bodies[link] = body + pseudo_inertia(about_origin(0.0, np.zeros(3), tensor))
        return bodies

    def _walk(self, holder: Element, carrier: int, pose: Array, childclass: str) -> None:
        """Visit the bodies inside a body, a ``<frame>`` or the world, at a 4x4 pose in the carrier's frame."""
        for child in holder.children:
            if child.tag in ("replicate", "attach", "composite", "flexcomp"):
                raise child.error(f"<{child.tag}> is not read", hint="save the compiled model: mujoco.mj_saveLastXML")
            inner = child.attributes.get("childclass", childclass)
            if child.tag == "frame":
                self._walk(child, carrier, pose @ self.conventions.pose(child), inner)
            elif child.tag == "site" and "name" in child.attributes:
                self.sites[child.attributes["name"]] = self.moving[carrier].name if carrier >= 0 else BASE
            elif child.tag == "body":
                self._body(child, carrier, pose @ self.conventions.pose(child), inner)

    def _body(self, body: Element, carrier: int, pose: Array, childclass: str) -> None:
        first = len(self.moving)
        for element in body.children:
            if element.tag == "freejoint":
                self.held.append(body.attributes.get("name", "the base"))
            if element.tag == "joint":
                carrier, pose = self._add(self.conventions.effective(element, childclass), body, carrier, pose)
        if len(self.moving) > first:
            self.moving[-1].owner = body
        if body.attributes.get("name"):
            self.links[body.attributes["name"]] = self.moving[carrier].name if carrier >= 0 else BASE
        if carrier >= 0:
            inertia = self._inertia(body, childclass)
            if inertia is None:
                self.meshes.append((carrier, body))
                self.moving[carrier].body = None
                return self._walk(body, carrier, pose, childclass)
            self.moving[carrier].add(body, inertia, pose)
        self._walk(body, carrier, pose, childclass)

    def _add(self, element: Element, body: Element, carrier: int, pose: Array) -> tuple[int, Array]:
        """Add a joint; return its number and the body's pose in its frame."""
        kind = element.attributes.get("type", "hinge")
        name = element.attributes.get("name") or f"{body.attributes.get('name', 'body')}_joint{len(self.moving) + 1}"
        if kind == "free":
            self.held.append(name)
            return carrier, pose
        if kind not in MOVING:
            raise element.error(f"type {kind!r} is not modelled", hint=f"types read: {', '.join(MOVING)}")
        if len(self.moving) == MOST_READ:
            raise element.error(f"one of more than {MOST_READ} joints that move; at most so many are read")
        if name in [joint.name for joint in self.moving]:
            raise element.error("a second joint of this name")
        at = element.numbers("pos", (0.0, 0.0, 0.0))
        origin = pose @ translation(*at)
        ref = element.number("ref", 0.0)
        if ref:
            turn = z_to(axis_of(element))
            back = rotation_z(-self.conventions.angle(ref)) if kind == "hinge" else translation(0, 0, -ref)
            origin = origin @ turn @ back @ turn.T
        self.moving.append(MovingJoint(name, element, origin, carrier))
        return len(self.moving) - 1, translation(*(-value for value in at))

    def _inertia(self, body: Element, childclass: str) -> Array | None:
        """Return a body's 4x4 pseudo-inertia in its own frame; None where only meshes would tell it."""
        inertial = body.one("inertial")
        if inertial is not None and self.conventions.from_geoms != "true":
            return inertial_of(inertial, self.conventions)
        if self.conventions.from_geoms == "false":
            return np.zeros((4, 4))
        total = np.zeros((4, 4))
        for part, at in [(body, np.eye(4)), *placed_frames(body, self.conventions)]:
            for geom in part.all("geom"):
                inertia = geom_inertia(self.conventions.effective(geom, childclass), self.conventions)
                if inertia is None:
                    return None
                total = total + moved(inertia, at)
        return total

    def _joint(self, k: int, body: Array | None, motor: Motor, before: str) -> Joint:
        item = self.moving[k]
        rotor = self.rotors.get(k)
        values: dict[str, float] = {}
        if body is not None:
            values |= zip(LINK_PARAMETERS, inertial_parameters(body).tolist(), strict=True)
        values |= own_motor(item.element) if rotor is None else motor_parameters(rotor, motor.element, item.element)
        x, y, z = item.origin[:3, 3].tolist()
        parent = self._carrier_name(k)
        geared, beside = rotor is not None and rotor.couples, rotor is not None and rotor.beside
        return Joint(
            name=item.name,
            type="revolute" if item.turns else "prismatic",
            parent="" if parent == before else parent,
            gear_ratio=motor.turns if geared else None,
            motor_axis=self._axis_of_rotor(rotor.number) if rotor is not None and beside else (0.0, 0.0, 1.0),
            transmission="rigid" if rotor is not None and not rotor.elastic else "auto",
            parameters=values,
            limits=Limits(position=self._range(item), torque=self.drives.torque_limit(motor)),
            xyz=(x, y, z),
            rpy=rpy_of(item.origin),
            axis=axis_of(item.element),
        )

    def _axis_of_rotor(self, number: int) -> tuple[float, float, float]:
        """Return the unit vector of a rotor's axis in the frame of the joint that carries it."""
        rotor = self.moving[number]
        x, y, z = (rotor.origin[:3, :3] @ axis_of(rotor.element)).tolist()
        return x, y, z

    def _range(self, item: MovingJoint) -> tuple[float, float] | None:
        element = item.element
        limited = element.attributes.get("limited", "auto")
        if "range" not in element.attributes or not (
            limited == "true" or (limited == "auto" and self.conventions.autolimits)
        ):
            return None
        low, high = element.numbers("range", (0.0, 0.0))
        if item.turns:
            low, high = self.conventions.angle(low), self.conventions.angle(high)
        return (low, high) if low < high else None

    def _effects(self, k: int) -> Iterator[EffectSpec]:
        """Yield the spring that a joint has to the body that carries it, and what damps its two sides."""
        item, rotor = self.moving[k], self.rotors.get(k)
        given = item.element.attributes
        stiffness = first_number(item.element, "stiffness") if "stiffness" in given else 0.0
        if stiffness:
            rest = item.element.number("springref", 0.0)
            rest = self.conventions.angle(rest) if item.turns else rest
            yield EffectSpec(SPRING, item.name, {"stiffness": stiffness, "preload": -stiffness * rest})
        if rotor is None or not rotor.elastic:
            return
        for attribute, (effect, parameter) in LINK_EFFECTS.items():
            if attribute in given and (value := first_number(item.element, attribute)):
                yield EffectSpec(effect, item.name, {parameter: value})
        if "damping" in rotor.coupling.attributes and (value := first_number(rotor.coupling, "damping")):
            yield EffectSpec(DAMPING[0], item.name, {DAMPING[1]: value * rotor.lever**2})

    def _compile_meshes(self) -> None:
        """Fill in the inertia of bodies that have nothing but meshes, as MuJoCo finds it."""
        if not any(self.moving[carrier].body is None for carrier, _ in self.meshes):
            return
        names = ", ".join(body.attributes.get("name", "a body") for _, body in self.meshes[:4])
        try:
            import mujoco

            model = mujoco.MjModel.from_xml_path(self.file)
        except ImportError:
            self.root.faults.append(f"the inertia of {names} is in meshes: unknown (pip install mujoco reads it)")
            return
        except ValueError as fault:
            self.root.faults.append(f"the inertia of {names} is in meshes: unknown ({str(fault).splitlines()[0]})")
            return
        for carrier in dict.fromkeys(carrier for carrier, _ in self.meshes):
            at = model.joint(self.moving[carrier].name).bodyid[0]
            total = np.zeros((4, 4))
            for b in range(model.nbody):
                pose = _compiled_pose(model, b, int(at))
                if pose is not None:
                    inertia = _compiled_inertia(model, b)
                    total = total + moved(inertia, pose)
            anchor = translation(*(-value for value in self.moving[carrier].element.numbers("pos", (0.0, 0.0, 0.0))))
            self.moving[carrier].body = moved(total, anchor)


def _compiled_pose(model: object, body: int, carrier: int) -> Array | None:
    """Return the 4x4 pose of a compiled body in its carrier's frame; None where a joint is in between."""
    pose = np.eye(4)
    while body != carrier:
        if body == 0 or model.body_jntnum[body]:  # type: ignore[attr-defined]
            return None
        pose = _placed(model.body_pos[body], model.body_quat[body]) @ pose  # type: ignore[attr-defined]
        body = int(model.body_parentid[body])  # type: ignore[attr-defined]
    return pose


def _compiled_inertia(model: object, body: int) -> Array:
    frame = _placed(model.body_ipos[body], model.body_iquat[body])  # type: ignore[attr-defined]
    own = np.diag(model.body_inertia[body])  # type: ignore[attr-defined]
    mass = float(model.body_mass[body])  # type: ignore[attr-defined]
    return moved(pseudo_inertia(about_origin(mass, np.zeros(3), own)), frame)


def _placed(position: Array, quaternion: Array) -> Array:
    text = {key: " ".join(map(repr, map(float, value))) for key, value in (("pos", position), ("quat", quaternion))}
    return Conventions().pose(Element("body", text, "", 0))
