"""MJCF robots read as `Robot`: bodies, joints, inertials, armature, damping, friction loss, limits, default classes.

Frame i has the directions of the body that joint i moves, and its origin where the joint is. Bodies without joints are
merged into the body that carries them; free joints are held fixed. MuJoCo itself is asked, where it is installed, for
the inertia of bodies that have nothing but meshes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.robot.frames import rotation_z, rpy_of, translation, z_to
from elid_cli.robot.inertia import about_origin, inertial_parameters, moved, pseudo_inertia
from elid_cli.robot.mjcf.attributes import ACTUATORS, MAIN, Conventions, merged
from elid_cli.robot.mjcf.elements import axis_of, first_number, included, inertial_of, placed_frames
from elid_cli.robot.mjcf.geoms import geom_inertia
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import BASE, MOST_READ, EffectSpec, Joint, Limits, Robot
from elid_cli.robot.urdf.xml import Element, parse_xml

MOVING = {"hinge": "revolute", "slide": "prismatic"}
SPRING = "link_spring"
"""Effect that `stiffness` and `springref` of a joint stand for."""


@dataclass
class MovingJoint:
    """A joint that moves: where it stands in the file and in the tree, and the inertia it moves (None: unknown)."""

    name: str
    element: Element
    """With the attributes of its class."""
    origin: Array
    """4x4 pose in the frame of the joint that carries it."""
    parent: int
    body: Array | None = field(default_factory=lambda: np.zeros((4, 4)))
    owner: Element | None = None
    """The body element that carries the inertia; None of the first of several joints of one body."""
    own: Array = field(default_factory=lambda: np.zeros((4, 4)))
    """The 4x4 pseudo-inertia of that body alone, in its own frame."""
    fixed: list[Element] = field(default_factory=list)
    """The bodies that it carries without a joint in between, and that have a mass."""

    def add(self, body: Element, inertia: Array, pose: Array) -> None:
        """Add a body that it moves, of a 4x4 pseudo-inertia in its own frame, which is at a 4x4 pose in the joint's."""
        if self.owner is body:
            self.own = inertia
        elif inertia.any():
            self.fixed.append(body)
        if self.body is not None:
            self.body = self.body + moved(inertia, pose)


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
        self.held: list[str] = []
        self.meshes: list[tuple[int, Element]] = []
        """Bodies whose inertia is that of meshes, with the joint that moves them."""
        for world in self.root.all("worldbody"):
            self._walk(world, -1, np.eye(4), world.attributes.get("childclass", MAIN))
        if not self.moving:
            raise RobotError(f"{file}: no joint moves", hint="joints read: hinge, slide")

    def robot(self) -> Robot:
        """Return the robot."""
        self._refuse_loops()
        self._compile_meshes()
        names = [joint.name for joint in self.moving]
        joints = tuple(self._joint(k, names) for k in range(len(names)))
        springs = tuple(spec for item in self.moving for spec in self._spring(item))
        x, y, z = merged(self.root, "option").numbers("gravity", (0.0, 0.0, -9.81))
        notes = [f"{name} is held fixed: free joints are not modelled" for name in self.held]
        control = self._control(names)
        tendons = [tendon for holder in self.root.all("tendon") for tendon in holder.children]
        if tendons:
            notes.append(f"{len(tendons)} tendons are not modelled")
        return Robot(
            name=self.root.attributes.get("model") or Path(self.file).stem,
            joints=joints, gravity=(x, y, z), dh="urdf", effects=springs, links=self.links, control=control,
            notes=(*notes, *self.root.faults),
        )  # fmt: skip

    def _walk(self, holder: Element, carrier: int, pose: Array, childclass: str) -> None:
        """Visit the bodies inside a body, a ``<frame>`` or the world, at a 4x4 pose in the carrier's frame."""
        for child in holder.children:
            if child.tag in ("replicate", "attach", "composite", "flexcomp"):
                raise child.error(f"<{child.tag}> is not read", hint="save the compiled model: mujoco.mj_saveLastXML")
            inner = child.attributes.get("childclass", childclass)
            if child.tag == "frame":
                self._walk(child, carrier, pose @ self.conventions.pose(child), inner)
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

    def _joint(self, k: int, names: list[str]) -> Joint:
        item = self.moving[k]
        element = item.element
        values: dict[str, float] = {}
        if item.body is not None:
            values |= zip(LINK_PARAMETERS, inertial_parameters(item.body).tolist(), strict=True)
        for key, attribute in (("Ja", "armature"), ("fs", "frictionloss"), ("fv", "damping")):
            if attribute in element.attributes:
                values[key] = first_number(element, attribute)
        x, y, z = item.origin[:3, 3].tolist()
        before = names[k - 1] if k else BASE
        parent = names[item.parent] if item.parent >= 0 else BASE
        kind = MOVING[element.attributes.get("type", "hinge")]
        return Joint(
            name=item.name,
            type="revolute" if kind == "revolute" else "prismatic",
            parent="" if parent == before else parent,
            transmission="auto",
            parameters=values,
            limits=self._limits(item),
            xyz=(x, y, z),
            rpy=rpy_of(item.origin),
            axis=axis_of(element),
        )

    def _limits(self, item: MovingJoint) -> Limits:
        element = item.element
        position = None
        limited = element.attributes.get("limited", "auto")
        if "range" in element.attributes and (limited == "true" or (limited == "auto" and self.conventions.autolimits)):
            low, high = element.numbers("range", (0.0, 0.0))
            if element.attributes.get("type", "hinge") == "hinge":
                low, high = self.conventions.angle(low), self.conventions.angle(high)
            position = (low, high) if low < high else None
        torques = [self._torque(actuator) for actuator in self._actuators(item.name)]
        if "actuatorfrcrange" in element.attributes and element.attributes.get("actuatorfrclimited") != "false":
            torques.append(max(map(abs, element.numbers("actuatorfrcrange", (0.0, 0.0)))))
        torque = min((value for value in torques if value > 0), default=None)
        return Limits(position=position, torque=torque)

    def _actuators(self, joint: str) -> Iterator[Element]:
        for holder in self.root.all("actuator"):
            for element in holder.children:
                if element.tag in ACTUATORS and element.attributes.get("joint") == joint:
                    yield self.conventions.effective(element, MAIN)

    def _control(self, joints: Sequence[str]) -> dict[str, dict[str, float]]:
        """Return gains of the position actuators, empty unless every joint has one of which both are told.

        A damping ratio is none: it depends on the inertia that the compiler sees. Commands of one with a gear are not
        positions of the joint.
        """
        gains: dict[str, dict[str, float]] = {"kp": {}, "kd": {}}
        for name in joints:
            for actuator in self._actuators(name):
                told = {"kp", "kv"} <= set(actuator.attributes) and "dampratio" not in actuator.attributes
                direct = "gear" not in actuator.attributes or first_number(actuator, "gear") == 1.0
                if actuator.tag == "position" and told and direct:
                    gains["kp"][name] = actuator.number("kp", 0.0)
                    gains["kd"][name] = actuator.number("kv", 0.0)
        return gains if set(gains["kp"]) == set(joints) else {}

    @staticmethod
    def _torque(actuator: Element) -> float:
        """Return the largest torque of an actuator at its joint, 0 where it has no limit."""
        gear = abs(first_number(actuator, "gear")) if "gear" in actuator.attributes else 1.0
        sizes = []
        for key in ("forcerange", *(("ctrlrange",) if actuator.tag == "motor" else ())):
            if key in actuator.attributes:
                sizes.append(gear * max(map(abs, actuator.numbers(key, (0.0, 0.0)))))
        return min((size for size in sizes if size > 0), default=0.0)

    def _spring(self, item: MovingJoint) -> Iterator[EffectSpec]:
        """Yield the spring that a joint has to the body that carries it."""
        stiffness = first_number(item.element, "stiffness") if "stiffness" in item.element.attributes else 0.0
        if stiffness:
            rest = item.element.number("springref", 0.0)
            if item.element.attributes.get("type", "hinge") == "hinge":
                rest = self.conventions.angle(rest)
            yield EffectSpec(SPRING, item.name, {"stiffness": stiffness, "preload": -stiffness * rest})

    def _refuse_loops(self) -> None:
        for holder in self.root.all("equality"):
            for element in holder.children:
                if element.attributes.get("active", "true") == "false":
                    continue
                one, two = element.attributes.get("body1"), element.attributes.get("body2")
                if element.tag in ("connect", "weld") and one and two and two != "world":
                    what = f"<{element.tag}> of bodies {one!r} and {two!r} closes a loop, which is not modelled"
                    raise element.error(what, hint='take the constraint out, or set active="false"')
                if element.tag == "joint":
                    follower = element.attributes.get("joint1", "")
                    if "joint2" in element.attributes:
                        element.fault(f"{follower} follows another joint in the file; here it is one of its own")

    def _compile_meshes(self) -> None:
        """Fill in the inertia of bodies that have nothing but meshes, as MuJoCo finds it."""
        if not self.meshes:
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
