"""The elastic robot as MJCF, so that MuJoCo moves as elid's forward dynamics do.

Every motor is a body of its own: a thin disc that rides on body i-1 and turns about the motor's axis by
``k_m·theta`` (its position in MuJoCo is the rotor's own angle). A fixed tendon of length ``q - theta`` with stiffness
K is the transmission, the rotor's friction and damping are ``fs/|k_m|`` and ``fv/k_m²``. Controls are motor torques
seen at the joint; the sensors ``<joint>_q <joint>_dq <joint>_theta <joint>_dtheta`` are those of a log. A rigid
transmission is an equality constraint, which MuJoCo keeps to about 1e-4; MuJoCo's friction loss holds a joint in
stiction, where elid rounds Coulomb friction.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from elid_cli.experiment.rotors import apart, known_parameters, split_mass
from elid_cli.files import write_text
from elid_cli.robot.inertia import about_centre, inertial_parameters
from elid_cli.robot.robot import Array, Joint, Robot
from elid_cli.robot.urdf.write import origins

ROTOR_SHARE = 1e-3
"""Part of a link's mass that its rotor carries, at the link's centre of mass, so that it does not matter."""
TIMESTEP = 5e-4
"""s; transmissions ring at tens of hertz to a kilohertz."""


def write_mjcf(robot: Robot, path: str | Path, parameters: Array | None = None) -> None:
    """Write a robot as MJCF, whole or not at all.

    Parameters
    ----------
    robot
        Any convention; its effects are named in a comment and not exported.
    path
        The file.
    parameters
        Standard parameters in standard order, shape (p,); the robot's reference values if None. Where they are not
        those of real bodies, parameters that no motion notices are changed until they are.

    Raises
    ------
    RobotError
        A parameter that matters is unknown, or no real body moves like this one.
    UsageError
        The file cannot be written.
    """
    write_text(path, mjcf_text(robot, parameters))


def mjcf_text(robot: Robot, parameters: Array | None = None) -> str:
    """Return a robot as MJCF text (see `write_mjcf`)."""
    values = known_parameters(robot, parameters)
    full, links = apart(robot, values)
    lines = [f"<mujoco model={quoteattr(robot.name)}>"]
    if robot.effects:
        names = ", ".join(effect.effect for effect in robot.effects)
        lines.append(f"  <!-- not in this file, though the robot description has them: {names} -->")
    lines += [
        '  <compiler angle="radian" autolimits="false" inertiafromgeom="false"/>',
        f'  <option gravity="{_spaced(robot.gravity)}" timestep="{TIMESTEP}" integrator="implicitfast"/>',
        "  <worldbody>",
        *_bodies(full, links),
        "  </worldbody>",
        *_transmissions(full.joints),
        *_motors(full.joints),
        *_sensors(full.joints),
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _bodies(robot: Robot, links: list[Array]) -> Iterator[str]:
    """Yield the nested bodies: in each the rotor that rides on it, then the next link."""
    places = origins(robot)
    pad = "    "
    yield from _rotor(robot.joints[0], 1e-3, np.zeros(3), pad)
    for i, (joint, link) in enumerate(zip(robot.joints, links, strict=True)):
        carried = robot.joints[i + 1] if i + 1 < robot.n else None
        mass, centre = 0.0, np.zeros(3)
        if carried is not None:
            link, mass, centre = split_mass(link, ROTOR_SHARE)
        place = f'pos="{_spaced(places[i][:3, 3])}" quat="{_spaced(_quaternion(places[i][:3, :3]))}"'
        yield f"{pad}<body name={quoteattr(joint.name + '_link')} {place}>"
        pad += "  "
        yield pad + _inertial(link)
        yield pad + _link_joint(joint)
        end = places[i + 1][:3, 3] if carried is not None else np.zeros(3)
        if np.linalg.norm(end) > 1e-6:
            size = _number(round(0.08 * float(np.linalg.norm(end)), 6))
            yield f'{pad}<geom type="capsule" fromto="0 0 0 {_spaced(end)}" size="{size}" contype="0" conaffinity="0"/>'
        if carried is not None:
            yield from _rotor(carried, mass, centre, pad)
    for _ in robot.joints:
        pad = pad[2:]
        yield f"{pad}</body>"


def _inertial(link: Array) -> str:
    mass, centre, tensor = about_centre(inertial_parameters(link))
    order = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
    return f'<inertial pos="{_spaced(centre)}" mass="{_number(mass)}" fullinertia="{_spaced(order)}"/>'


def _link_joint(joint: Joint) -> str:
    kind = "hinge" if joint.revolute else "slide"
    limits = f' limited="true" range="{_spaced(joint.limits.position)}"' if joint.limits.position is not None else ""
    return f'<joint name={quoteattr(joint.name)} type="{kind}" axis="{_spaced(joint.axis)}"{limits}/>'


def _rotor(joint: Joint, mass: float, centre: Array, pad: str) -> Iterator[str]:
    inertia = joint.parameters["Jm"]
    k = joint.gear_ratio
    friction = _number(max(joint.parameters.get("fs", 0.0), 0.0) / abs(k))
    damping = _number(joint.parameters.get("fv", 0.0) / k**2)
    name = joint.name + "_rotor"
    turned = _spaced(_quaternion(_frame_with_z(np.asarray(joint.motor_axis))))
    yield f'{pad}<body name={quoteattr(name)} pos="{_spaced(centre)}" quat="{turned}">'
    half = _number(inertia / 2)
    yield f'{pad}  <inertial pos="0 0 0" mass="{_number(mass)}" diaginertia="{half} {half} {_number(inertia)}"/>'
    yield (
        f'{pad}  <joint name={quoteattr(name)} type="hinge" axis="0 0 1" '
        f'damping="{damping}" frictionloss="{friction}" solreffriction="{2 * TIMESTEP} 1"/>'
    )
    yield f"{pad}</body>"


def _transmissions(joints: tuple[Joint, ...]) -> Iterator[str]:
    if any(joint.elastic for joint in joints):
        yield "  <tendon>"
        for joint in (joint for joint in joints if joint.elastic):
            name = quoteattr(joint.name + "_transmission")
            yield f'    <fixed name={name} stiffness="{_number(joint.parameters["K"])}" springlength="0">'
            yield f'      <joint joint={quoteattr(joint.name)} coef="1"/>'
            yield f'      <joint joint={quoteattr(joint.name + "_rotor")} coef="{_number(-1 / joint.gear_ratio)}"/>'
            yield "    </fixed>"
        yield "  </tendon>"
    if any(not joint.elastic for joint in joints):
        yield "  <equality>"
        for joint in (joint for joint in joints if not joint.elastic):
            both = f"joint1={quoteattr(joint.name + '_rotor')} joint2={quoteattr(joint.name)}"
            stiff = f'solref="{2 * TIMESTEP} 1" solimp="0.9999 0.9999 0.001"'
            yield f'    <joint {both} polycoef="0 {_number(joint.gear_ratio)} 0 0 0" {stiff}/>'
        yield "  </equality>"


def _motors(joints: tuple[Joint, ...]) -> Iterator[str]:
    yield "  <actuator>"
    for joint in joints:
        torque = joint.limits.torque
        limits = f' ctrllimited="true" ctrlrange="{_number(-torque)} {_number(torque)}"' if torque is not None else ""
        names = f"name={quoteattr(joint.name + '_motor')} joint={quoteattr(joint.name + '_rotor')}"
        yield f'    <motor {names} gear="{_number(1 / joint.gear_ratio)}"{limits}/>'
    yield "  </actuator>"


def _sensors(joints: tuple[Joint, ...]) -> Iterator[str]:
    yield "  <sensor>"
    for joint in joints:
        link, motor = quoteattr(joint.name), quoteattr(joint.name + "_motor")
        yield f"    <jointpos name={quoteattr(joint.name + '_q')} joint={link}/>"
        yield f"    <jointvel name={quoteattr(joint.name + '_dq')} joint={link}/>"
        yield f"    <actuatorpos name={quoteattr(joint.name + '_theta')} actuator={motor}/>"
        yield f"    <actuatorvel name={quoteattr(joint.name + '_dtheta')} actuator={motor}/>"
        yield f"    <actuatorfrc name={quoteattr(joint.name + '_tau')} actuator={motor}/>"
    yield "  </sensor>"


def _quaternion(rotation: Array) -> Array:
    """Return (w, x, y, z) of a 3x3 rotation, from its largest component (Shepperd 1978)."""
    xx, yy, zz = np.diag(rotation)
    squares = np.array([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz])
    a, b, c = rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]
    d, e, f = rotation[1, 0] + rotation[0, 1], rotation[0, 2] + rotation[2, 0], rotation[2, 1] + rotation[1, 2]
    rows = np.array([[squares[0], a, b, c], [a, squares[1], d, e], [b, d, squares[2], f], [c, e, f, squares[3]]])
    row = rows[int(np.argmax(squares))]
    return np.asarray(row / np.linalg.norm(row))


def _frame_with_z(z: Array) -> Array:
    """Return a 3x3 rotation whose third column is the unit vector z."""
    if z[2] == 1.0:
        return np.eye(3)
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _spaced(values: Array | tuple[float, ...]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return repr(float(value) + 0.0).removesuffix(".0")
