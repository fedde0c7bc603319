"""Joints of an MJCF with a rotor of its own: elastic ones by a tendon with stiffness, geared ones by a constraint.

MuJoCo has no joint with a spring inside. Such a joint is written as two: the link's, and that of a rotor, a balanced
body without further joints. A ``<fixed>`` tendon of length ``c (q - r / k)``, which is 0 at rest, has the stiffness of
the transmission divided by c²; an equality ``r = k q`` is a rigid transmission. Here r is the rotor's angle, k its
turns per turn of the joint: the gear ratio.

A rotor that rides on the body that carries the joint couples to its rotation. MuJoCo's `armature` does not, and
neither does a rotor that turns in the world: these are known by their inertia at the joint.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.inertia import inertial_parameters, moved, symmetric
from elid_cli.robot.mjcf.attributes import MAIN, Conventions, about
from elid_cli.robot.mjcf.elements import axis_of, first_number
from elid_cli.robot.mjcf.moving import MovingJoint
from elid_cli.robot.urdf.xml import Element

BALANCED = 1e-3
"""Unbalance of a rotor, as a part of its own inertia, up to which it is none."""
SMALL = 1e-3
"""Part of a rotor's inertia that may couple, or not, as the rest does, without a word."""


@dataclass(frozen=True)
class Rotor:
    """A rotor and the joint that it drives, by their numbers in the tree."""

    link: int
    number: int
    coupling: Element
    """The tendon, with the attributes of its class, or the equality."""
    lever: float
    """Length of the tendon per rad (m) of the joint."""
    turns: float
    """Its turns per turn (m) of the joint."""
    rotating: float
    """Inertia of its body about its axis, kg·m² …"""
    armature: float
    """… and what is added to that, without coupling to the body that carries it."""
    beside: bool
    """Whether it rides on the body that carries the joint …"""
    couples: bool
    """… and couples to the rotation of that."""

    @property
    def elastic(self) -> bool:
        """Whether a spring is between both."""
        return self.coupling.tag == "fixed"

    @property
    def inertia(self) -> float:
        """All of its inertia about its axis, kg·m²."""
        return self.rotating + self.armature


@dataclass(frozen=True)
class Coupling:
    """An element that couples two joints: lengths (or constraint) per rad or m of each."""

    element: Element
    levers: tuple[tuple[str, float], tuple[str, float]]
    fault: str
    """Why it cannot be a transmission, empty where it can."""


