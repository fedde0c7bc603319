"""A robot as URDF: link frames where the joints are, inertials about the centres of mass, gears in <transmission>.

URDF puts a link's frame at the joint that moves it, distal DH at its far end: `in_joint_frames` moves the parameters.
What URDF cannot say (stiffness, rotor inertia, motor axis, DH parameters, gravity) goes into ``<elid …/>`` elements,
which other readers skip; effects and the log mapping stay in elid's YAML.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.robot.frames import rpy_of
from elid_cli.robot.inertia import (
    about_centre,
    about_origin,
    inertial_parameters,
    moved,
    pseudo_inertia,
    real_tensor,
    ten_of,
)
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Joint, Robot
from elid_cli.robot.urdf.gears import OWN_PARAMETERS
from elid_cli.robot.xml_text import quoted, xml_attributes, xml_number, xml_numbers

UNLIMITED = 1e9
"""What stands for no limit: URDF asks for the numbers."""
NEAR = 0.1
"""m from its joint at which a body lies of which nothing but a first moment is known."""
FAITHFUL = 1e-9
"""How far, relative to the largest, a body's parameters may change through mass and centre of mass."""


def unreal_bodies(links: Sequence[str]) -> str:
    """Return the comment of a URDF on links whose inertia no real body has; kinematics libraries load them."""
    return (f"the principal moments of inertia of {', '.join(links)} are those of no real body, which some simulators "
            "refuse: full physical parameters first: elid identify … --physical")  # fmt: skip


def urdf_text(robot: Robot) -> str:
    """Return a robot as URDF text.

    Parameters
    ----------
    robot
        Any convention; DH robots keep their DH parameters as a remark that elid reads back.

    Raises
    ------
    RobotError
        A body that no mass and centre of mass can stand for (a first moment without mass).
    """
    robot = in_joint_frames(_with_masses(robot))
    description = f" description={quoted(robot.description)}" if robot.description else ""
    links = link_names(robot)
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f"<robot name={quoted(robot.name)}>",
        f'  <elid gravity="{xml_numbers(robot.gravity)}" dh="{robot.dh}"{description}/>',
        f"  <link name={quoted(links[0])}/>",
    ]
    for i, (joint, origin) in enumerate(zip(robot.joints, origins(robot), strict=True)):
        lines += _link(joint, links[i + 1])
        lines += _joint(joint, origin, links[robot.parents[i] + 1], links[i + 1])
        lines += _transmission(joint, robot.dh != "urdf")
    unreal = [link for joint, link in zip(robot.joints, links[1:], strict=True) if _unreal(joint)]
    if unreal:
        lines.insert(1, f"<!-- {unreal_bodies(unreal).replace('--', '- -')} -->")
    return "\n".join([*lines, "</robot>"]) + "\n"


def with_parameters(robot: Robot, parameters: Array) -> Robot:
    """Return the robot with standard parameters, shape (p,), in place of its reference values (NaN: unknown)."""
    values = dict(zip(robot.parameter_names(), (float(value) for value in parameters), strict=True))
    joints = []
    for k, joint in enumerate(robot.joints):
        known = {p.kind: value for p, value in values.items() if p.joint == k and not math.isnan(value)}
        joints.append(replace(joint, parameters=known))
    return replace(robot, joints=tuple(joints))


def in_joint_frames(robot: Robot) -> Robot:
    """Return the robot with inertial parameters and motor axes in joint frames (the frame that joint i moves).

    The geometry is left as it was described. In these frames proximal DH and URDF robots are unchanged. A body whose
    mass is unknown keeps no inertial parameters; other unknown ones count as 0.
    """
    joints: list[Joint] = []
    afters = [np.eye(4)]  # coordinates of each DH frame to those of its joint frame; first the base's
    for joint, parent, (_, after) in zip(robot.joints, robot.parents, robot.placements(), strict=True):
        if robot.dh == "urdf":
            after = np.eye(4)
        values = dict(joint.parameters)
        if "m" in values:
            given = ten_of(values)
            there = (
                given if np.array_equal(after, np.eye(4)) else inertial_parameters(moved(pseudo_inertia(given), after))
            )
            values |= zip(LINK_PARAMETERS, map(float, there), strict=True)
        else:
            values = {name: value for name, value in values.items() if name not in LINK_PARAMETERS}
        x, y, z = afters[parent + 1][:3, :3] @ joint.motor_axis
        joints.append(replace(joint, parameters=values, motor_axis=(float(x), float(y), float(z))))
        afters.append(after)
    return replace(robot, joints=tuple(joints))


def _with_masses(robot: Robot) -> Robot:
    """Return the robot with a mass of every body of which something else is known: no motion shows it then.

    A link of a URDF is its mass at its centre of mass: without one all that is known of it would be lost.
    """
    joints = (replace(joint, parameters=_with_mass(joint.parameters)) for joint in robot.joints)
    return replace(robot, joints=tuple(joints))


