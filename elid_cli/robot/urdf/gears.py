"""What URDF itself does not know of a robot: gears, stiffness, gravity, and the DH parameters it was written from.

Sources, later ones win: ``<transmission>`` (ROS 1 and ros2_control spellings), elid's ``<elid …/>`` elements, the YAML
file beside the URDF (`robot/beside.py`). A mechanical reduction of 1 is taken as not given: files say it that had to
say something. Who means a direct drive says so in the YAML file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import did_you_mean
from elid_cli.robot.inertia import inertial_parameters, inverse, moved, pseudo_inertia
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Convention, Joint, Robot, Transmission
from elid_cli.robot.schema import TRANSMISSIONS
from elid_cli.robot.urdf.xml import Element

Vector = tuple[float, float, float]

DH = ("a", "alpha", "d", "theta")
_PARAMETER_TAGS = {"stiffness": "K", "motorInertia": "Jm", "rotorInertia": "Jm"}
OWN_PARAMETERS = (("stiffness", "K"), ("rotor_inertia", "Jm"), ("reflected_inertia", "Ja"))
"""Attributes of elid's own element with the parameters that they hold."""
_REDUCTION = ("mechanicalReduction", "mechanical_reduction")


@dataclass(frozen=True)
class Gears:
    """The gear of one joint; `motor_axis` None: along the joint's axis."""

    gear_ratio: float | None = None
    motor_axis: Vector | None = None
    transmission: Transmission = "auto"
    parameters: dict[str, float] = field(default_factory=dict)
    acceleration: float | None = None
    dh: dict[str, float] | None = None


def default_axis(origin: Array, axis: Array) -> Vector:
    """Return the joint's axis in the frame before it, from its 4x4 origin and its axis (3,) in its own frame."""
    x, y, z = origin[:3, :3] @ axis
    return float(x), float(y), float(z)


def gears_of(root: Element, moving: Sequence[str]) -> dict[str, Gears]:
    """Return the gear of every moving joint that a <transmission> names."""
    names = [joint.attributes.get("name", "") for joint in root.all("joint")]
    found: dict[str, Gears] = {}
    for transmission in _transmissions(root):
        joints = list(transmission.all("joint"))
        if len(joints) != 1:
            transmission.fault(f"names {len(joints)} joints, where one is modelled: gear ratios there are unknown")
            continue
        name = joints[0].need("name")
        if name not in names:
            joints[0].fault(f"no such joint: not read ({did_you_mean(name, names) or 'check the name'})")
        elif name in found:
            transmission.fault(f"a second transmission of joint {name!r} is not read")
        elif name in moving:
            found[name] = _gears(transmission, [transmission, joints[0], *transmission.all("actuator")])
    for own in root.all("elid"):
        name = own.attributes.get("joint", "")
        if name in moving:
            found[name] = _own(own, found.get(name, Gears()))
    return found


def _transmissions(root: Element) -> Iterator[Element]:
    yield from root.all("transmission")
    for control in root.all("ros2_control"):
        yield from control.all("transmission")


def _gears(transmission: Element, holders: Sequence[Element]) -> Gears:
    ratios: set[float] = set()
    parameters: dict[str, float] = {}
    for holder in holders:
        for child in holder.children:
            if child.tag in _REDUCTION:
                ratios.add(child.parsed(child.text, 1, child.tag)[0])
            elif child.tag in _PARAMETER_TAGS:
                parameters[_PARAMETER_TAGS[child.tag]] = child.parsed(child.text, 1, child.tag)[0]
    own = transmission.one("elid")
    if own is None:  # 1 is what files say whose writers had to say something
        ratios -= {1.0}
    if len(ratios) > 1 or 0.0 in ratios:
        listed = ", ".join(f"{ratio:g}" for ratio in sorted(ratios))
        raise transmission.error(f"mechanical reduction {listed}; one ratio other than 0 is needed")
    gears = Gears(gear_ratio=ratios.pop() if ratios else None, parameters=parameters)
    return gears if own is None else _own(own, gears)


def _own(own: Element, gears: Gears) -> Gears:
    """Return the gear with what elid's own element says."""
    kind = own.attributes.get("transmission", "auto")
    if kind not in TRANSMISSIONS:
        raise own.error(f"transmission {kind!r} is not one of {', '.join(TRANSMISSIONS)}")
    parameters = dict(gears.parameters)
    for attribute, name in OWN_PARAMETERS:
        if attribute in own.attributes:
            parameters[name] = own.number(attribute, 0.0)
    axis = None
    if "motor_axis" in own.attributes:
        x, y, z = own.numbers("motor_axis", (0.0, 0.0, 1.0))
        length = float(np.linalg.norm((x, y, z)))
        if abs(length - 1) > 1e-6:
            raise own.error(f"motor_axis of length {length:g}; a unit vector is needed")
        axis = (x, y, z) if abs(length - 1) < 1e-14 else (x / length, y / length, z / length)
    return replace(
        gears,
        gear_ratio=own.number("gear_ratio", 0.0) or gears.gear_ratio,
        motor_axis=axis,
        transmission=cast(Transmission, kind),
        parameters=parameters,
        acceleration=own.number("acceleration", 0.0) or None,
        dh={key: own.number(key, 0.0) for key in DH} if all(key in own.attributes for key in DH) else None,
    )


def written_as_dh(robot: Robot, own: Element | None, gears: dict[str, Gears]) -> Robot:
    """Return the robot in its DH frames where elid wrote the URDF from DH parameters and they still fit the origins.

    So base parameters keep the names they have in the DH description. An edited geometry stays in URDF frames.
    """
    convention = own.attributes.get("dh") if own is not None else None
    hints = [gears[name].dh if name in gears else None for name in robot.joint_names]
    if convention not in ("standard", "modified") or None in hints:
        return robot
    joints = tuple(
        replace(joint, **hint, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0))
        for joint, hint in zip(robot.joints, cast(list[dict[str, Any]], hints), strict=True)
    )
    described = replace(robot, joints=joints, dh=cast(Convention, convention))
    backs = [np.eye(4)]  # coordinates of the URDF frame before a joint to those of the DH frame; first the base's
    in_dh: list[Joint] = []
    for joint, parent, (urdf_before, urdf_after), (before, after) in zip(
        joints, robot.parents, robot.placements(), described.placements(), strict=True
    ):
        back = backs[parent + 1]
        if not np.allclose(urdf_after, np.eye(4), atol=1e-12) or not np.allclose(back @ urdf_before, before, atol=1e-9):
            return robot
        axis = back[:3, :3] @ joint.motor_axis + 0.0
        backs.append(inverse(after))
        in_dh.append(replace(joint, motor_axis=_vector(axis), parameters=_moved(joint, backs[-1])))
    return replace(described, joints=tuple(in_dh))


def _moved(joint: Joint, transform: Array) -> dict[str, float]:
    parameters = dict(joint.parameters)
    if all(name in parameters for name in LINK_PARAMETERS) and not np.array_equal(transform, np.eye(4)):
        there = moved(pseudo_inertia(np.array([parameters[name] for name in LINK_PARAMETERS])), transform)
        parameters |= zip(LINK_PARAMETERS, map(float, inertial_parameters(there)), strict=True)
    return parameters


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
