"""Effects that attributes of an MJCF stand for, and which of a robot's effects its MJCF holds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from elid_cli.robot.files import is_mjcf
from elid_cli.robot.robot import EffectSpec, Robot

SPRING = "link_spring"
"""Effect that `stiffness` and `springref` of a joint stand for."""
LINK_EFFECTS: Mapping[str, tuple[str, str]] = {
    "damping": ("link_viscous", "friction"),
    "frictionloss": ("link_coulomb", "friction"),
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
