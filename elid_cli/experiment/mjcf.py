"""Elastic robot as MJCF, rotors apart.

Every motor is a body of its own: a thin disc that rides on body i-1 and turns about the motor's axis by
``k_m·theta`` (its position in MuJoCo is the rotor's own angle). A fixed tendon of length ``q - theta`` with stiffness
K is the transmission, the rotor's friction and damping are ``fs/|k_m|`` and ``fv/k_m²``. Controls are motor torques
seen at the joint; the sensors ``<joint>_q <joint>_dq <joint>_theta <joint>_dtheta`` are those of a log. A rigid
transmission is an equality constraint, which MuJoCo keeps to about 1e-4; MuJoCo's friction loss holds a joint in
stiction, where elid rounds Coulomb friction. A reflected inertia behind a spring is the armature of a rotor in the
world. `robot/mjcf/rotors.py` reads all this back.

In the model (paper, appendix A) body i-1 contains the whole of rotor i, and the rotor's spin adds
``Jm k z·w dtheta + Jm k² dtheta²/2``. As bodies of their own, a rotor is a thin disc ``diag(Jm/2, Jm/2, Jm)`` and the
link is what remains, which must be the inertia of a real body. Reference values often are not (eq. 45 has Ixx = 0):
parameters that the motion cannot notice are then changed, within the null space of the base parameters, until it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.experiment.mjcf_friction import soft_attributes
from elid_cli.experiment.real_bodies import apart, known_parameters, split_mass
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.effects.declared import is_soft_in_mjcf, resolve
from elid_cli.robot.frames import z_to
from elid_cli.robot.inertia import about_centre, inertial_parameters, six_of
from elid_cli.robot.mjcf.elements import stiffness_and_rest
from elid_cli.robot.mjcf.held import DAMPING, LINK_EFFECTS, SPRING, declared, is_held
from elid_cli.robot.robot import Joint, Robot
from elid_cli.robot.urdf.write import origins
from elid_cli.robot.xml_text import quoted, xml_number, xml_numbers

ROTOR_SHARE = 1e-3
"""Part of a link's mass that its rotor carries, at the link's centre of mass, so that it does not matter."""
BODY_SHARE = 1e-4
"""Part of a reflected inertia that is its rotor's body: MuJoCo asks every body for some."""
TIMESTEP = 5e-4
"""s; longest time step that is written …"""
MODE_STEP = 1.0
"""… and the longest in radians of the fastest elastic mode: MuJoCo takes tendons' springs explicitly, whatever the
integrator, and is unstable from 2 on."""
_POSES = 24


def mjcf_text(robot: Robot) -> str:
    """Return a robot as MJCF text.

    Parameters
    ----------
    robot
        Any convention. Springs on links are joints' stiffness, friction that fades in softens their friction; friction
        and damping of elastic joints' links and transmissions are those of joints and tendons. Its other effects are
        named in a comment, and not exported. Where its parameters are not those of real bodies, those that no motion
        notices are changed until they are.

    Raises
    ------
    RobotError
        A parameter that matters is unknown, or no real body moves like this one.
    """
    values = known_parameters(robot)
    full, links = apart(robot, values)
    lines = [f"<mujoco model={quoted(robot.name)}>"]
    new = replace(robot, source="")
    beyond = [s.effect for s in robot.effects if not is_held(new, s) and not is_soft_in_mjcf(robot, s)]
    if beyond:
        names = ", ".join(beyond)
        lines.append(f"  <!-- not in this file, though the robot description has them: {names} -->")
    step = f"{time_step(robot, values):.9g}"
    lines += [
        '  <compiler angle="radian" autolimits="false" inertiafromgeom="false"/>',
        f'  <option gravity="{xml_numbers(robot.gravity)}" timestep="{step}" integrator="implicitfast"/>',
        "  <worldbody>",
        *_bodies(full, links, soft_attributes(full)),
        "  </worldbody>",
        *_transmissions(full),
        *_motors(full.joints),
        *_sensors(full.joints),
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def time_step(robot: Robot, parameters: Array) -> float:
    """Return a time step (s) that the fastest elastic mode of a robot allows, looked for in poses over all its range.

    `parameters` (p,) are known, as from `known_parameters`.
    """
    dynamics = Dynamics(robot, parameters)
    n, elastic = robot.n, dynamics.elastic
    springs = np.zeros((n + len(elastic), n + len(elastic)))
    for place, k in enumerate(elastic, n):
        springs[np.ix_([k, place], [k, place])] = dynamics.stiffness[k] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    fastest = 0.0
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, n)):
        squares = np.linalg.eigvals(np.linalg.solve(dynamics.mass_matrix(q.tolist()), springs))
        fastest = max(fastest, float(np.sqrt(np.max(squares.real, initial=0.0))))
    return TIMESTEP / max(1, math.ceil(TIMESTEP * fastest / MODE_STEP))


