"""Effects that attributes of an MJCF stand for, and which of a robot's effects its MJCF holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from elid_cli.robot.files import is_mjcf
from elid_cli.robot.robot import EffectSpec, Robot

SPRING = "link_spring"
"""Effect that `stiffness` and `springref` of a joint stand for."""
_VISCOUS, _COULOMB = "link_viscous", "link_coulomb"
LINK_EFFECTS: Mapping[str, tuple[str, str]] = {
    "damping": (_VISCOUS, "friction"),
    "frictionloss": (_COULOMB, "friction"),
}
"""Attributes of the link's joint of an elastic joint, with the effects that they stand for and their parameters."""
DAMPING = ("transmission_damping", "damping")
"""The effect, and its parameter, that `damping` of a tendon stands for."""


def is_held(robot: Robot, spec: EffectSpec) -> bool:
    """Whether an effect stands in the robot's own MJCF, or in a new one of a robot that has none."""
    if spec.effect == SPRING:
        return True
    if spec.effect not in (DAMPING[0], *(effect for effect, _ in LINK_EFFECTS.values())):
        return False
    joint = robot.joint(spec.joint or robot.joint_names[0])
    return joint.elastic and (joint.name in robot.rotors or not is_mjcf(Path(robot.source)))


def declared(robot: Robot, joint: str, effect: str, parameter: str) -> float:
    """Return the value of an effect's parameter at a joint, 0 where the robot does not have the effect."""
    return sum(
        spec.parameters.get(parameter, 0.0)
        for spec in robot.effects
        if spec.effect == effect and (spec.joint or robot.joint_names[0]) == joint
    )


def folded(robot: Robot) -> Robot:
    """Return the robot with what damps the two sides of joints with a rotor of their own, where they count as rigid.

    Friction of the link is then one with the motor's, and nothing damps the transmission.
    """
    joints = {joint.name: joint for joint in robot.joints}
    effects = []
    for spec in robot.effects:
        name = spec.joint or robot.joint_names[0]
        kind = {_VISCOUS: "fv", _COULOMB: "fs", DAMPING[0]: ""}.get(spec.effect)
        if kind is None or name not in robot.rotors or joints[name].elastic:
            effects.append(spec)
        elif kind:
            values = dict(joints[name].parameters)
            values[kind] = values.get(kind, 0.0) + sum(spec.parameters.values())
            joints[name] = replace(joints[name], parameters=values)
    return replace(robot, joints=tuple(joints.values()), effects=tuple(effects))
