"""What an MJCF element means once defaults, classes and the compiler's conventions are applied."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.frames import rotation_z, translation
from elid_cli.robot.urdf.xml import Element

MAIN = "main"
ACTUATORS = ("motor", "position", "velocity", "general", "intvelocity", "damper", "cylinder", "muscle", "adhesion")
TENDONS = ("fixed", "spatial")


@dataclass(frozen=True)
class Conventions:
    """The ``<compiler>`` of a model, and its default classes: class -> tag -> attributes."""

    degrees: bool = True
    euler: str = "xyz"
    autolimits: bool = True
    from_geoms: str = "auto"
    groups: tuple[float, float] = (0, 5)
    defaults: Mapping[str, Mapping[str, Mapping[str, str]]] = field(default_factory=dict)

    @classmethod
    def of(cls, root: Element) -> Conventions:
        """Return the conventions of a whole model."""
        compiler = merged(root, "compiler")
        defaults: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
        for top in root.all("default"):
            _defaults(top, defaults, top.attributes.get("class", MAIN), defaults[MAIN])
        given = compiler.attributes
        low, high = compiler.numbers("inertiagrouprange", (0.0, 5.0))
        return cls(
            given.get("angle", "degree") == "degree",
            given.get("eulerseq", "xyz"),
            given.get("autolimits", "true") == "true",
            given.get("inertiafromgeom", "auto"),
            (low, high),
            defaults,
        )

    def effective(self, element: Element, childclass: str) -> Element:
        """Return an element with the attributes of its class under its own."""
        name = element.attributes.get("class", childclass)
        if name not in self.defaults:
            raise element.error(f"no default class {name!r}")
        tags = (element.tag, "general") if element.tag in ACTUATORS else (element.tag,)
        tags = ("tendon",) if element.tag in TENDONS else tags
        inherited = next((self.defaults[name][tag] for tag in tags if tag in self.defaults[name]), {})
        return replace(element, attributes={**inherited, **element.attributes})

    def angle(self, value: float) -> float:
        """Return an angle in rad."""
        return math.radians(value) if self.degrees else value

    def pose(self, element: Element) -> Array:
        """Return the 4x4 pose that an element's position and orientation give."""
        pose = translation(*element.numbers("pos", (0.0, 0.0, 0.0)))
        pose[:3, :3] = self.orientation(element)
        return pose

    def orientation(self, element: Element) -> Array:
        """Return the 3x3 rotation of an element: quat, axisangle, euler, xyaxes or zaxis."""
        given = element.attributes
        if "quat" in given:
            return _of_quaternion(np.array(element.numbers("quat", (1.0, 0.0, 0.0, 0.0))), element)
        if "axisangle" in given:
            x, y, z, angle = element.numbers("axisangle", (0.0, 0.0, 1.0, 0.0))
            return about(np.array([x, y, z]), self.angle(angle), element)
        if "euler" in given:
            turn = np.eye(3)
            for letter, angle in zip(self.euler, element.numbers("euler", (0.0, 0.0, 0.0)), strict=True):
                step = about(np.eye(3)["xyz".index(letter.lower())], self.angle(angle), element)
                turn = turn @ step if letter.islower() else step @ turn
            return turn
        if "xyaxes" in given:
            values = np.array(element.numbers("xyaxes", (0.0,) * 6))
            first = _unit(values[:3], element)
            second = _unit(values[3:] - first * (first @ values[3:]), element)
            return np.stack([first, second, np.cross(first, second)], axis=1)
        if "zaxis" in given:
            return from_z(_unit(np.array(element.numbers("zaxis", (0.0, 0.0, 1.0))), element))
        return np.eye(3)


def merged(root: Element, tag: str) -> Element:
    """Return one element with the attributes of all of a tag, of which a model may have several."""
    found = Element(tag, {}, root.file, root.line, faults=root.faults)
    for element in root.all(tag):
        found.attributes |= element.attributes
    return found


def _defaults(
    element: Element, found: dict[str, dict[str, dict[str, str]]], name: str, above: Mapping[str, Mapping[str, str]]
) -> None:
    own = {tag: dict(attributes) for tag, attributes in above.items()}
    for child in element.children:
        if child.tag != "default":
            own[child.tag] = own.get(child.tag, {}) | child.attributes
    found[name] = own
    for child in element.all("default"):
        _defaults(child, found, child.need("class"), own)


def about(axis: Array, angle: float, element: Element) -> Array:
    """Return the 3x3 rotation about an axis by an angle in rad."""
    turn = rotation_z(angle)
    return _turn_about(_unit(axis, element), turn[1, 0], turn[0, 0])


def from_z(z: Array) -> Array:
    """Return the smallest 3x3 rotation that takes the z axis to a unit vector."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    s, c = float(np.linalg.norm(axis)), float(z[2])
    if s < 1e-12:
        return np.eye(3) if c > 0 else np.diag([1.0, -1.0, -1.0])
    return _turn_about(axis / s, s, c)


def _turn_about(axis: Array, s: float, c: float) -> Array:
    """Return the 3x3 rotation about a unit vector by an angle of sine s and cosine c (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + s * cross + (1 - c) * cross @ cross)


def _of_quaternion(quaternion: Array, element: Element) -> Array:
    w, x, y, z = _unit(quaternion, element)
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def _unit(vector: Array, element: Element) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise element.error("a direction of length 0")
    return vector / length