def _with_mass(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return parameters of a joint with a mass where others of its link are known: twice the least that they need."""
    given = ten_of({"m": 0.0, **parameters})
    if "m" in parameters or not given.any():
        return dict(parameters)
    first, spin = float(np.linalg.norm(given[1:4])), 0.5 * float(given[4:7].sum())
    mass = 2.0 * first**2 / spin if first > 0 and spin > 0 else first / NEAR if first > 0 else 1.0
    return {**parameters, "m": mass}


def origins(robot: Robot) -> list[Array]:
    """Return every joint's 4x4 origin in the joint frame before it; the joint then moves about or along its axis."""
    if robot.dh == "urdf":
        # `before` also turns z onto the axis, and `after` turns back: together they are the plain origin
        return [before @ after for before, after in robot.placements()]
    placements = robot.placements()
    return [
        (placements[parent][1] if parent >= 0 else np.eye(4)) @ before
        for parent, (before, _) in zip(robot.parents, placements, strict=True)
    ]


def link_names(robot: Robot) -> list[str]:
    """Return n + 1 link names that no joint has taken: the base, then one per joint."""
    return ["base_link", *(f"{name}_link" for name in robot.joint_names)]


def _link(joint: Joint, name: str) -> list[str]:
    if "m" not in joint.parameters:
        return [f"  <link name={quoted(name)}/>"]
    given = ten_of(joint.parameters)
    try:
        mass, centre, tensor = about_centre(given)
        faithful = np.abs(about_origin(mass, centre, tensor) - given).max() <= FAITHFUL * max(
            1e-12, np.abs(given).max()
        )
    except ValueError:
        faithful = False
    if not faithful or not np.all(np.isfinite(tensor)):
        raise RobotError(
            f"{joint.name}: a first moment of {np.linalg.norm(given[1:4]):.3g} kg·m and a mass of {given[0]:.3g} kg",
            detail="a link of a URDF is its mass at its centre of mass",
            hint="full physical parameters first: elid identify … --physical",
        )
    inertia = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), tensor[np.triu_indices(3)], strict=True)
    return [
        f"  <link name={quoted(name)}>",
        "    <inertial>",
        f'      <origin xyz="{xml_numbers(centre)}" rpy="0 0 0"/>',
        f'      <mass value="{xml_number(mass)}"/>',
        f"      <inertia {xml_attributes({key: xml_number(value) for key, value in inertia})}/>",
        "    </inertial>",
        "  </link>",
    ]


def _unreal(joint: Joint) -> bool:
    if "m" not in joint.parameters:
        return False
    mass, _, tensor = about_centre(ten_of(joint.parameters))
    return mass > 0 and not real_tensor(tensor)


def _joint(joint: Joint, origin: Array, parent: str, child: str) -> Iterator[str]:
    urdf = joint.xyz != (0.0, 0.0, 0.0) or joint.rpy != (0.0, 0.0, 0.0)
    xyz = joint.xyz if urdf else origin[:3, 3]
    rpy = joint.rpy if urdf else rpy_of(origin)
    limits = joint.limits
    kind = joint.type if limits.position is not None or not joint.revolute else "continuous"
    yield f'  <joint name={quoted(joint.name)} type="{kind}">'
    yield f'    <origin xyz="{xml_numbers(xyz)}" rpy="{xml_numbers(rpy)}"/>'
    yield f"    <parent link={quoted(parent)}/>"
    yield f"    <child link={quoted(child)}/>"
    yield f'    <axis xyz="{xml_numbers(joint.axis)}"/>'
    low, high = limits.position or (-UNLIMITED, UNLIMITED)
    position = f'lower="{xml_number(low)}" upper="{xml_number(high)}" ' if kind != "continuous" else ""
    effort, velocity = limits.torque or UNLIMITED, limits.velocity or UNLIMITED
    yield f'    <limit {position}effort="{xml_number(effort)}" velocity="{xml_number(velocity)}"/>'
    dynamics = {
        attribute: xml_number(joint.parameters[name])
        for attribute, name in (("damping", "fv"), ("friction", "fs"))
        if name in joint.parameters
    }
    if dynamics:
        yield f"    <dynamics {xml_attributes(dynamics)}/>"
    yield "  </joint>"


def _transmission(joint: Joint, dh: bool) -> Iterator[str]:
    own = {"transmission": joint.transmission, "motor_axis": xml_numbers(joint.motor_axis)}
    for attribute, name in OWN_PARAMETERS:
        if name in joint.parameters:
            own[attribute] = xml_number(joint.parameters[name])
    if joint.limits.acceleration is not None:
        own["acceleration"] = xml_number(joint.limits.acceleration)
    if dh:
        own |= {key: xml_number(getattr(joint, key)) for key in ("a", "alpha", "d", "theta")}
    yield f"  <transmission name={quoted(joint.name + '_transmission')}>"
    yield "    <type>transmission_interface/SimpleTransmission</type>"
    yield f"    <joint name={quoted(joint.name)}>"
    yield "      <hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface>"
    yield "    </joint>"
    yield f"    <actuator name={quoted(joint.name + '_motor')}>"
    if joint.gear_ratio is not None:
        yield f"      <mechanicalReduction>{xml_number(joint.gear_ratio)}</mechanicalReduction>"
    yield "    </actuator>"
    yield f"    <elid {xml_attributes(own)}/>"
    yield "  </transmission>"