def _bodies(robot: Robot, links: list[Array], soft: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """Yield the nested bodies: in each the rotors that ride on it, then the next links."""
    places = origins(robot)
    springs = {resolve(robot, spec)[1]: spec.parameters for spec in robot.effects if spec.effect == SPRING}

    def carried(parent: int, link: Array | None, pad: str) -> Iterator[str]:
        """Yield what a body (-1: the world) carries, its own inertia first, less what stands in for its rotors."""
        on = [k for k, carrier in enumerate(robot.parents) if carrier == parent]
        riding = [k for k in on if robot.joints[k].gear_ratio is not None]
        rotors: list[str] = []
        for k in riding:
            mass, centre = 1e-3, np.zeros(3)
            if link is not None:
                link, mass, centre = split_mass(link, ROTOR_SHARE)
            rotors += _rotor(robot.joints[k], mass, centre, pad)
        if link is not None:
            yield pad + _inertial(link)
            joint = robot.joints[parent]
            yield pad + _link_joint(robot, joint, springs.get(parent), soft.get(joint.name))
        for k in on:
            end = places[k][:3, 3]
            if link is not None and np.linalg.norm(end) > 1e-6:
                size = xml_number(round(0.08 * float(np.linalg.norm(end)), 6))
                shape = f'fromto="0 0 0 {xml_numbers(end)}" size="{size}"'
                yield f'{pad}<geom type="capsule" {shape} contype="0" conaffinity="0"/>'
        yield from rotors
        for k in on:
            place = f'pos="{xml_numbers(places[k][:3, 3])}" quat="{xml_numbers(_quaternion(places[k][:3, :3]))}"'
            yield f"{pad}<body name={quoted(robot.joints[k].name + '_link')} {place}>"
            yield from carried(k, links[k], pad + "  ")
            yield f"{pad}</body>"

    for (
        joint
    ) in robot.joints:  # a reflected inertia behind a spring: a rotor that turns in the world, coupled to nothing
        if joint.elastic and joint.gear_ratio is None:
            yield from _rotor(joint, 1e-3, np.zeros(3), "    ")
    yield from carried(-1, None, "    ")


def _armature(joint: Joint) -> bool:
    """Whether a motor is MuJoCo's own: its reflected inertia rigidly at the joint."""
    return joint.gear_ratio is None and not joint.elastic


def _inertial(link: Array) -> str:
    mass, centre, tensor = about_centre(inertial_parameters(link))
    return (
        f'<inertial pos="{xml_numbers(centre)}" mass="{xml_number(mass)}" fullinertia="{xml_numbers(six_of(tensor))}"/>'
    )


def _link_joint(robot: Robot, joint: Joint, spring: Mapping[str, float] | None, soft: Mapping[str, str] | None) -> str:
    kind = "hinge" if joint.revolute else "slide"
    limits = (
        f' limited="true" range="{xml_numbers(joint.limits.position)}"' if joint.limits.position is not None else ""
    )
    motor = ""
    if _armature(joint):
        own = joint.parameters
        firm = {"solreffriction": f"{2 * TIMESTEP} 1"} if soft is None else soft
        constraint = " ".join(f'{name}="{value}"' for name, value in firm.items())
        friction = f'frictionloss="{xml_number(max(own.get("fs", 0.0), 0.0))}" {constraint}'
        motor = f' armature="{xml_number(own["Ja"])}" damping="{xml_number(own.get("fv", 0.0))}" {friction}'
    for attribute, effect in LINK_EFFECTS.items() if joint.elastic else ():
        if value := declared(robot, joint.name, *effect):
            motor += f' {attribute}="{xml_number(value)}"'
    if spring is not None:
        stiffness, rest = stiffness_and_rest(spring)
        motor += f' stiffness="{xml_number(stiffness)}" springref="{xml_number(rest)}"'
    return f'<joint name={quoted(joint.name)} type="{kind}" axis="{xml_numbers(joint.axis)}"{limits}{motor}/>'


def _rotor(joint: Joint, mass: float, centre: Array, pad: str) -> Iterator[str]:
    k = _ratio(joint)
    # an armature couples to nothing, as a reflected inertia does
    whole = joint.parameters["Jm" if joint.gear_ratio is not None else "Ja"]
    inertia = whole if joint.gear_ratio is not None else BODY_SHARE * whole
    armature = "" if joint.gear_ratio is not None else f' armature="{xml_number(whole - inertia)}"'
    friction = xml_number(max(joint.parameters.get("fs", 0.0), 0.0) / abs(k))
    damping = xml_number(joint.parameters.get("fv", 0.0) / k**2)
    name = joint.name + "_rotor"
    turned = xml_numbers(_quaternion(z_to(joint.motor_axis)[:3, :3]))
    yield f'{pad}<body name={quoted(name)} pos="{xml_numbers(centre)}" quat="{turned}">'
    half = xml_number(inertia / 2)
    yield f'{pad}  <inertial pos="0 0 0" mass="{xml_number(mass)}" diaginertia="{half} {half} {xml_number(inertia)}"/>'
    yield (
        f'{pad}  <joint name={quoted(name)} type="hinge" axis="0 0 1" '
        f'damping="{damping}" frictionloss="{friction}" solreffriction="{2 * TIMESTEP} 1"{armature}/>'
    )
    yield f"{pad}</body>"


def _ratio(joint: Joint) -> float:
    """Return the turns of the body that stands for a rotor per turn of its joint."""
    return 1.0 if joint.gear_ratio is None else joint.gear_ratio


def _transmissions(robot: Robot) -> Iterator[str]:
    joints = robot.joints
    if any(joint.elastic for joint in joints):
        yield "  <tendon>"
        for joint in (joint for joint in joints if joint.elastic):
            name = quoted(joint.name + "_transmission")
            stiffness = f'stiffness="{xml_number(joint.parameters["K"])}"'
            if value := declared(robot, joint.name, *DAMPING):
                stiffness += f' damping="{xml_number(value)}"'
            yield f'    <fixed name={name} {stiffness} springlength="0">'
            yield f'      <joint joint={quoted(joint.name)} coef="1"/>'
            yield f'      <joint joint={quoted(joint.name + "_rotor")} coef="{xml_number(-1 / _ratio(joint))}"/>'
            yield "    </fixed>"
        yield "  </tendon>"
    stiff = [joint for joint in joints if not joint.elastic and not _armature(joint)]
    if stiff:
        yield "  <equality>"
        for joint in stiff:
            both = f"joint1={quoted(joint.name + '_rotor')} joint2={quoted(joint.name)}"
            firm = f'solref="{2 * TIMESTEP} 1" solimp="0.9999 0.9999 0.001"'
            yield f'    <joint {both} polycoef="0 {xml_number(_ratio(joint))} 0 0 0" {firm}/>'
        yield "  </equality>"


def _motors(joints: tuple[Joint, ...]) -> Iterator[str]:
    yield "  <actuator>"
    for joint in joints:
        torque = joint.limits.torque
        limits = (
            f' ctrllimited="true" ctrlrange="{xml_number(-torque)} {xml_number(torque)}"' if torque is not None else ""
        )
        moved = joint.name if _armature(joint) else joint.name + "_rotor"
        names = f"name={quoted(joint.name + '_motor')} joint={quoted(moved)}"
        yield f'    <motor {names} gear="{xml_number(1 / _ratio(joint))}"{limits}/>'
    yield "  </actuator>"


def _sensors(joints: tuple[Joint, ...]) -> Iterator[str]:
    yield "  <sensor>"
    for joint in joints:
        link, motor = quoted(joint.name), quoted(joint.name + "_motor")
        yield f"    <jointpos name={quoted(joint.name + '_q')} joint={link}/>"
        yield f"    <jointvel name={quoted(joint.name + '_dq')} joint={link}/>"
        yield f"    <actuatorpos name={quoted(joint.name + '_theta')} actuator={motor}/>"
        yield f"    <actuatorvel name={quoted(joint.name + '_dtheta')} actuator={motor}/>"
        yield f"    <actuatorfrc name={quoted(joint.name + '_tau')} actuator={motor}/>"
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