class RotorSearch:
    """Looks for joints with a rotor of their own."""

    def __init__(
        self, root: Element, conventions: Conventions, moving: Sequence[MovingJoint], driven: Collection[str]
    ) -> None:
        self._root, self._conventions, self._moving = root, conventions, moving
        self._names = [joint.name for joint in moving]
        self._driven = driven
        """The joints that actuators act on."""

    def found(self) -> dict[int, Rotor]:
        """Return the rotors by the number of the joint that they drive; what is nearly one is told as a fault."""
        couplings = [*self._tendons(), *self._equalities()]
        uses = Counter(name for coupling in couplings for name, _ in coupling.levers)
        rotors: dict[int, Rotor] = {}
        for coupling in couplings:
            candidates = [k for k, (name, _) in enumerate(coupling.levers) if self._could_be_rotor(name)]
            unbalanced = [] if candidates else self._unbalanced(coupling)
            if not candidates and not unbalanced:
                continue
            answer: Rotor | str = coupling.fault or "".join(map(self._why_not, unbalanced))
            twice = [name for name, _ in coupling.levers if uses[name] > 1]
            if not answer and twice:
                answer = f"{twice[0]} is coupled to more than one joint"
            answer = answer or self._rotor(coupling, candidates)
            if isinstance(answer, Rotor):
                rotors[answer.link] = answer
            else:
                coupling.element.fault(f"not read as the transmission of a joint: {answer}")
        return rotors

    def _tendons(self) -> Iterator[Coupling]:
        for holder in self._root.all("tendon"):
            for child in holder.all("fixed"):
                element = self._conventions.effective(child, MAIN)
                levers = [(part.attributes.get("joint", ""), part.number("coef", 1.0)) for part in child.all("joint")]
                stiff = first_number(element, "stiffness") if "stiffness" in element.attributes else 0.0
                if len(levers) == 2 and stiff > 0 and all(lever and name in self._names for name, lever in levers):
                    yield Coupling(element, (levers[0], levers[1]), self._no_spring(element, levers))

    def _no_spring(self, tendon: Element, levers: Sequence[tuple[str, float]]) -> str:
        """Return why a tendon is not a linear spring and damper that rest where both joints are at 0."""
        given = tendon.attributes
        for key in ("stiffness", "damping"):
            if key in given and any(tendon.parsed(given[key], len(given[key].split()), key)[1:]):
                return f"a polynomial as {key} is not modelled"
        for key in ("frictionloss", "armature"):
            if key in given and first_number(tendon, key):
                return f"{key} of a transmission is not modelled"
        automatic = "true" if "range" in given and self._conventions.autolimits else "false"
        if given.get("limited", "auto").replace("auto", automatic) == "true":
            return "stops of a transmission (range) are not modelled"
        length = given.get("springlength", "-1")
        ends = tendon.parsed(length, len(length.split()), "springlength")
        if all(end == -1.0 for end in ends):  # as long as with the springs of both joints at rest
            rest = sum(lever * self._rest_of(name) for name, lever in levers)
            ends = (rest, rest)
        if any(ends):
            return f'at rest its length is {" to ".join(f"{end:g}" for end in ends)}; springlength="0" is modelled'
        return ""

    def _rest_of(self, name: str) -> float:
        joint = self._moving[self._names.index(name)]
        rest = joint.element.number("springref", 0.0)
        return self._conventions.angle(rest) if joint.turns else rest

    def _equalities(self) -> Iterator[Coupling]:
        for holder in self._root.all("equality"):
            for element in holder.all("joint"):
                one, two = (element.attributes.get(key, "") for key in ("joint1", "joint2"))
                text = element.attributes.get("polycoef", "0 1")
                ratio = [*element.parsed(text, len(text.split()), "polycoef"), 0.0, 0.0]
                off = element.attributes.get("active", "true") == "false"
                # one to one, two wheels on a shaft look like a rotor and its joint: the one follows the other
                if off or not ratio[1] or abs(ratio[1]) == 1.0 or one not in self._names or two not in self._names:
                    continue
                fault = 'only polycoef="0 k 0 0 0" is modelled' if ratio[0] or any(ratio[2:]) else ""
                yield Coupling(element, ((one, -1.0), (two, ratio[1])), fault)

    def _could_be_rotor(self, name: str) -> bool:
        """Whether a joint is a hinge of one balanced body with no other joint on it."""
        joint = self._moving[self._names.index(name)]
        return self._is_alone(joint) and joint.body is not None and _is_balanced(joint.body, joint.element)

    def _is_alone(self, joint: MovingJoint) -> bool:
        """Whether a joint is a hinge, the only joint of its body, and carries no other one."""
        first = joint.parent < 0 or self._moving[joint.parent].owner is not None
        carries = any(other.parent >= 0 and self._moving[other.parent] is joint for other in self._moving)
        return joint.turns and joint.owner is not None and first and not carries

    def _unbalanced(self, coupling: Coupling) -> list[str]:
        """Return the joint that would be the rotor of a tendon, an actuator's, were its body balanced."""
        if coupling.element.tag != "fixed":
            return []
        driven = [name for name, _ in coupling.levers if name in self._driven]
        alone = [name for name in driven if self._is_alone(self._moving[self._names.index(name)])]
        return alone if len(driven) == 1 else []

    def _why_not(self, name: str) -> str:
        """Return why a joint that an actuator drives is no rotor, of one that is alone on its body."""
        known = self._moving[self._names.index(name)].body is not None
        return f"{name} is not balanced" if known else f"the inertia of {name} is unknown"

    def _rotor(self, coupling: Coupling, candidates: list[int]) -> Rotor | str:
        """Return the rotor of a coupling, or why it is none."""
        driven = [k for k, (name, _) in enumerate(coupling.levers) if name in self._driven]
        if len(driven) == 2:
            return f"actuators act on both {coupling.levers[0][0]} and {coupling.levers[1][0]}"
        if len(driven) == 1 and driven[0] not in candidates:
            name = coupling.levers[driven[0]][0]
            return f"an actuator acts on {name}, which is no balanced body on a hinge of its own, as a rotor is"
        among = [k for k in candidates if k in driven] or candidates
        place = min(among, key=lambda k: coupling.levers[k][1])
        (name, own), (driven_name, lever) = coupling.levers[place], coupling.levers[1 - place]
        number, link = self._names.index(name), self._names.index(driven_name)
        rotor = self._moving[number]
        assert rotor.body is not None
        if "stiffness" in rotor.element.attributes and first_number(rotor.element, "stiffness"):
            return f"{name} has a spring of its own, which is not modelled"
        armature = first_number(rotor.element, "armature") if "armature" in rotor.element.attributes else 0.0
        rotating = _about_axis(rotor.body, rotor.element)
        beside = rotor.parent == self._moving[link].parent
        couples = rotating >= armature and beside
        if not rotating + armature > 0:
            return f"{name} has no inertia"
        if rotating > armature and not beside and rotor.parent >= 0:
            return f"{name} rides on another body than the one that carries {driven_name}"
        if rotor.parent >= 0 and min(rotating, armature) > SMALL * (rotating + armature):
            rotor.element.fault(f"{'all' if couples else 'none'} of its inertia is taken to couple to what carries it")
        return Rotor(link, number, coupling.element, lever, _turns(lever, own), rotating, armature, beside, couples)


