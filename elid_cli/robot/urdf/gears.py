"""What URDF itself does not know of a robot: gears, stiffness, gravity, and the DH parameters it was written from.

Sources, later ones win: ``<transmission>`` (ROS 1 and ros2_control spellings), elid's ``<elid …/>`` elements,
the YAML file beside the URDF.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError, did_you_mean
from elid_cli.files import read_text
from elid_cli.robot.inertia import inertial_parameters, inverse, moved, pseudo_inertia
from elid_cli.robot.robot import LINK_PARAMETERS, Convention, Joint, Robot, Transmission
from elid_cli.robot.schema import read_effects, read_limits, read_log, read_parameters, read_vector
from elid_cli.robot.urdf.xml import Element
from elid_cli.robot.yaml import Value, parse_yaml

Vector = tuple[float, float, float]

DH = ("a", "alpha", "d", "theta")
_PARAMETER_TAGS = {"stiffness": "K", "motorInertia": "Jm", "rotorInertia": "Jm"}
_REDUCTION = ("mechanicalReduction", "mechanical_reduction")


@dataclass(frozen=True)
class Gears:
    """The gear of one joint; `motor_axis` None: along the joint's axis."""

    gear_ratio: float = 1.0
    motor_axis: Vector | None = None
    transmission: Transmission = "elastic"
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
            raise transmission.error(f"couples {len(joints)} joints; one joint per motor is modelled")
        name = joints[0].need("name")
        if name not in names:
            raise joints[0].error("no such joint", hint=did_you_mean(name, names))
        if name in found:
            raise transmission.error(f"a second transmission of joint {name!r}")
        if name in moving:
            found[name] = _gears(transmission, [transmission, joints[0], *transmission.all("actuator")])
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
    ratios = (ratios - {1.0}) or {1.0}
    if len(ratios) > 1 or 0.0 in ratios:
        listed = ", ".join(f"{ratio:g}" for ratio in sorted(ratios))
        raise transmission.error(f"mechanical reduction {listed}; one ratio other than 0 is needed")
    gears = Gears(gear_ratio=ratios.pop(), parameters=parameters)
    own = transmission.one("elid")
    return gears if own is None else _own(own, gears)


def _own(own: Element, gears: Gears) -> Gears:
    """Return the gear with what elid's own element says."""
    kind = own.attributes.get("transmission", "elastic")
    if kind not in ("elastic", "rigid"):
        raise own.error(f"transmission {kind!r} is not one of elastic, rigid")
    parameters = dict(gears.parameters)
    for attribute, name in (("stiffness", "K"), ("rotor_inertia", "Jm")):
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
    back = np.eye(4)  # coordinates of the URDF frame before the joint to those of the DH frame
    in_dh: list[Joint] = []
    for joint, (urdf_before, urdf_after), (before, after) in zip(
        joints, robot.placements(), described.placements(), strict=True
    ):
        if not np.allclose(urdf_after, np.eye(4), atol=1e-12) or not np.allclose(back @ urdf_before, before, atol=1e-9):
            return robot
        axis = back[:3, :3] @ joint.motor_axis + 0.0
        back = inverse(after)
        in_dh.append(replace(joint, motor_axis=_vector(axis), parameters=_moved(joint, back)))
    return replace(described, joints=tuple(in_dh))


def _moved(joint: Joint, transform: Array) -> dict[str, float]:
    parameters = dict(joint.parameters)
    if all(name in parameters for name in LINK_PARAMETERS) and not np.array_equal(transform, np.eye(4)):
        there = moved(pseudo_inertia(np.array([parameters[name] for name in LINK_PARAMETERS])), transform)
        parameters |= zip(LINK_PARAMETERS, map(float, inertial_parameters(there)), strict=True)
    return parameters


def beside_file(path: Path) -> Path:
    """Return where the YAML beside a URDF is: ``arm.elid.yaml`` for ``arm.urdf``."""
    return path.with_suffix(".elid.yaml")


def robot_with(robot: Robot, path: Path) -> Robot:
    """Return the robot completed from the YAML beside its URDF, unchanged where there is none.

    Raises
    ------
    RobotError
        With file, line and key, as for a robot description.
    """
    if not path.exists():
        return robot
    top = parse_yaml(read_text(path, RobotError), str(path)).fields(
        (), ("gravity", "description", "effects", "log", "joints")
    )
    joints = list(robot.joints)
    if "joints" in top:
        for key, value in top["joints"].entries():
            if key.text() not in robot.joint_names:
                raise key.error(f"no joint {key.text()!r}", hint=did_you_mean(key.text(), robot.joint_names))
            index = robot.joint_names.index(key.text())
            joints[index] = _completed(joints[index], value.within(key.text()))
    robot = replace(robot, joints=tuple(joints))
    if "gravity" in top:
        robot = replace(robot, gravity=read_vector(top["gravity"]))
    if "description" in top:
        robot = replace(robot, description=top["description"].text())
    if "effects" in top:
        robot = replace(robot, effects=read_effects(top["effects"], joints))
    return replace(robot, log=read_log(top["log"])) if "log" in top else robot


def _completed(joint: Joint, value: Value) -> Joint:
    keys = value.fields((), ("gear_ratio", "motor_axis", "transmission", "parameters", "limits"))
    if "gear_ratio" in keys:
        ratio = keys["gear_ratio"].number()
        if ratio == 0:
            raise keys["gear_ratio"].error("0; the rotor turns per joint turn, 1 for a direct drive")
        joint = replace(joint, gear_ratio=ratio)
    if "motor_axis" in keys:
        joint = replace(joint, motor_axis=read_vector(keys["motor_axis"], unit=True))
    if "transmission" in keys:
        kind = cast(Transmission, keys["transmission"].choice(("elastic", "rigid")))
        joint = replace(joint, transmission=kind)
    if "parameters" in keys:
        joint = replace(joint, parameters=dict(joint.parameters) | read_parameters(keys["parameters"]))
    return replace(joint, limits=read_limits(keys["limits"])) if "limits" in keys else joint


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