def _turns(lever: float, own: float) -> float:
    """Return the turns of a rotor per turn of its joint, from the levers of joint and rotor.

    A few decimals where they give the same lever: that of a rotor is often written as the inverse of a gear ratio.
    """
    plain = float(f"{-lever / own:.12g}")
    return plain if -lever / plain == own else -lever / own


def _is_balanced(body: Array, element: Element) -> bool:
    """Whether a 4x4 pseudo-inertia in a joint's frame stays the same when the joint turns."""
    turn = np.eye(4)
    turn[:3, :3] = about(np.array(axis_of(element)), 1.0, element)
    change = np.abs(moved(body, turn) - body)
    size = float(np.trace(body[:3, :3]))
    return bool(change[:3, :3].max() <= BALANCED * size and change[:3, 3].max() ** 2 <= BALANCED**2 * size * body[3, 3])


def _about_axis(body: Array, element: Element) -> float:
    """Return the inertia about a joint's axis, kg·m², of a 4x4 pseudo-inertia in its frame."""
    axis = np.array(axis_of(element))
    return float(axis @ symmetric(inertial_parameters(body)[4:]) @ axis)


def own_motor(element: Element) -> dict[str, float]:
    """Return what a joint's element says of a motor that turns with it."""
    told = (("Ja", "armature"), ("fs", "frictionloss"), ("fv", "damping"))
    return {key: first_number(element, attribute) for key, attribute in told if attribute in element.attributes}


def motor_parameters(rotor: Rotor, own: Element, link: Element) -> dict[str, float]:
    """Return what a rotor, of joint element `own`, says of the motor of the joint `link`, and of its transmission."""
    k = rotor.turns
    motor, beside = own_motor(own), own_motor(link)
    values = {key: motor[key] * scale for key, scale in (("fs", abs(k)), ("fv", k**2)) if key in motor}
    values |= {"Jm": rotor.inertia} if rotor.couples else {"Ja": rotor.inertia * k**2}
    if rotor.elastic:
        return values | {"K": first_number(rotor.coupling, "stiffness") * rotor.lever**2}
    return values | {key: values.get(key, 0.0) + beside[key] for key in ("fs", "fv") if key in beside}
